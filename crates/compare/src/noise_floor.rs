//! What error noise alone makes: the figure below which no model can come on these recordings.
//!
//! The white part of the coordinates' noise is read off the recordings. The difference of unfiltered and filtered coordinates, in the
//! tangent of the filtered pose, is differenced four times; what is left lies near half the frame rate, where bodies have nothing to
//! say, and for white noise has 70 times its variance (Σ binomial(4, k)²). Its covariance over all coordinates, without the
//! frames that stand out, gives the covariance of the noise. Noise drawn with it is then added to the filtered motion and goes
//! the way of the data: the same filter, the same derivatives, the same rows, the same windows; noise of the plates likewise, from
//! [`Measured::noise_density`](crate::Measured::noise_density). The wrench with noise less the wrench without is the floor.
//!
//! Not in it: soft tissue, wrong joint centres, plates that drift. They are slow, repeat themselves, and count as explainable. Where
//! somebody smoothed the recordings before, the floor is too low.

use crate::breakdown::{Counting, GroupFloor, GroupSums, Grouping};
use crate::errors::{Sums, WindowErrors, WrenchErrors, WrenchSums, halves, joined, rotated};
use crate::frames::solved;
use crate::input::TrialFacts;
use crate::measured::{FOURTH_DIFFERENCE, median_scale};
use crate::phase::{Place, places};
use crate::predict::wrenches;
use crate::windows::{RunWindows, stretches, window_residuals};
use crate::{Body, Candidate, CompareError, CompareOptions, TrialInput};
use aloft_body::{Model, Motion, State};
use aloft_regressor::Acting;
use aloft_signal::{Butterworth, LowPass};
use nalgebra::{DMatrix, DVector, Isometry3, UnitQuaternion, Vector6};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

/// Errors that noise alone makes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NoiseFloor {
    /// On frames in contact, noise of plates included.
    pub contact: WrenchErrors,
    /// On frames in flight.
    pub flight: WrenchErrors,
    /// Over weak windows in contact, noise of plates included.
    pub contact_weak: WindowErrors,
    /// Over weak windows in flight.
    pub flight_weak: WindowErrors,
    /// In every group of the breakdown.
    #[serde(default)]
    pub groups: Vec<GroupFloor>,
}

/// Filters a motion as the motion of the comparison was filtered; `None` where that fails.
pub type Smooth<'a> = &'a (dyn Fn(&Motion) -> Option<Motion> + Sync);

/// What noise made of the frames and windows of one trial.
#[derive(Debug, Clone, Default)]
pub(crate) struct TrialFloor {
    frames: Vec<FloorFrame>,
    windows: Vec<FloorWindow>,
}

#[derive(Debug, Clone)]
struct FloorFrame {
    frame: usize,
    contact: bool,
    error: Vector6<f64>,
    rotation: UnitQuaternion<f64>,
}

#[derive(Debug, Clone)]
struct FloorWindow {
    center: usize,
    contact: bool,
    error: Vector6<f64>,
}

impl NoiseFloor {
    /// Over all trials; none without frames.
    pub(crate) fn of(
        parts: &[TrialFloor],
        trials: &[TrialFacts],
        counting: &Counting,
        grouping: &Grouping,
    ) -> Option<Self> {
        let (mut contact, mut flight) = (WrenchSums::default(), WrenchSums::default());
        let (mut contact_weak, mut flight_weak) = (Sums::default(), Sums::default());
        let mut groups = GroupSums::new(grouping);
        for (trial, (facts, part)) in trials.iter().zip(parts).enumerate() {
            let counts = |in_contact: bool| if in_contact { counting.contact(facts) } else { counting.flight(facts) };
            for f in &part.frames {
                if counts(f.contact) {
                    let sums = if f.contact { &mut contact } else { &mut flight };
                    sums.add(&f.error, &f.rotation);
                }
                groups.add_frame(grouping, trial, f.frame, &f.error, &f.rotation);
            }
            for w in &part.windows {
                if counts(w.contact) {
                    let sums = if w.contact { &mut contact_weak } else { &mut flight_weak };
                    sums.add(&w.error);
                }
                groups.add_window(grouping, trial, w.center, &w.error);
            }
        }
        let floor = Self {
            contact: contact.errors(),
            flight: flight.errors(),
            contact_weak: contact_weak.windows(),
            flight_weak: flight_weak.windows(),
            groups: groups.floors(grouping),
        };
        (floor.contact.frames + floor.flight.frames > 0).then_some(floor)
    }
}

/// A coordinate's fourth difference this many standard deviations from zero marks a frame that is not noise.
const STANDS_OUT: f64 = 5.0;

/// Lower triangular root of the covariance of the coordinates' white noise (nv × nv, m and rad), read off a recording before and
/// after its filter; `None` without enough frames.
pub fn noise_root(model: &Model, filtered: &Motion, unfiltered: &Motion) -> Option<DMatrix<f64>> {
    let n = filtered.n_frames();
    let nv = model.nv;
    let mut high = vec![f64::NAN; n * nv];
    for f in (0..n).filter(|&f| filtered.is_valid(f) && unfiltered.is_valid(f)) {
        model.difference(filtered.q(f), unfiltered.q(f), &mut high[f * nv..(f + 1) * nv]);
    }
    let mut rows: Vec<DVector<f64>> = Vec::new();
    for f in 4..n {
        let x = |k: usize, i: usize| high[(f - k) * nv + i];
        let d = DVector::from_fn(nv, |i, _| {
            (x(0, i) - 4.0 * x(1, i) + 6.0 * x(2, i) - 4.0 * x(3, i) + x(4, i)) / FOURTH_DIFFERENCE.sqrt()
        });
        if d.iter().all(|x| x.is_finite()) {
            rows.push(d);
        }
    }
    let scale: Vec<f64> =
        (0..nv).map(|i| median_scale(&mut rows.iter().map(|d| d[i].abs()).collect::<Vec<_>>())).collect();
    rows.retain(|d| d.iter().zip(&scale).all(|(x, s)| x.abs() <= STANDS_OUT * s));
    if rows.len() < 2 * nv {
        return None;
    }
    let mut covariance = DMatrix::zeros(nv, nv);
    for d in &rows {
        covariance.ger(1.0 / rows.len() as f64, d, d, 1.0);
    }
    for i in 0..nv {
        covariance[(i, i)] += 1e-6 * scale[i] * scale[i] + f64::MIN_POSITIVE;
    }
    covariance.cholesky().map(|c| c.l())
}

/// Draws noise for one trial and adds what it does to the wrench of the first model.
pub(crate) fn trial_floor(
    body: &Body<'_>,
    candidate: &Candidate,
    index: usize,
    input: &TrialInput<'_>,
    filter: Option<LowPass>,
    smooth: Smooth<'_>,
    options: &CompareOptions,
) -> Result<TrialFloor, CompareError> {
    let mut out = TrialFloor::default();
    let clean = input.motion;
    let Some(root) = input.unfiltered.and_then(|raw| noise_root(body.model, clean, raw)) else { return Ok(out) };
    let Some(base_line) = smooth(clean) else { return Ok(out) };
    let clean_windows = windows(body, candidate, index, input, clean, None, options)?;
    let calm = calm_frames(body, candidate, index, input, &base_line, options);
    let mut rng = ChaCha8Rng::seed_from_u64(options.seed);
    rng.set_stream(index as u64);
    for _ in 0..options.noise_draws {
        let noisy = with_noise(body, clean, &root, &mut rng);
        let plates = plate_noise(input, clean, &mut rng);
        let noisy_windows = windows(body, candidate, index, input, &noisy, plates.as_deref(), options)?;
        add_windows(&mut out, &clean_windows, &noisy_windows);
        let Some(noisy) = smooth(&noisy) else { continue };
        let filtered_plates = plates.map(|p| low_passed(p, clean.rate_hz, filter));
        add_frames(&mut out, body, candidate, index, &calm, &noisy, filtered_plates.as_deref());
    }
    Ok(out)
}

fn with_noise(body: &Body<'_>, clean: &Motion, root: &DMatrix<f64>, rng: &mut ChaCha8Rng) -> Motion {
    let nq = clean.nq;
    let mut q = clean.q.clone();
    for f in 0..clean.n_frames() {
        let drawn = DVector::from_fn(root.nrows(), |_, _| StandardNormal.sample(rng));
        if clean.is_valid(f) {
            let step: DVector<f64> = root * drawn;
            body.model.integrate(clean.q(f), step.as_slice(), &mut q[f * nq..(f + 1) * nq]);
        }
    }
    Motion { trial: clean.trial.clone(), rate_hz: clean.rate_hz, nq, nv: clean.nv, q, ..Motion::default() }
}

/// White noise of the plates at the frame rate (what is above half of it was filtered away).
fn plate_noise(input: &TrialInput<'_>, clean: &Motion, rng: &mut ChaCha8Rng) -> Option<Vec<Vector6<f64>>> {
    let density = input.measured?.noise_density;
    let sd = density.map(|d| (0.5 * clean.rate_hz * d).sqrt());
    Some(
        (0..clean.n_frames())
            .map(|_| {
                sd.map(|s: f64| -> f64 {
                    let drawn: f64 = StandardNormal.sample(rng);
                    s * drawn
                })
            })
            .collect(),
    )
}

fn low_passed(series: Vec<Vector6<f64>>, rate_hz: f64, filter: Option<LowPass>) -> Vec<Vector6<f64>> {
    let Some(Ok(filter)) = filter.map(|spec| Butterworth::design(spec, rate_hz)) else { return series };
    let mut flat: Vec<f64> = series.iter().flat_map(|w| <[f64; 6]>::from(*w)).collect();
    filter.filtfilt_interleaved(&mut flat, 6);
    flat.chunks_exact(6).map(Vector6::from_column_slice).collect()
}

/// A frame that counts, without noise.
struct CalmFrame {
    frame: usize,
    place: Place,
    /// Pose of the root.
    pose: Isometry3<f64>,
    /// Wrench that the model predicts, root axes.
    wrench: Vector6<f64>,
}

/// Frames in which a motion has derivatives.
fn moving(motion: &Motion, frames: impl Iterator<Item = usize>) -> Vec<usize> {
    let finite = |f: usize| [motion.q(f), motion.v(f), motion.a(f)].iter().all(|s| s.iter().all(|x| x.is_finite()));
    frames.filter(|&f| finite(f)).collect()
}

/// Parameters of the candidate for a trial, as one column.
fn column(candidate: &Candidate, index: usize) -> DMatrix<f64> {
    let phi = candidate.parameters(index);
    DMatrix::from_column_slice(phi.len(), 1, phi.as_slice())
}

fn calm_frames(
    body: &Body<'_>,
    candidate: &Candidate,
    index: usize,
    input: &TrialInput<'_>,
    motion: &Motion,
    options: &CompareOptions,
) -> Vec<CalmFrame> {
    let filtered = input.measured.map(|m| m.filtered.as_slice());
    let places = places(
        motion.n_frames(),
        motion.rate_hz,
        input.flights,
        |f| solved(input, f),
        |f| crate::frames::complete(input, filtered, f).is_some(),
        options,
    );
    let frames = moving(motion, (0..places.len()).filter(|&f| places[f].is_some()));
    let wrench = wrenches(body, motion, &frames, &column(candidate, index));
    let mut state = State::new(body.model);
    let calm = |(&frame, &wrench): (&usize, &Vector6<f64>)| {
        let place = places[frame]?;
        state.forward_position(body.model, motion.q(frame));
        Some(CalmFrame { frame, place, pose: state.world_from_link[0], wrench })
    };
    frames.iter().zip(wrench.iter().flatten()).filter_map(calm).collect()
}

fn add_frames(
    out: &mut TrialFloor,
    body: &Body<'_>,
    candidate: &Candidate,
    index: usize,
    calm: &[CalmFrame],
    noisy: &Motion,
    plates: Option<&[Vector6<f64>]>,
) {
    let frames = moving(noisy, calm.iter().map(|c| c.frame));
    let wrench = wrenches(body, noisy, &frames, &column(candidate, index));
    let mut calm = calm.iter();
    for (&f, noisy) in frames.iter().zip(wrench.iter().flatten()) {
        let Some(CalmFrame { place, pose, wrench, .. }) = calm.find(|c| c.frame == f) else { continue };
        let mut e = noisy - wrench;
        let contact = place.phase.is_contact();
        if contact && let Some(plates) = plates {
            // moments of the plates' noise about the root origin
            let (force, moment) = halves(&plates[f]);
            let about = joined(&force, &(moment - pose.translation.vector.cross(&force)));
            let noise = rotated(&about, &pose.rotation.inverse());
            if noise.iter().all(|x| x.is_finite()) {
                e -= noise;
            }
        }
        out.frames.push(FloorFrame { frame: f, contact, error: e, rotation: pose.rotation });
    }
}

/// Windows of every run of a motion, and whether the run is a flight.
fn windows(
    body: &Body<'_>,
    candidate: &Candidate,
    index: usize,
    input: &TrialInput<'_>,
    motion: &Motion,
    plates: Option<&[Vector6<f64>]>,
    options: &CompareOptions,
) -> Result<Vec<(bool, RunWindows)>, CompareError> {
    let clean = input.motion;
    let silent = vec![Vector6::zeros(); clean.n_frames()];
    let phi = [candidate.parameters(index)];
    let none = [DVector::zeros(0)];
    let acting = Acting { measured: Some(plates.unwrap_or(&silent)), effects: None };
    let (contact, flights) = stretches(input, clean, options);
    let mut out = Vec::with_capacity(contact.len() + flights.len());
    for (runs, flying) in [(contact, false), (flights, true)] {
        for (i, run) in runs.iter().enumerate() {
            out.push((flying, window_residuals(body, motion, i, run, flying, acting, options, &phi, &none)?));
        }
    }
    Ok(out)
}

fn add_windows(out: &mut TrialFloor, plain: &[(bool, RunWindows)], noisy: &[(bool, RunWindows)]) {
    for ((flying, plain), (_, noisy)) in plain.iter().zip(noisy) {
        for ((a, b), &center) in plain.residual[0].iter().zip(&noisy.residual[0]).zip(&plain.centers) {
            out.windows.push(FloorWindow { center, contact: !flying, error: b - a });
        }
    }
}
