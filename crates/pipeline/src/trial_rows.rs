//! Everything that the rows of one trial are made from: motion, flights, contact stretches, plates,
//! and the unit wrenches of the model's effects.

use crate::factors::FactorsAndRemarks;
use crate::results::Results;
use crate::stages::filter::low_pass;
use crate::stages::ik::SEGMENTS_FILE;
use crate::stages::regressor::MATRIX_SEED;
use crate::stages::robot::RobotErrors;
use aloft_body::{BaseParameters, Motion, Phi, Subject};
use aloft_effects::{EffectInstance, PlateSeries, Scene, Span, TrialMotion, columns_about};
use aloft_flight::{FlightReport, plate_wrench_at_marker_rate, total_wrench};
use aloft_ik::Segments;
use aloft_regressor::weak_windows::force_scale_n;
use aloft_regressor::{CoordinateNoise, EffectColumns, Factor, RegressorError, Stretch, StretchKind};
use aloft_study::calendar::Calendar;
use aloft_study::config::FilterConfig;
use aloft_study::effects::{KnownEffects, ModelEffects};
use aloft_trial::Trial;
use aloft_workspace::error::StageFailure;
use aloft_workspace::json::read_json_if_there;
use nalgebra::{DMatrix, Vector3, Vector6};
use std::sync::Arc;

/// Contact stretches that are completely measured by plates (`covered`): between flights (50 ms
/// away from them), loaded with at least a fifth of body weight.
pub fn contact_stretches(
    trial: &Trial,
    flights: &FlightReport,
    motion: &Motion,
    force_z: &[f64],
    weight_n: f64,
    covered: &[bool],
) -> Vec<Stretch> {
    let n = motion.n_frames();
    let edge = (0.05 * motion.rate_hz).ceil() as usize;
    let shortest = (0.2 * motion.rate_hz) as usize;
    let near_flight = |f: usize| flights.flights.iter().any(|x| f + edge >= x.start && f < x.end + edge);
    let usable = |f: usize| {
        motion.is_valid(f)
            && !near_flight(f)
            && force_z.get(f).is_some_and(|z| *z > 0.2 * weight_n)
            && covered.get(f).copied().unwrap_or(false)
    };
    let mut out = Vec::new();
    let mut start = None;
    for f in 0..=n {
        let ok = f < n && usable(f);
        match (start, ok) {
            (None, true) => start = Some(f),
            (Some(s), false) => {
                if f - s >= shortest {
                    out.push(Stretch::contact(trial.name.clone(), out.len(), s, f));
                }
                start = None;
            }
            _ => {}
        }
    }
    out
}

/// Unit wrenches of the model's effects in every frame of a trial; none for a model without
/// effects.
pub fn effect_columns(effects: &ModelEffects, rows: &TrialRows) -> Result<Option<EffectColumns>, StageFailure> {
    effect_columns_along(effects, rows, &rows.motion)
}

/// The same along another motion of the same frames, for example one with errors.
pub fn effect_columns_along(
    effects: &ModelEffects,
    rows: &TrialRows,
    motion: &Motion,
) -> Result<Option<EffectColumns>, StageFailure> {
    if effects.model.is_empty() {
        return Ok(None);
    }
    let scene = Scene::new(&rows.subject.model, &rows.subject.prior_phi(), &rows.plate_centres_m);
    let known = KnownEffects::of(&effects.own, &scene)?;
    // a trial with plates is covered completely, so that the comparison also sees the effect
    // between the stretches
    let everywhere = !rows.plates.is_empty();
    let mut spans: Vec<Span> = Vec::new();
    let mut at = 0;
    let mut flights: Vec<&Stretch> = rows.stretches.iter().filter(|s| s.kind == StretchKind::Flight).collect();
    flights.sort_by_key(|s| s.first_frame);
    for s in flights {
        if everywhere && s.first_frame > at {
            spans.push(Span { first_frame: at, end_frame: s.first_frame, flight: false });
        }
        spans.push(Span { first_frame: s.first_frame, end_frame: s.end_frame, flight: true });
        at = s.end_frame;
    }
    if everywhere && at < motion.n_frames() {
        spans.push(Span { first_frame: at, end_frame: motion.n_frames(), flight: false });
    }
    let trial = TrialMotion { motion, spans: &spans, plates: &rows.plates, session_time_s: rows.session_time_s };
    let base = BaseParameters::of(&rows.subject.model);
    let about = (effects.about.len() == base.len()).then_some((&base, effects.about.as_slice()));
    let mut out = EffectColumns { wrench: vec![DMatrix::zeros(6, 0); motion.n_frames()], ..EffectColumns::none() };
    // effects that refer to the same region share the series of the motion
    for group in effects.model.chunk_by(|a, b| a.volume_m == b.volume_m) {
        let mut scene = scene.clone();
        if let Some((middle, reach)) = group[0].volume_m {
            (scene.volume_centre_m, scene.volume_reach_m) = (middle.into(), reach);
        }
        let choices = group.iter().map(|e| known.choice(&scene, e)).collect::<Result<Vec<_>, _>>()?;
        // laws of joints exert nothing on the body as a whole
        let choices: Vec<_> = choices.into_iter().filter(|c| !c.effect.acts().in_joints()).collect();
        // effects that act only in other trials do not act here
        let acts = |c: &EffectInstance<'_>| vec![c.acts_in(&motion.trial); c.names(&scene).len()];
        let acting: Vec<bool> = choices.iter().flat_map(acts).collect();
        let of_tables = choices.iter().filter(|c| c.effect.about().of_tables && c.trials.is_empty());
        out.of_tables.extend(of_tables.flat_map(|c| c.names(&scene)));
        let found = columns_about(&scene, &trial, &choices, about).map_err(|e| StageFailure::new(e.to_string()))?;
        for (all, own) in out.wrench.iter_mut().zip(&found.wrench) {
            let old = std::mem::replace(all, DMatrix::zeros(0, 0));
            let from = old.ncols();
            let mut wide = old.insert_columns(from, own.ncols(), 0.0);
            for (i, column) in own.column_iter().enumerate().filter(|(i, _)| acting[*i]) {
                wide.set_column(from + i, &column);
            }
            *all = wide;
        }
        let change = |phi: Option<Vec<Phi>>, acts: bool| phi.filter(|_| acts).map(|phi| base.regroup(&phi));
        out.inertia.extend(found.inertia.into_iter().zip(&acting).map(|(phi, acts)| change(phi, *acts)));
        out.names.extend(found.names);
    }
    Ok((!out.names.is_empty()).then_some(out))
}

/// Everything that the rows of one trial are computed from.
pub struct TrialRows {
    /// The recording without its trajectories, with tared plates.
    pub trial: Trial,
    /// The subject.
    pub subject: Subject,
    /// Motion before filtering.
    pub motion: Motion,
    /// Motion after filtering; none where only weak rows are made, which use no filter.
    pub filtered: Option<Motion>,
    /// Flights.
    pub flights: Vec<std::ops::Range<usize>>,
    /// Flights and contact stretches; none for a model that is not the whole body.
    pub stretches: Vec<Stretch>,
    /// Frames in contact whose forces the plates measure completely.
    pub covered: Vec<bool>,
    /// Plate wrench about the world origin at the frames, unfiltered.
    pub wrench: Option<Vec<Vector6<f64>>>,
    /// The same, filtered like the motion; none where the motion is not filtered.
    pub wrench_filtered: Option<Vec<Vector6<f64>>>,
    /// Each plate, unfiltered.
    pub plates: Vec<PlateSeries>,
    /// Centres of the plates, world, m.
    pub plate_centres_m: Vec<Vector3<f64>>,
    /// Seconds from the start of the session to the first frame (0 without plates, where nothing
    /// depends on it).
    pub session_time_s: f64,
    /// Source of that time; none without plates.
    pub calendar: Option<Arc<Calendar>>,
    /// Errors of a robot's sensors; none for a motion from markers.
    pub sensors: Option<RobotErrors>,
    /// The links' own rigid fits, for objects.
    pub segments: Option<Segments>,
}

impl TrialRows {
    /// Loads the results of the earlier stages for a trial. With a filter, the filtered motion is
    /// loaded, too, and plates are filtered like it; the calendar tells when in the session the
    /// trial was recorded (computed only for trials with plates).
    pub fn load(
        results: Results<'_>,
        filter: Option<&FilterConfig>,
        calendar: &dyn Fn() -> Result<Arc<Calendar>, StageFailure>,
        name: &str,
        subject: &Subject,
    ) -> Result<Self, StageFailure> {
        let motion = results.load_motion("ik", name)?;
        let filtered = filter.map(|_| results.load_motion("filter", name)).transpose()?;
        Self::of(results, filter, calendar, name, subject.clone(), motion, filtered)
    }

    /// The same for a given motion, for example one with another geometry; flights and plates are
    /// those of the trial.
    pub fn of(
        results: Results<'_>,
        filter: Option<&FilterConfig>,
        calendar: &dyn Fn() -> Result<Arc<Calendar>, StageFailure>,
        name: &str,
        subject: Subject,
        motion: Motion,
        filtered: Option<Motion>,
    ) -> Result<Self, StageFailure> {
        let mut flights = results.load_flights(name)?;
        let whole = subject.model.is_whole();
        if !whole {
            // stretches without load served the tare; no equation of the whole body holds in them
            flights.flights.clear();
        }
        let trial = results.load_tared_plates(name)?;
        let mut stretches: Vec<Stretch> =
            flights.flights.iter().enumerate().map(|(i, f)| Stretch::flight(name, i, f.start, f.end)).collect();
        let covered = results.load_coverage(name)?.mask();
        let (mut wrench, mut wrench_filtered) = (None, None);
        let mut plates = Vec::new();
        let plate_centres_m = trial
            .plates
            .iter()
            .map(|p| p.corners_m.iter().sum::<Vector3<f64>>() / p.corners_m.len().max(1) as f64)
            .collect();
        if !trial.plates.is_empty() {
            let fail = |e: aloft_flight::FlightError| StageFailure::new(e.to_string());
            let each = plate_wrench_at_marker_rate(&trial, None).map_err(fail)?;
            let raw = total_wrench(&each);
            plates = each.into_iter().map(|p| PlateSeries { force_n: p.force_n, moment_nm: p.moment_nm }).collect();
            let weight_n = force_scale_n(subject.facts.mass_kg, subject.model.gravity_mps2.norm());
            let z: Vec<f64> = raw.force_n.iter().map(|f| f.z).collect();
            if whole {
                stretches.extend(contact_stretches(&trial, &flights, &motion, &z, weight_n, &covered));
            }
            let join = |w: &aloft_flight::FrameWrench| {
                w.force_n.iter().zip(&w.moment_nm).map(|(f, m)| Vector6::new(f.x, f.y, f.z, m.x, m.y, m.z)).collect()
            };
            wrench = Some(join(&raw));
            if let Some(filter) = filter {
                let each = plate_wrench_at_marker_rate(&trial, Some(low_pass(filter))).map_err(fail)?;
                wrench_filtered = Some(join(&total_wrench(&each)));
            }
        }
        let flights = flights.flights.iter().map(aloft_flight::Flight::frames).collect();
        let calendar = if plates.is_empty() { None } else { Some(calendar()?) };
        let session_time_s = calendar.as_ref().map_or(0.0, |c| c.start_s(name));
        let sensors = RobotErrors::load(results, &motion)?;
        let segments = read_json_if_there(&results.place("ik", name)?.join(SEGMENTS_FILE))?;
        Ok(Self {
            sensors,
            segments,
            trial,
            subject,
            motion,
            filtered,
            flights,
            stretches,
            covered,
            wrench,
            wrench_filtered,
            plates,
            plate_centres_m,
            session_time_s,
            calendar,
        })
    }
}

impl TrialRows {
    /// The motion with drawn errors of a robot's sensors, or of an object's markers, added and
    /// subtracted; none for people.
    ///
    /// # Errors
    /// [`StageFailure`] if the noise does not fit the model.
    pub fn disturbed(&self, draws: usize) -> Result<Vec<[Motion; 2]>, StageFailure> {
        if let Some(sensors) = &self.sensors {
            return Ok(sensors.pairs(&self.motion, MATRIX_SEED, draws));
        }
        let Some(segments) = &self.segments else { return Ok(Vec::new()) };
        let noise = CoordinateNoise::Markers { markers: &self.subject.markers, sd_m: segments.sd_m };
        aloft_regressor::disturbed(&self.subject.model, &self.motion, &self.stretches, &noise, draws)
            .map_err(|e| StageFailure::new(e.to_string()))
    }
}

/// Makes a factor of every stretch; stretches that are too short are left out with a remark.
pub(crate) fn each_stretch(
    rows: &TrialRows,
    mut factor_of: impl FnMut(&Stretch) -> Result<Factor, RegressorError>,
) -> Result<FactorsAndRemarks, StageFailure> {
    let (mut factors, mut remarks) = (Vec::new(), Vec::new());
    for stretch in &rows.stretches {
        match factor_of(stretch) {
            Ok(factor) => factors.push((stretch.clone(), factor)),
            Err(RegressorError::TooShort { .. }) => remarks.push(format!(
                "{:?} {} (frames {} to {}) is too short for rows",
                stretch.kind, stretch.index, stretch.first_frame, stretch.end_frame
            )),
            Err(e) => return Err(StageFailure::new(e.to_string())),
        }
    }
    Ok((factors, remarks))
}
