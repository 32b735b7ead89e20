//! Predicted and measured wrench, frame by frame, in root axes about the root origin.

use crate::errors::{WrenchSums, halves, joined, rotated};
use crate::offset::{OffsetSamples, mass_ratio, sought};
use crate::phase::{Place, places};
use crate::predict::wrenches;
use crate::segments::SegmentSums;
use crate::{Body, Candidate, CompareOptions, Phase, RecordingOffset, TrialInput};
use aloft_body::{Phi, State};
use nalgebra::{DMatrix, DVector, Isometry3, Vector3, Vector6};
use serde::{Deserialize, Serialize};

/// Measured and predicted wrench of one trial, for plots: root axes about the root origin, force
/// (N) then moment (N·m).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrialSeries {
    /// Name of the trial.
    pub trial: String,
    /// Time since the first frame, s.
    pub time_s: Vec<f64>,
    /// Phase of the frame; none if the frame is not used.
    pub phase: Vec<Option<Phase>>,
    /// True inside a flight, margins included.
    pub in_flight: Vec<bool>,
    /// Measured by the plates, zero in flight, NaN where the measurement is incomplete. The offset
    /// of an untared recording ([`RecordingOffset`], a different one for each model) is not
    /// subtracted.
    pub measured: Vec<Vector6<f64>>,
    /// Predicted, `predicted[model][frame]`, NaN where the frame has no motion.
    pub predicted: Vec<Vec<Vector6<f64>>>,
    /// Weak windows of the trial: the samples of every held-out error.
    pub windows: Vec<WindowSample>,
}

/// The error of each model in one weak window: `∫ψ (predicted − measured) dt / ∫ψ dt`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct WindowSample {
    /// Time of the middle of the window since the first frame, s.
    #[serde(alias = "center_s")]
    pub centre_s: f64,
    /// True in a flight, false in contact.
    pub in_flight: bool,
    /// `residual[model]`: force (N) and moment (N·m) in world axes, the moment about the path of
    /// the centre of mass, the offset of an untared recording subtracted.
    pub residual: Vec<Vector6<f64>>,
}

/// Kinematic features of a frame.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Features {
    /// Speed of the centre of mass, m/s.
    pub speed: f64,
    /// Acceleration of the centre of mass, m/s².
    pub acceleration: f64,
    /// Angular speed of the root, rad/s.
    pub turning: f64,
    /// Radius of gyration of the links' centres of mass about that of the body, m.
    pub posture: f64,
}

/// A frame that is used.
pub(crate) struct FrameRecord {
    pub frame: usize,
    pub place: Place,
    pub world_from_root: Isometry3<f64>,
    pub features: Features,
    /// Predicted − measured of each model, the recording's offset subtracted.
    pub residual: Vec<Vector6<f64>>,
}

/// All frames of one trial.
pub(crate) struct TrialFrames {
    pub records: Vec<FrameRecord>,
    pub series: TrialSeries,
    pub contact_segments: SegmentSums,
    pub flight_segments: SegmentSums,
    /// Offset of the recording for each model.
    pub offsets: Vec<Option<RecordingOffset>>,
    /// Errors in contact of each model, without subtracting the offset.
    pub contact_as_measured: Vec<WrenchSums>,
}

/// Wrench in world axes about the world origin, transformed to root axes about the root origin.
pub(crate) fn into_root(world: &Vector6<f64>, world_from_root: &Isometry3<f64>) -> Vector6<f64> {
    let (force, moment) = halves(world);
    let moment = moment - world_from_root.translation.vector.cross(&force);
    let turn = world_from_root.rotation.inverse();
    joined(&(turn * force), &(turn * moment))
}

pub(crate) fn solved(input: &TrialInput<'_>, frame: usize) -> bool {
    let m = input.motion;
    m.is_valid(frame) && m.v(frame).iter().chain(m.a(frame)).all(|x| x.is_finite())
}

/// Measured wrench of a frame, if everything that acted was measured. `series` selects the filtered
/// or the unfiltered one.
pub(crate) fn complete<'a>(
    input: &TrialInput<'_>,
    series: Option<&'a [Vector6<f64>]>,
    frame: usize,
) -> Option<&'a Vector6<f64>> {
    let whole = input.complete.is_none_or(|c| c[frame]);
    series.map(|s| &s[frame]).filter(|w| whole && w.iter().all(|x| x.is_finite()))
}

pub(crate) fn trial_frames(
    body: &Body<'_>,
    candidates: &[Candidate],
    index: usize,
    input: &TrialInput<'_>,
    options: &CompareOptions,
) -> TrialFrames {
    let (model, motion) = (body.model, input.motion);
    let n = motion.n_frames();
    let filtered = input.measured.map(|m| m.filtered.as_slice());
    let is_solved: Vec<bool> = (0..n).map(|f| solved(input, f)).collect();
    let measured = |f: usize| complete(input, filtered, f);
    let places = places(n, motion.rate_hz, input.flights, |f| is_solved[f], |f| measured(f).is_some(), options);

    let names = input.effects.map_or(&[][..], |e| &e.names);
    let coefficients: Vec<DVector<f64>> = candidates.iter().map(|c| c.coefficients(index, names)).collect();
    let mut parameters = DMatrix::zeros(body.base.len(), candidates.len());
    for (mut column, c) in parameters.column_iter_mut().zip(candidates) {
        column.copy_from(c.parameters(index));
    }

    let missing = Vector6::repeat(f64::NAN);
    let mut series = TrialSeries {
        trial: motion.trial.clone(),
        time_s: (0..n).map(|f| f as f64 / motion.rate_hz).collect(),
        phase: places.iter().map(|p| p.map(|p| p.phase)).collect(),
        in_flight: (0..n).map(|f| input.flights.iter().any(|g| g.contains(&f))).collect(),
        measured: vec![missing; n],
        predicted: vec![vec![missing; n]; candidates.len()],
        windows: Vec::new(),
    };
    let mut out_records = Vec::with_capacity(places.iter().flatten().count());
    let mut samples = sought(input).then(|| OffsetSamples::new(candidates.len()));
    let ratios: Vec<f64> =
        parameters.row(0).iter().map(|m| mass_ratio(options.mass_kg, *m).unwrap_or(f64::NAN)).collect();
    let mut state = State::new(model);
    let frames: Vec<usize> = (0..n).filter(|&f| is_solved[f]).collect();
    let body_alone = wrenches(body, motion, &frames, &parameters);
    // what the body's inertia changes by in this trial (a load)
    let changes: Vec<(usize, &DVector<f64>)> = input.effects.map_or_else(Vec::new, |e| e.changes().collect());
    let mut changed = DMatrix::zeros(body.base.len(), candidates.len());
    for (mut column, theta) in changed.column_iter_mut().zip(&coefficients) {
        for (e, change) in &changes {
            column.axpy(theta[*e], change, 1.0);
        }
    }
    let loads = if changes.is_empty() { None } else { Some(wrenches(body, motion, &frames, &changed)) };
    for (i, &f) in frames.iter().enumerate() {
        state.forward_acceleration(model, motion.q(f), motion.v(f), motion.a(f));
        let world_from_root = state.world_from_link[0];
        for (predicted, alone) in series.predicted.iter_mut().zip(&body_alone) {
            predicted[f] = alone[i];
        }
        for (predicted, load) in series.predicted.iter_mut().zip(loads.iter().flatten()) {
            predicted[f] += load[i];
        }
        if let Some(effects) = input.effects {
            let unit = input.effects_filtered.map_or(&effects.wrench[f], |filtered| &filtered[f]);
            for (c, theta) in coefficients.iter().enumerate().filter(|(_, t)| t.iter().any(|x| *x != 0.0)) {
                let world: Vector6<f64> = (unit * theta).fixed_rows::<6>(0).into();
                // without columns the effect is unknown and the frame is skipped
                if world.iter().all(|x| x.is_finite()) {
                    series.predicted[c][f] -= into_root(&world, &world_from_root);
                }
            }
        }
        let in_root = if series.in_flight[f] {
            Vector6::zeros()
        } else {
            measured(f).map_or(missing, |w| into_root(w, &world_from_root))
        };
        series.measured[f] = in_root;
        let Some(place) = places[f] else { continue };
        let residual: Vec<Vector6<f64>> = series.predicted.iter().map(|p| p[f] - in_root).collect();
        if let Some(samples) = samples.as_mut().filter(|_| place.phase.is_contact()) {
            let excess = residual.iter().zip(&body_alone).zip(&ratios).map(|((e, alone), ratio)| {
                let to_known_mass = alone[i] * (ratio - 1.0);
                -rotated(&(e + to_known_mass), &world_from_root.rotation)
            });
            samples.add(world_from_root.translation.vector, excess);
        }
        out_records.push(FrameRecord {
            frame: f,
            place,
            world_from_root,
            features: Features {
                speed: state.centre_of_mass_velocity(body.prior).norm(),
                acceleration: centre_of_mass_acceleration(&state, body.prior).norm(),
                turning: state.velocity[0].fixed_rows::<3>(3).norm(),
                posture: radius_of_gyration(&state, body.prior),
            },
            residual,
        });
    }
    let mut contact_as_measured = vec![WrenchSums::default(); candidates.len()];
    for r in out_records.iter().filter(|r| r.place.phase.is_contact()) {
        for (sums, e) in contact_as_measured.iter_mut().zip(&r.residual) {
            sums.add(e, &r.world_from_root.rotation);
        }
    }
    let mass_kg = options.mass_kg.unwrap_or_else(|| body.prior.iter().map(|p| p[0]).sum());
    let weight_n = mass_kg * model.gravity_mps2.norm();
    let offsets = samples.map_or_else(
        || vec![None; candidates.len()],
        |s| s.offsets(motion.rate_hz, input.offset_range.as_ref(), weight_n),
    );
    take_off(&mut out_records, &offsets);
    let [contact_segments, flight_segments] = segments(body, candidates.len(), input, &out_records);
    TrialFrames { records: out_records, series, contact_segments, flight_segments, offsets, contact_as_measured }
}

/// Acceleration of the whole body's centre of mass, m/s², world axes.
fn centre_of_mass_acceleration(state: &State, prior: &[Phi]) -> Vector3<f64> {
    let mass: f64 = prior.iter().map(|p| p[0]).sum();
    // a(p) = a(o) + (matrix) p, so the first moments give the sum over a link's mass
    let of_link = |(i, p): (usize, &Phi)| {
        let m = p[0];
        let place = if m.abs() > 1e-12 { Vector3::new(p[1], p[2], p[3]) / m } else { Vector3::zeros() };
        state.point_acceleration_in_world(i, &place) * m
    };
    prior.iter().enumerate().map(of_link).sum::<Vector3<f64>>() / mass
}

/// √(Σ m |c − c₀|² / Σ m) over the links' centres of mass c, m.
fn radius_of_gyration(state: &State, prior: &[Phi]) -> f64 {
    let (mass, centre) = state.centre_of_mass(prior);
    let of_link = |(i, p): (usize, &Phi)| {
        let m = p[0];
        if m <= 0.0 {
            return 0.0;
        }
        m * (state.point_in_world(i, &(Vector3::new(p[1], p[2], p[3]) / m)) - centre).norm_squared()
    };
    (prior.iter().enumerate().map(of_link).sum::<f64>() / mass).max(0.0).sqrt()
}

/// Subtracts the offset from the measured wrench, which adds it to the residuals.
fn take_off(records: &mut [FrameRecord], offsets: &[Option<RecordingOffset>]) {
    for r in records.iter_mut().filter(|r| r.place.phase.is_contact()) {
        for (e, offset) in r.residual.iter_mut().zip(offsets) {
            if let Some(offset) = offset {
                *e += into_root(&offset.wrench(), &r.world_from_root);
            }
        }
    }
}

/// Projects the error on each link's columns, `[contact, flight]`.
fn segments(body: &Body<'_>, models: usize, input: &TrialInput<'_>, records: &[FrameRecord]) -> [SegmentSums; 2] {
    let (model, motion) = (body.model, input.motion);
    let mut contact = SegmentSums::new(model.n_links(), models);
    let mut flight = contact.clone();
    let mut state = State::new(model);
    let mut full = DMatrix::zeros(6, 10 * model.n_links());
    for r in records {
        state.forward_acceleration(model, motion.q(r.frame), motion.v(r.frame), motion.a(r.frame));
        state.base_wrench_regressor(model, &mut full);
        let sums = if r.place.phase.is_contact() { &mut contact } else { &mut flight };
        sums.add(&state, &full, body.prior, &r.residual);
    }
    [contact, flight]
}
