//! `regressor`: one triangular factor a flight and a contact stretch, from weak rows and from the paper's rows.

use crate::graph::{Need, Scope, Stage, StageInputs, StageReport, StageWork, parameters_of, run_of};
use crate::results::Results;
use crate::stages::filter::low_pass;
use aloft_body::{BaseParameters, Motion, Subject};
use aloft_effects::{PlateSeries, Scene, Span, TrialMotion, columns_about};
use aloft_flight::{FlightReport, plate_wrench_at_marker_rate, total_wrench};
use aloft_regressor::weak_rows::force_scale_n;
use aloft_regressor::{
    AccelerationOptions, Acting, Columns, CoordinateNoise, EffectColumns, Factor, Noise, RegressorError, RowKind,
    Slides, Stretch, StretchKind, Tissue, WeakOptions, acceleration_factor, weak_factor, weak_factor_with_tissue,
};
use aloft_study::calendar::Calendar;
use aloft_study::config::{FilterConfig, Rows, Weighting};
use aloft_study::effects::{KnownEffects, ModelEffects};
use aloft_study::subject_session::{Role, SubjectSession, TrialEntry};
use aloft_trial::{SessionSource, Trial};
use aloft_workspace::error::{PipelineError, StageFailure};
use aloft_workspace::table::Table;
use aloft_workspace::workspace::{read_json, write_json};
use nalgebra::{DMatrix, Vector3, Vector6};
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::path::Path;

/// The stage.
pub static STAGE: Stage = Stage {
    name: "regressor",
    version: 3,
    scope: Scope::Trial(&[Role::Identify, Role::Validate]),
    reads: "`Motion`, flights, plates",
    gives: "one triangular factor a flight and contact stretch",
    needs: &[
        Need::Same("import"),
        Need::Same("ik"),
        Need::Same("filter"),
        Need::Same("flight"),
        Need::Once("calibrate"),
        // recording times, for effects that grow over the session
        Need::Every("import", &[Role::Static, Role::Calibration, Role::Identify, Role::Validate]),
    ],
    parameters: parameters_of::<Work>,
    run: run_of::<Work>,
};

/// Parameters of the stage.
#[derive(Debug, Serialize)]
pub struct Params {
    /// Window length of weak rows, s; 0 chooses it from the flight.
    pub window_s: f64,
    /// Weighting of weak rows.
    pub weighting: Weighting,
    /// Slow part of the noise used for whitening.
    pub slow_noise: f64,
    /// White noise of a marker coordinate, m.
    pub marker_sd_m: f64,
    /// Time at both ends of a flight that the paper's rows leave out, s.
    pub margin_s: f64,
    /// Filter for the motion, also applied to the plates.
    pub filter: FilterConfig,
    /// Whether contact is used for identification.
    pub contact: bool,
    /// True for objects, which have no soft tissue.
    pub is_object: bool,
    /// Role of the trial.
    pub role: Option<Role>,
    /// Effects of the model.
    pub effects: ModelEffects,
    /// Order of the session's recordings, if the laboratory lists them.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub recordings: Vec<String>,
}

impl Params {
    /// Parameters for a study; `trial` gives the role.
    pub fn of(session: &SubjectSession, trial: Option<&TrialEntry>) -> Self {
        let regressor = &session.config.regressor;
        Self {
            window_s: regressor.window_s,
            weighting: regressor.weighting,
            slow_noise: regressor.slow_noise,
            marker_sd_m: session.config.ik.marker_sd_m,
            margin_s: session.config.flight.margin_s,
            filter: session.config.filter.clone(),
            contact: session.config.identify.contact,
            is_object: session.object.is_some(),
            role: trial.map(|t| t.role),
            effects: session.model_effects(),
            recordings: session.facts.recordings.clone(),
        }
    }
}

/// Work of the stage.
#[derive(Debug)]
pub struct Work;

impl StageWork for Work {
    type Params = Params;
    fn params(session: &SubjectSession, trial: Option<&TrialEntry>) -> Params {
        Params::of(session, trial)
    }
    fn run(params: &Params, inputs: &StageInputs<'_>) -> Result<StageReport, StageFailure> {
        run(params, inputs)
    }
}

#[derive(Serialize, Deserialize)]
struct FactorHead {
    stretch: Stretch,
    rows: RowKind,
    columns: Columns,
    n_rows: usize,
    n_values: usize,
}

/// Writes `factors.json` and `factors.parquet`.
pub fn save_factors(dir: &Path, factors: &[(Stretch, Factor)]) -> Result<(), PipelineError> {
    let heads: Vec<FactorHead> = factors
        .iter()
        .map(|(stretch, f)| FactorHead {
            stretch: stretch.clone(),
            rows: f.rows,
            columns: f.columns.clone(),
            n_rows: f.n_rows,
            n_values: f.values().len(),
        })
        .collect();
    write_json(&dir.join("factors.json"), &heads)?;
    let mut table = Table::default();
    table.push("value", factors.iter().flat_map(|(_, f)| f.values().iter().copied()).collect());
    table.write(&dir.join("factors.parquet"))
}

/// Reads the stage's files for a trial: each stretch with its factor.
pub fn load_factors(dir: &Path) -> Result<Vec<(Stretch, Factor)>, PipelineError> {
    let heads: Vec<FactorHead> = read_json(&dir.join("factors.json"))?;
    if heads.is_empty() {
        // a table without rows has no columns to read
        return Ok(Vec::new());
    }
    let path = dir.join("factors.parquet");
    let values = Table::read(&path)?.into_columns().into_iter().next().map(|c| c.1).unwrap_or_default();
    let mut at = 0;
    let mut out = Vec::new();
    for head in heads {
        let wrong = |problem: String| PipelineError::Table { path: path.clone(), problem };
        let part = values
            .get(at..at + head.n_values)
            .ok_or_else(|| wrong("fewer values than factors.json says".to_owned()))?;
        at += head.n_values;
        let factor = Factor::from_values(&head.stretch, head.rows, head.columns, head.n_rows, part.to_vec())
            .map_err(|e| wrong(e.to_string()))?;
        out.push((head.stretch, factor));
    }
    Ok(out)
}

#[derive(Serialize, Deserialize)]
struct SlidesHead {
    stretch: Stretch,
    rows: usize,
    draws: usize,
    predicted: f64,
    observed: f64,
}

/// Writes `slides.json` and `slides.parquet`: the effect of soft tissue on the weak rows of each
/// stretch.
fn save_slides(dir: &Path, slides: &[(Stretch, Slides)]) -> Result<(), PipelineError> {
    let heads: Vec<SlidesHead> = slides
        .iter()
        .map(|(stretch, s)| SlidesHead {
            stretch: stretch.clone(),
            rows: s.sums.nrows(),
            draws: s.sums.ncols(),
            predicted: s.predicted,
            observed: s.observed,
        })
        .collect();
    write_json(&dir.join("slides.json"), &heads)?;
    let mut table = Table::default();
    table.push("value", slides.iter().flat_map(|(_, s)| s.sums.iter().copied()).collect());
    table.write(&dir.join("slides.parquet"))
}

/// Reads the stage's slides for a trial of a person; nothing for objects.
pub fn load_slides(dir: &Path) -> Result<Vec<(Stretch, Slides)>, PipelineError> {
    let head = dir.join("slides.json");
    if !head.is_file() {
        return Ok(Vec::new());
    }
    let heads: Vec<SlidesHead> = read_json(&head)?;
    let path = dir.join("slides.parquet");
    let values = Table::read(&path)?.into_columns().into_iter().next().map(|c| c.1).unwrap_or_default();
    let mut at = 0;
    heads
        .into_iter()
        .map(|head| {
            let part = values.get(at..at + head.rows * head.draws).ok_or_else(|| PipelineError::Table {
                path: path.clone(),
                problem: "fewer values than slides.json says".to_owned(),
            })?;
            at += head.rows * head.draws;
            let sums = DMatrix::from_column_slice(head.rows, head.draws, part);
            Ok((head.stretch, Slides { sums, predicted: head.predicted, observed: head.observed }))
        })
        .collect()
}

/// Kind of rows for the word used in the configuration.
pub fn row_kind(rows: Rows) -> RowKind {
    match rows {
        Rows::Acceleration => RowKind::Acceleration,
        Rows::Weak => RowKind::Weak,
    }
}

/// Contact stretches that are completely measured by plates: between flights (50 ms away from
/// them), loaded with at least a fifth of body weight.
pub fn contact_stretches(
    trial: &Trial,
    flights: &FlightReport,
    motion: &Motion,
    force_z: &[f64],
    weight_n: f64,
) -> Vec<Stretch> {
    let n = motion.n_frames();
    let edge = (0.05 * motion.rate_hz).ceil() as usize;
    let shortest = (0.2 * motion.rate_hz) as usize;
    let near_flight = |f: usize| flights.flights.iter().any(|x| f + edge >= x.start && f < x.end + edge);
    let usable =
        |f: usize| motion.is_valid(f) && !near_flight(f) && force_z.get(f).is_some_and(|z| *z > 0.2 * weight_n);
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
    if effects.model.is_empty() {
        return Ok(None);
    }
    let scene = Scene::new(&rows.subject.model, &rows.subject.prior_phi(), &rows.plate_centers_m);
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
    if everywhere && at < rows.motion.n_frames() {
        spans.push(Span { first_frame: at, end_frame: rows.motion.n_frames(), flight: false });
    }
    let trial =
        TrialMotion { motion: &rows.motion, spans: &spans, plates: &rows.plates, session_time_s: rows.session_time_s };
    let base = BaseParameters::of(&rows.subject.model);
    let about = (effects.about.len() == base.len()).then_some((&base, effects.about.as_slice()));
    let mut out = EffectColumns { names: Vec::new(), wrench: vec![DMatrix::zeros(6, 0); rows.motion.n_frames()] };
    for effect in &effects.model {
        let mut scene = scene.clone();
        if let Some((middle, reach)) = effect.volume_m {
            (scene.volume_center_m, scene.volume_reach_m) = (middle.into(), reach);
        }
        let choice = known.choice(&scene, effect)?;
        let found = columns_about(&scene, &trial, &[choice], about).map_err(|e| StageFailure::new(e.to_string()))?;
        // effects that act only in other trials do not act here
        let acts = effect.trials.is_empty() || effect.trials.contains(&rows.motion.trial);
        for (all, own) in out.wrench.iter_mut().zip(&found.wrench) {
            let old = std::mem::replace(all, DMatrix::zeros(0, 0));
            let from = old.ncols();
            let mut wide = old.insert_columns(from, own.ncols(), 0.0);
            if acts {
                wide.columns_mut(from, own.ncols()).copy_from(own);
            }
            *all = wide;
        }
        out.names.extend(found.names);
    }
    Ok(Some(out))
}

/// Everything that the rows of one trial are computed from.
pub struct TrialRows {
    /// The recording without its trajectories, with tared plates.
    pub trial: Trial,
    /// The subject.
    pub subject: Subject,
    /// Motion before filtering.
    pub motion: Motion,
    /// Motion after filtering.
    pub filtered: Motion,
    /// Flights.
    pub flights: Vec<std::ops::Range<usize>>,
    /// Flights and contact stretches.
    pub stretches: Vec<Stretch>,
    /// Plate wrench about the world origin at the frames, unfiltered.
    pub wrench: Option<Vec<Vector6<f64>>>,
    /// The same, filtered like the motion.
    pub wrench_filtered: Option<Vec<Vector6<f64>>>,
    /// Each plate, unfiltered.
    pub plates: Vec<PlateSeries>,
    /// Centres of the plates, world, m.
    pub plate_centers_m: Vec<Vector3<f64>>,
    /// Seconds from the start of the session to the first frame (0 without plates, where nothing depends on it).
    pub session_time_s: f64,
    /// Source of that time; none without plates.
    pub calendar: Option<Calendar>,
}

impl TrialRows {
    /// Loads the results of the earlier stages for a trial. Plates are filtered like the motion;
    /// the calendar tells when in the session the trial was recorded (computed only for trials with
    /// plates).
    pub fn load(
        results: Results<'_>,
        filter: &FilterConfig,
        calendar: &dyn Fn() -> Calendar,
        name: &str,
        subject: &Subject,
    ) -> Result<Self, StageFailure> {
        let motion = results.load_motion("ik", name)?;
        let filtered = results.load_motion("filter", name)?;
        Self::of(results, filter, calendar, name, subject.clone(), motion, filtered)
    }

    /// The same for a given motion, for example one with another geometry; flights and plates are
    /// those of the trial.
    pub fn of(
        results: Results<'_>,
        filter: &FilterConfig,
        calendar: &dyn Fn() -> Calendar,
        name: &str,
        subject: Subject,
        motion: Motion,
        filtered: Motion,
    ) -> Result<Self, StageFailure> {
        let flights = results.load_flights(name)?;
        let trial = results.load_tared_plates(name)?;
        let mut stretches: Vec<Stretch> =
            flights.flights.iter().enumerate().map(|(i, f)| Stretch::flight(name, i, f.start, f.end)).collect();
        let (mut wrench, mut wrench_filtered) = (None, None);
        let mut plates = Vec::new();
        let plate_centers_m = trial
            .plates
            .iter()
            .map(|p| p.corners_m.iter().sum::<Vector3<f64>>() / p.corners_m.len().max(1) as f64)
            .collect();
        if !trial.plates.is_empty() {
            let fail = |e: aloft_flight::FlightError| StageFailure::new(e.to_string());
            let each = plate_wrench_at_marker_rate(&trial, None).map_err(fail)?;
            let raw = total_wrench(&each);
            plates = each.into_iter().map(|p| PlateSeries { force_n: p.force_n, moment_nm: p.moment_nm }).collect();
            let smooth = total_wrench(&plate_wrench_at_marker_rate(&trial, Some(low_pass(filter))).map_err(fail)?);
            let weight_n = force_scale_n(subject.facts.mass_kg, subject.model.gravity_mps2.norm());
            let z: Vec<f64> = raw.force_n.iter().map(|f| f.z).collect();
            stretches.extend(contact_stretches(&trial, &flights, &motion, &z, weight_n));
            let join = |w: &aloft_flight::FrameWrench| {
                w.force_n.iter().zip(&w.moment_nm).map(|(f, m)| Vector6::new(f.x, f.y, f.z, m.x, m.y, m.z)).collect()
            };
            wrench = Some(join(&raw));
            wrench_filtered = Some(join(&smooth));
        }
        let flights = flights.flights.iter().map(aloft_flight::Flight::frames).collect();
        let calendar = (!plates.is_empty()).then(calendar);
        let session_time_s = calendar.as_ref().map_or(0.0, |c| c.start_s(name));
        Ok(Self {
            trial,
            subject,
            motion,
            filtered,
            flights,
            stretches,
            wrench,
            wrench_filtered,
            plates,
            plate_centers_m,
            session_time_s,
            calendar,
        })
    }
}

/// Factors by stretch, and remarks about them.
pub type FactorsAndRemarks = (Vec<(Stretch, Factor)>, Vec<String>);

/// Factors of every stretch of a trial, from weak rows and from the paper's rows, with remarks.
pub fn factors_of(params: &Params, rows: &TrialRows) -> Result<FactorsAndRemarks, StageFailure> {
    factors_beside(params, rows, &mut Vec::new(), false)
}

/// The same, including the effect of soft tissue on weak rows if `with_tissue` is set.
fn factors_beside(
    params: &Params,
    rows: &TrialRows,
    slides: &mut Vec<(Stretch, Slides)>,
    with_tissue: bool,
) -> Result<FactorsAndRemarks, StageFailure> {
    let subject = &rows.subject;
    let base = BaseParameters::of(&subject.model);
    let prior = subject.prior_phi();
    let weak = weak_options(params.window_s);
    let acceleration = AccelerationOptions { margin_s: params.margin_s, ..AccelerationOptions::default() };
    let effects = effect_columns(&params.effects, rows)?;
    let noise = row_noise(params, subject);
    let mut factors: Vec<(Stretch, Factor)> = Vec::new();
    let mut warnings = Vec::new();
    for stretch in &rows.stretches {
        let acting = Acting { measured: rows.wrench.as_deref(), effects: effects.as_ref() };
        let (model, motion) = (&subject.model, &rows.motion);
        let used = stretch.kind == StretchKind::Flight || params.contact;
        let by_weak = if with_tissue && used {
            let tissue = Tissue::new(&subject.markers, params.marker_sd_m);
            weak_factor_with_tissue(model, &base, &prior, motion, stretch, acting, &weak, noise.as_ref(), &tissue).map(
                |(factor, found)| {
                    slides.push((stretch.clone(), found));
                    factor
                },
            )
        } else {
            weak_factor(model, &base, &prior, motion, stretch, acting, &weak, noise.as_ref())
        };
        let acting = Acting { measured: rows.wrench_filtered.as_deref(), effects: effects.as_ref() };
        let by_paper = acceleration_factor(&subject.model, &base, &rows.filtered, stretch, acting, &acceleration);
        for result in [by_weak, by_paper] {
            match result {
                Ok(factor) => factors.push((stretch.clone(), factor)),
                Err(RegressorError::TooShort { .. }) => {
                    warnings.push(format!(
                        "{:?} {} (frames {} to {}) is too short for rows",
                        stretch.kind, stretch.index, stretch.first_frame, stretch.end_frame
                    ));
                }
                Err(e) => return Err(StageFailure::new(e.to_string())),
            }
        }
    }
    Ok((factors, warnings))
}

/// Settings of weak rows from the pipeline.
pub fn weak_options(window_s: f64) -> WeakOptions {
    WeakOptions { window_s: (window_s > 0.0).then_some(window_s), ..WeakOptions::default() }
}

/// Noise for whitening weak rows, if the pipeline asks for it: marker noise, and a slow part for
/// soft tissue.
pub fn row_noise<'a>(params: &Params, subject: &'a Subject) -> Option<Noise<'a>> {
    (params.weighting == Weighting::Whitened).then(|| Noise {
        coordinates: CoordinateNoise::Markers { markers: &subject.markers, sd_m: params.marker_sd_m },
        slow: params.slow_noise,
        slow_time_s: 0.1,
    })
}

fn run(params: &Params, inputs: &StageInputs<'_>) -> Result<StageReport, StageFailure> {
    let results = inputs.results;
    let calendar = || Calendar::from_order(&params.recordings, inputs.expected(), results.workspace());
    let subject = results.load_subject("calibrate")?;
    let rows = TrialRows::load(results, &params.filter, &calendar, inputs.trial()?, &subject)?;
    let mut slides = Vec::new();
    // only identification uses the slides
    let person = !params.is_object && params.role == Some(Role::Identify);
    let (factors, warnings) = factors_beside(params, &rows, &mut slides, person)?;
    let mut done = StageReport { warnings: warnings.into(), ..StageReport::default() };
    save_factors(inputs.out, &factors)?;
    if person {
        save_slides(inputs.out, &slides)?;
    }
    let count = |kind: RowKind| factors.iter().filter(|(_, f)| f.rows == kind).map(|(_, f)| f.n_rows).sum::<usize>();
    done.note("weak_rows", count(RowKind::Weak));
    done.note("paper_rows", count(RowKind::Acceleration));
    if let Some(calendar) = &rows.calendar {
        done.note("session_time_s", rows.session_time_s);
        done.note("session_time_source", json!(calendar.source));
        // remark on this only if the results depend on it
        if calendar.source == SessionSource::OrderAndLengths && params.effects.recordings.is_some() {
            done.warnings.push(format!("times of the session: {}", calendar.words));
        }
    }
    Ok(done)
}
