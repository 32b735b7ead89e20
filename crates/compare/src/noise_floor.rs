//! The noise floor: the held-out error over weak windows that a perfect model would leave on these
//! recordings. Every noise floor shown by the program is this number.
//!
//! A perfect model has the body's true parameters, its true geometry and every force that acts; its
//! remaining error is the error of the measurement. Marker errors
//! ([`PoseErrors`](crate::PoseErrors): camera noise and soft tissue, as far as markers of a link
//! move relative to each other) are drawn, added to the motion through inverse kinematics, and
//! processed like the data: the same windows, for frames the same filter and derivatives. Noise and
//! drift of the plates likewise, from [`Measured::noise_density`](crate::Measured::noise_density)
//! and [`PlateDrift`](crate::PlateDrift); where a constant is subtracted from the recording
//! ([`RecordingOffset`](crate::RecordingOffset)), one is subtracted here. One draw is the
//! difference of the wrenches with and without errors, from one model's parameters. The floor is
//! the geometric mean of the root mean squares of the draws, and its interval is the range of the
//! error of a single perfect model.
//!
//! Only marker errors enter, no residual wrench, so that an effect missing from the model cannot
//! raise the floor and so remain undetected.
//!
//! Not included: movement common to the markers of a link relative to the bone, wrong joint
//! centres, errors of the identified parameters. They count as explainable.
//!
//! Without marker errors, the white noise of the coordinates is estimated from the motion: the
//! difference of unfiltered and filtered coordinates, in the tangent space of the filtered pose, is
//! differenced four times. The result lies near half the frame rate, where body motion contributes
//! nothing, and for white noise has 70 times its variance (Σ binomial(4, k)²). Its covariance over
//! all coordinates, without outlying frames, is used for the drawn noise. If the recordings were
//! already smoothed, this floor is too low.

use crate::CompareError;
use crate::breakdown::{Counting, Group, GroupFloor, GroupSums, Grouping};
use crate::errors::{MOMENT_LEVER_M, Sums, WindowErrors, WrenchErrors, WrenchSums, halves, joined, rotated};
use crate::frames::solved;
use crate::input::{Body, Candidate, CompareOptions, OtherGeometry, TrialFacts, TrialInput};
use crate::measured::{FOURTH_DIFFERENCE, median_scale};
use crate::offset::sought;
use crate::phase::{Place, places};
use crate::predict::wrenches;
use crate::trial_draws::{DrawnWindow, TrialDraws, mean_change};
use crate::windows::{about, stretches, windows_of};
use aloft_body::{Model, Motion, Phi, State};
use aloft_regressor::{Acting, BodyWindows, RegressorError, body_windows, carried};
use aloft_signal::{Butterworth, DesignError, LowPass};
use nalgebra::{DMatrix, DVector, Isometry3, Matrix6, UnitQuaternion, Vector3, Vector6};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// The floor over the windows of one kind of motion.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Floor {
    /// [`WindowErrors::size`] of the error that a perfect model would leave, N: force, and moment
    /// over a lever of 0.1 m. The geometric mean over draws: when a limb is nearly straight a few
    /// draws are large and would dominate a mean of squares.
    pub noise_floor: f64,
    /// The error of a perfect model lies in this interval in 95 of 100 sets of recordings like
    /// these, N; none with a single draw.
    pub ci95: Option<[f64; 2]>,
    /// Floor of the force alone: root mean square of its length, N.
    pub force_n: f64,
    /// Floor of the moment alone, N·m.
    pub moment_nm: f64,
    /// Number of draws.
    pub draws: usize,
    /// Number of windows in one draw.
    pub windows: usize,
}

impl Floor {
    /// From the sums of each draw, and [`CompareOptions::floor_spread`].
    fn of(draws: &[Sums], spread: f64) -> Option<Self> {
        let mut all = Sums::default();
        draws.iter().for_each(|s| all.merge(s));
        if all.n == 0 {
            return None;
        }
        let each: Vec<WindowErrors> = draws.iter().filter(|s| s.n > 0).map(Sums::windows).collect();
        let n = each.len() as f64;
        let middle = |of: &dyn Fn(&WindowErrors) -> f64| (each.iter().map(|e| of(e).ln()).sum::<f64>() / n).exp();
        let noise_floor = middle(&WindowErrors::size);
        let logs: Vec<f64> = each.iter().map(|e| e.size().ln()).collect();
        // prediction interval of a new set of recordings given the mean of n of them
        let (_, reach) = aloft_signal::one_more(&logs, spread)?;
        let reach = reach.exp();
        let ci95 = reach.is_finite().then(|| [noise_floor / reach, noise_floor * reach]);
        Some(Self {
            noise_floor,
            ci95,
            force_n: middle(&|e| e.force_n.norm_rms()),
            moment_nm: middle(&|e| e.moment_nm.norm_rms()),
            draws: each.len(),
            windows: all.n / each.len(),
        })
    }
}

/// Errors that a perfect model would leave because of markers and plates.
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
    /// The floor in contact: one number with its interval; none without windows.
    #[serde(default)]
    pub contact_floor: Option<Floor>,
    /// The floor in flight.
    #[serde(default)]
    pub flight_floor: Option<Floor>,
    /// In every group of the breakdown.
    #[serde(default)]
    pub groups: Vec<GroupFloor>,
    /// The draws, trial by trial, errors of the geometry included: in `noise_floor.json` of the
    /// stage only.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub draws: Vec<TrialDraws>,
}

/// Share of a mean square not explained by the floor.
pub(crate) fn explainable(size: f64, floor: f64) -> f64 {
    if size > 0.0 { (1.0 - (floor / size).powi(2)).max(0.0) } else { 0.0 }
}

impl Group {
    /// The floor of this group.
    pub fn floor<'a>(&self, floor: Option<&'a NoiseFloor>) -> Option<&'a GroupFloor> {
        floor?.groups.iter().find(|f| f.by == self.by && f.name == self.name)
    }
    /// Share of the mean square error not explained by noise, on frames and over windows; none
    /// where the noise is unknown.
    pub fn explainable(&self, floor: Option<&NoiseFloor>) -> (Option<f64>, Option<f64>) {
        let Some(f) = self.floor(floor) else { return (None, None) };
        let share = |n: usize, noise: usize, size: f64, by: f64| (n > 0 && noise > 0).then(|| explainable(size, by));
        (
            share(self.errors.frames, f.errors.frames, self.errors.size(), f.errors.size()),
            share(self.windows.windows, f.windows.windows, self.windows.size(), f.windows.size()),
        )
    }
}

/// Filters a motion as the motion of the comparison was filtered; the reason where that fails.
pub type Smooth<'a> = &'a (dyn Fn(&Motion) -> Result<Motion, String> + Sync);

/// Effect of the noise on the frames and windows of one trial.
#[derive(Debug, Clone, Default)]
pub(crate) struct TrialFloor {
    frames: Vec<FloorFrame>,
    windows: Vec<DrawnWindow>,
    /// For each draw of the geometry its errors in the windows, in their order.
    geometry: Vec<Vec<Vector6<f64>>>,
    /// For each draw of the geometry the mean change of every joint coordinate.
    zeros: Vec<Vec<f32>>,
}

#[derive(Debug, Clone)]
struct FloorFrame {
    frame: usize,
    contact: bool,
    error: Vector6<f64>,
    rotation: UnitQuaternion<f64>,
}

impl NoiseFloor {
    /// Over all trials; none without frames.
    pub(crate) fn of(
        parts: &[TrialFloor],
        trials: &[TrialFacts],
        counting: &Counting,
        grouping: &Grouping,
        spread: f64,
    ) -> Option<Self> {
        let (mut contact, mut flight) = (WrenchSums::default(), WrenchSums::default());
        let (mut contact_weak, mut flight_weak): (Vec<Sums>, Vec<Sums>) = (Vec::new(), Vec::new());
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
            // contact that is not held out is drawn because it identifies; no error of it is
            // reported
            for w in part.windows.iter().filter(|w| !w.contact || facts.held_out_contact) {
                if counts(w.contact) {
                    let sums = if w.contact { &mut contact_weak } else { &mut flight_weak };
                    if sums.len() <= w.draw {
                        sums.resize(w.draw + 1, Sums::default());
                    }
                    sums[w.draw].add(&w.error);
                }
                groups.add_window(grouping, trial, w.centre, &w.error);
            }
        }
        let total = |draws: &[Sums]| {
            let mut all = Sums::default();
            draws.iter().for_each(|s| all.merge(s));
            all.windows()
        };
        let floor = Self {
            contact: contact.errors(),
            flight: flight.errors(),
            contact_weak: total(&contact_weak),
            flight_weak: total(&flight_weak),
            contact_floor: Floor::of(&contact_weak, spread),
            flight_floor: Floor::of(&flight_weak, spread),
            groups: groups.floors(grouping),
            draws: trials
                .iter()
                .zip(parts)
                .map(|(facts, part)| TrialDraws::of(facts, &part.windows, &part.geometry, &part.zeros))
                .collect(),
        };
        (floor.contact.frames + floor.flight.frames > 0).then_some(floor)
    }
}

/// Fourth differences beyond this many standard deviations mark a frame as an outlier, not noise.
const STANDS_OUT: f64 = 5.0;

/// Lower triangular root of the covariance of the coordinates' white noise (nv × nv, m and rad),
/// estimated from a recording before and after its filter; `None` without enough frames.
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

/// Draws noise for one trial and accumulates its effect on the wrench of the first model.
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
    let white = match (input.errors, input.unfiltered) {
        (Some(_), _) => None,
        (None, Some(raw)) => noise_root(body.model, clean, raw),
        (None, None) => None,
    };
    if input.errors.is_none() && white.is_none() {
        return Ok(out);
    }
    let phi = links(body, candidate, index);
    let runs = runs(input, clean, options);
    // moments are about a path near the centre of mass, which errors of the markers move: the force
    // of the plates has to act beside it
    let measured = input.measured.map_or_else(|| vec![Vector6::zeros(); clean.n_frames()], |m| m.unfiltered.clone());
    let clean_windows = windows(body, &phi, clean, &runs, &measured, options)?;
    let smooth = |m: &Motion| smooth(m).map_err(|problem| CompareError::Smooth { trial: m.trial.clone(), problem });
    let base_line = smooth(clean)?;
    let calm = calm_frames(body, candidate, index, input, &base_line, options);
    let wanted = |f: usize| runs.iter().any(|(_, run)| run.contains(&f));
    let mut rng = ChaCha8Rng::seed_from_u64(options.seed);
    rng.set_stream(index as u64);
    let drawn = input.errors.map(|errors| {
        let wanted = |draw: u64, f: usize| draw < options.frame_draws as u64 || wanted(f);
        errors.draw_each(clean, &wanted, options.seed, 0..options.noise_draws as u64)
    });
    let mut drawn = drawn.into_iter().flatten();
    for draw in 0..options.noise_draws {
        let filtered_too = draw < options.frame_draws;
        let noisy = match (drawn.next(), &white) {
            (Some(noisy), _) => noisy,
            (None, Some(root)) => with_noise(body, clean, root, &mut rng),
            (None, None) => return Ok(out),
        };
        let plates = plate_noise(input, clean, options.seed, draw as u64, &mut rng);
        let read: Vec<Vector6<f64>> = match &plates {
            Some(noise) => measured.iter().zip(noise).map(|(w, n)| w + n).collect(),
            None => measured.clone(),
        };
        let noisy_windows = windows(body, &phi, &noisy, &runs, &read, options)?;
        let found = differences(&clean_windows, &noisy_windows, sought(input)).into_iter();
        out.windows.extend(found.map(|d| DrawnWindow { draw, centre: d.centre, contact: d.contact, error: d.error }));
        if !filtered_too {
            continue;
        }
        let noisy = smooth(&noisy)?;
        let low_passed = |p| low_passed(p, clean.rate_hz, filter);
        let filtered_plates = plates
            .map(low_passed)
            .transpose()
            .map_err(|e| CompareError::Smooth { trial: clean.trial.clone(), problem: e.to_string() })?;
        let measured = input.measured.map(|m| m.filtered.as_slice());
        add_frames(&mut out, body, candidate, index, &calm, &noisy, measured, filtered_plates.as_deref());
    }
    let others = input.errors.map(|e| e.with_geometry(clean, &wanted)).unwrap_or_default();
    for OtherGeometry { model, motion, overlays } in &others {
        let (phi, prior) = (carried(overlays, &phi), carried(overlays, body.prior));
        let body = Body { model, prior: &prior, ..*body };
        let other = windows(&body, &phi, motion, &runs, &measured, options)?;
        out.geometry.push(differences(&clean_windows, &other, sought(input)).into_iter().map(|d| d.error).collect());
        out.zeros.push(mean_change(body.model, clean, motion, &wanted));
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

/// White noise of the plates at the frame rate (frequencies above half of it were filtered out),
/// and their drift.
fn plate_noise(
    input: &TrialInput<'_>,
    clean: &Motion,
    seed: u64,
    draw: u64,
    rng: &mut ChaCha8Rng,
) -> Option<Vec<Vector6<f64>>> {
    let density = input.measured?.noise_density;
    let sd = density.map(|d| (0.5 * clean.rate_hz * d).sqrt());
    let mut white: Vec<Vector6<f64>> = (0..clean.n_frames())
        .map(|_| {
            sd.map(|s: f64| -> f64 {
                let drawn: f64 = StandardNormal.sample(rng);
                s * drawn
            })
        })
        .collect();
    if let Some(drift) = input.drift {
        let walk = drift.draw(&drift.drawn_variance(seed, draw), clean.n_frames(), clean.rate_hz, rng);
        white.iter_mut().zip(walk).for_each(|(w, d)| *w += d);
    }
    Some(white)
}

fn low_passed(
    series: Vec<Vector6<f64>>,
    rate_hz: f64,
    filter: Option<LowPass>,
) -> Result<Vec<Vector6<f64>>, DesignError> {
    let Some(spec) = filter else { return Ok(series) };
    let filter = Butterworth::design(spec, rate_hz)?;
    let mut flat: Vec<f64> = series.iter().flat_map(|w| <[f64; 6]>::from(*w)).collect();
    filter.filtfilt_interleaved(&mut flat, 6);
    Ok(flat.chunks_exact(6).map(Vector6::from_column_slice).collect())
}

/// A frame that is used, without noise.
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

/// A wrench about the world origin, in the axes of the root and about its origin.
fn in_root(wrench: &Vector6<f64>, root: &Isometry3<f64>) -> Vector6<f64> {
    let (force, moment) = halves(wrench);
    let about = joined(&force, &(moment - root.translation.vector.cross(&force)));
    rotated(&about, &root.rotation.inverse())
}

fn add_frames(
    out: &mut TrialFloor,
    body: &Body<'_>,
    candidate: &Candidate,
    index: usize,
    calm: &[CalmFrame],
    noisy_motion: &Motion,
    measured: Option<&[Vector6<f64>]>,
    plates: Option<&[Vector6<f64>]>,
) {
    let frames = moving(noisy_motion, calm.iter().map(|c| c.frame));
    let wrench = wrenches(body, noisy_motion, &frames, &column(candidate, index));
    let mut state = State::new(body.model);
    let mut calm = calm.iter();
    for (&f, noisy) in frames.iter().zip(wrench.iter().flatten()) {
        let Some(CalmFrame { place, pose, wrench, .. }) = calm.find(|c| c.frame == f) else { continue };
        let mut e = noisy - wrench;
        let contact = place.phase.is_contact();
        if contact && let Some(measured) = measured {
            // the plates' wrench in the axes of the root, which errors of the markers move as well
            state.forward_position(body.model, noisy_motion.q(f));
            let noise = plates.map_or_else(Vector6::zeros, |p| p[f]);
            let change = in_root(&(measured[f] + noise), &state.world_from_link[0]) - in_root(&measured[f], pose);
            if change.iter().all(|x| x.is_finite()) {
                e -= change;
            }
        }
        out.frames.push(FloorFrame { frame: f, contact, error: e, rotation: pose.rotation });
    }
}

/// Link parameters with the candidate's base parameters, near those of the prior: in another
/// geometry, too, they are a body.
fn links(body: &Body<'_>, candidate: &Candidate, index: usize) -> Vec<Phi> {
    let prior = DVector::from_iterator(10 * body.prior.len(), body.prior.iter().flat_map(|p| p.iter().copied()));
    let change = candidate.parameters(index) - body.base.regroup(body.prior);
    let full = prior + &body.base.to_full * change;
    full.as_slice().chunks_exact(10).map(Phi::from_column_slice).collect()
}

/// Runs for windows, with a flag for flights.
fn runs(input: &TrialInput<'_>, motion: &Motion, options: &CompareOptions) -> Vec<(bool, Range<usize>)> {
    let (contact, flights) = stretches(input, motion, options);
    contact.into_iter().map(|r| (false, r)).chain(flights.into_iter().map(|r| (true, r))).collect()
}

/// Windows of every run of a motion.
fn windows(
    body: &Body<'_>,
    phi: &[Phi],
    motion: &Motion,
    runs: &[(bool, Range<usize>)],
    measured: &[Vector6<f64>],
    options: &CompareOptions,
) -> Result<Vec<(bool, BodyWindows)>, CompareError> {
    let acting = Acting { measured: Some(measured), effects: None };
    let mut out = Vec::with_capacity(runs.len());
    for (i, (flying, run)) in runs.iter().enumerate() {
        let Some((stretch, weak)) = windows_of(motion, i, run, *flying, options) else { continue };
        match body_windows(body.model, phi, body.prior, motion, &stretch, acting, &weak) {
            Ok(found) => out.push((*flying, found)),
            Err(RegressorError::TooShort { .. }) => {}
            Err(error) => return Err(error.into()),
        }
    }
    Ok(out)
}

/// What a draw changes in one window.
struct Difference {
    contact: bool,
    centre: usize,
    error: Vector6<f64>,
}

/// What a draw changes in every window; in contact whose offset is estimated, the constant wrench
/// that fits the draw best is subtracted.
fn differences(plain: &[(bool, BodyWindows)], noisy: &[(bool, BodyWindows)], offset: bool) -> Vec<Difference> {
    let mut errors: Vec<(bool, usize, Vector3<f64>, Vector6<f64>)> = Vec::new();
    for ((flying, plain), (_, noisy)) in plain.iter().zip(noisy) {
        for ((a, b), (&centre, path)) in
            plain.wrench.iter().zip(&noisy.wrench).zip(plain.centres.iter().zip(&plain.path))
        {
            errors.push((!flying, centre, *path, b - a));
        }
    }
    let constant = if offset {
        let contact = errors.iter().filter(|e| e.0).map(|(_, _, path, e)| (path, e));
        constant_wrench(contact)
    } else {
        None
    };
    errors
        .into_iter()
        .map(|(contact, centre, path, error)| {
            let off = constant.filter(|_| contact).map_or_else(Vector6::zeros, |w| about(&w, &path));
            Difference { contact, centre, error: error - off }
        })
        .collect()
}

/// Wrench about the world origin whose moments about the paths of the windows fit their errors
/// best, moments over the lever that sizes use.
pub(crate) fn constant_wrench<'a>(
    errors: impl Iterator<Item = (&'a Vector3<f64>, &'a Vector6<f64>)>,
) -> Option<Vector6<f64>> {
    let (mut normal, mut right) = (Matrix6::zeros(), Vector6::zeros());
    let weight = Vector6::from_fn(|i, _| if i < 3 { 1.0 } else { MOMENT_LEVER_M.powi(-2) });
    for (path, e) in errors {
        let mut map = Matrix6::identity();
        map.fixed_view_mut::<3, 3>(3, 0).copy_from(&-path.cross_matrix());
        let weighted = map.transpose() * Matrix6::from_diagonal(&weight);
        normal += weighted * map;
        right += weighted * e;
    }
    normal.cholesky().map(|c| c.solve(&right))
}
