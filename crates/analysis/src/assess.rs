//! `parameters --assess`: how far the identified parameters may be trusted, tested on the data at
//! hand.
//!
//! Three questions are answered by computation on the study's own recordings: which estimates other
//! window lengths would have given; whether marker noise biases the estimate (SIMEX); which motion,
//! recorded next, would improve the worst parameters most. This is slower than identification
//! itself and therefore runs on request only; the answer is stored in the workspace and shown with
//! the parameters until they change.

use crate::next_flights::PlanInputs;
use crate::results::{Made, with_results};
use aloft_body::{BaseParameters, Motion, Phi};
use aloft_compare::noise_root;
use aloft_filter::smooth;
use aloft_identify::{
    AdviceOptions, ClusterBy, Estimator, LinkPrior, MotionAdvice, Parameters, Prior, WindowChoice, add_noise,
    choose_window, excitation_advice, point_estimate, simex,
};
use aloft_pipeline::results::Results;
use aloft_pipeline::stages::filter::low_pass;
use aloft_pipeline::stages::identify::{self, estimator, identify_from};
use aloft_pipeline::stages::regressor::weak_options;
use aloft_pipeline::trial_rows::TrialRows;
use aloft_regressor::{
    AccelerationOptions, Acting, CoordinateNoise, Factor, MatrixNoise, RegressorError, Stretch, StretchKind,
    WeakOptions, acceleration_factor, weak_factor, weak_factor_with_noise,
};
use aloft_robot::next::NextFlights;
use aloft_study::commands::command;
use aloft_study::config::{RobotConfig, Rows};
use aloft_study::robot::RobotSetup;
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::error::{PipelineError, StageFailure};
use aloft_workspace::manifest::WHOLE_STUDY;
use aloft_workspace::seal;
use aloft_workspace::workspace::Workspace;
use nalgebra::DMatrix;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Window lengths to try, s; 0 is the default, which depends on the length of each flight.
const WINDOWS_S: [f64; 7] = [0.0, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4];
/// Window length of the rows on which all candidates are judged, s.
const YARDSTICK_S: f64 = 0.25;
/// Variances of the added noise, in units of the noise variance in the data.
const LEVELS: [f64; 4] = [0.0, 0.5, 1.0, 2.0];
/// Random draws per level.
const REPLICATES: usize = 6;
/// Maximum number of flights used for the window and noise trials, evenly sampled: more do not
/// change the answer.
const MOST_FLIGHTS: usize = 24;
/// Number of motions shown.
const MOTIONS: usize = 6;

/// Effect of marker noise on one parameter.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct NoiseBias {
    /// Name.
    pub name: String,
    /// Estimate from the data as recorded.
    pub value: f64,
    /// Bias that the noise causes.
    pub bias: f64,
    /// Standard error of the bias, from the spread among draws.
    pub bias_se: f64,
    /// Standard error of the parameter.
    pub se: f64,
    /// Unit.
    pub unit: String,
}

/// Errors-in-variables analysis for one kind of rows.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct ErrorsInVariables {
    /// `weak` or `paper`.
    pub rows: String,
    /// Estimator.
    pub estimator: String,
    /// Number of flights used.
    pub flights: usize,
    /// Variances of the added noise, in units of the data's own.
    pub levels: Vec<f64>,
    /// Random draws per level.
    pub replicates: usize,
    /// Largest bias of any parameter, in standard errors of that parameter.
    pub largest_in_se: f64,
    /// Parameters whose bias exceeds half a standard error and is significant (twice its own
    /// standard error).
    pub biased: usize,
    /// Every parameter except the mass.
    pub parameters: Vec<NoiseBias>,
    /// Summary in words.
    pub words: String,
}

/// The whole assessment.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Assessment {
    /// Version of this structure.
    pub version: u32,
    /// Hash of the identification that was assessed.
    pub of: String,
    /// Window lengths.
    pub window: Option<WindowChoice>,
    /// Errors in variables, weak rows first.
    pub errors_in_variables: Vec<ErrorsInVariables>,
    /// Kinds of motion, most useful first.
    pub motions: Vec<MotionAdvice>,
    /// Flights for a robot to record next; none for people and objects.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub next_flights: Option<NextFlights>,
    /// What could not be tried, and why.
    pub notes: Vec<String>,
}

fn place(session: &SubjectSession) -> PathBuf {
    session.workspace.join("assessment.json")
}

fn identification(session: &SubjectSession) -> Result<Option<String>, PipelineError> {
    Ok(Workspace::open(&session.workspace).usable("identify", WHOLE_STUDY)?.map(|m| m.output))
}

/// The stored assessment, if it belongs to the present parameters.
pub fn stored(session: &SubjectSession) -> Result<Option<Assessment>, PipelineError> {
    let found: Option<Assessment> = seal::read_if_there(&place(session))?;
    let Some(found) = found else { return Ok(None) };
    Ok((Some(&found.of) == identification(session)?.as_ref()).then_some(found))
}

/// Data of one trial.
struct Recorded {
    rows: TrialRows,
    flights: Vec<Stretch>,
}

/// Data that all trials of the assessment share.
struct Setting<'a> {
    session: &'a SubjectSession,
    recorded: &'a [Recorded],
    base: BaseParameters,
    phi: Vec<Phi>,
    links: LinkPrior,
    prior: Prior,
    mass_kg: f64,
    made: &'a Made<'a>,
    /// Settings of planned flights, as they are now.
    robot: Option<&'a RobotConfig>,
}

/// Tries window lengths, noise levels and motions, and stores the answer in the workspace.
pub fn assess(session: &SubjectSession) -> Result<Assessment, PipelineError> {
    let robot = session.config.robot.as_ref();
    let session = &aloft_pipeline::made::as_made(session)?;
    let of = identification(session)?.ok_or_else(|| {
        PipelineError::request_hint(
            format!("nothing was identified in {}", session.workspace.display()),
            format!("run `{}` first", command(session, "run", None)),
        )
    })?;
    let found = with_results(session, |made| {
        let recorded = load(made)?;
        let Some(first) = recorded.first() else { return Err(StageFailure::new("no trial has a flight")) };
        let subject = &first.rows.subject;
        let base = BaseParameters::of(&subject.model);
        let links = LinkPrior::of_subject(subject).map_err(|e| StageFailure::new(e.to_string()))?;
        let setting = Setting {
            session,
            recorded: &recorded,
            phi: subject.prior_phi(),
            prior: links.base(&base).map_err(|e| StageFailure::new(e.to_string()))?,
            mass_kg: subject.facts.mass_kg,
            base,
            links,
            made,
            robot,
        };
        setting.assess(made.results, of.clone())
    })?;
    if identification(session)?.as_ref() != Some(&found.of) {
        return Err(PipelineError::request("the results changed while they were assessed; assess them again"));
    }
    seal::write_whole(&place(session), &found)?;
    Ok(found)
}

fn load(made: &Made<'_>) -> Result<Vec<Recorded>, StageFailure> {
    let names = made.training();
    let (filter, subject) = (&made.session.config.filter, made.results.load_subject("calibrate")?);
    let all: Vec<Recorded> = names
        .par_iter()
        .map(|name| {
            let rows = TrialRows::load(made.results, Some(filter), &|| made.calendar(), name, &subject)?;
            let flights = rows.stretches.iter().filter(|s| s.kind == StretchKind::Flight).cloned().collect();
            Ok(Recorded { rows, flights })
        })
        .collect::<Result<_, StageFailure>>()?;
    Ok(all.into_iter().filter(|r| !r.flights.is_empty()).collect())
}

/// Takes every k-th flight so that at most `MOST_FLIGHTS` remain.
fn sample(recorded: &[Recorded]) -> Vec<(usize, Stretch)> {
    let all: Vec<(usize, Stretch)> =
        recorded.iter().enumerate().flat_map(|(i, r)| r.flights.iter().map(move |s| (i, s.clone()))).collect();
    let step = all.len().div_ceil(MOST_FLIGHTS).max(1);
    all.into_iter().step_by(step).collect()
}

fn stop(e: impl std::fmt::Display) -> StageFailure {
    StageFailure::new(e.to_string())
}

impl Setting<'_> {
    fn assess(&self, results: Results<'_>, of: String) -> Result<Assessment, StageFailure> {
        let flights = sample(self.recorded);
        let mut notes = Vec::new();
        let window = self.windows(&flights).unwrap_or_else(|f| {
            notes.push(format!("window lengths: {}", f.problem));
            None
        });
        let mut errors_in_variables = Vec::new();
        match self.noise() {
            Some(root) => {
                for rows in Rows::ALL {
                    let Some(parameters) = results.load_parameters(rows)? else { continue };
                    match self.errors_in_variables(rows, &parameters, &flights, &root) {
                        Ok(found) => errors_in_variables.push(found),
                        Err(f) => notes.push(format!("errors in variables, {} rows: {}", rows.word(), f.problem)),
                    }
                }
            }
            None => notes.push("errors in variables: too few frames to see the markers' noise".to_owned()),
        }
        let motions = self.motions().unwrap_or_else(|f| {
            notes.push(format!("motions to add: {}", f.problem));
            Vec::new()
        });
        let next_flights = match (&self.session.robot, self.robot) {
            (Some(setup), Some(config)) => self.next_flights(setup, config, &mut notes)?,
            _ => None,
        };
        Ok(Assessment { version: 1, of, window, errors_in_variables, motions, next_flights, notes })
    }

    fn next_flights(
        &self,
        setup: &RobotSetup,
        config: &RobotConfig,
        notes: &mut Vec<String>,
    ) -> Result<Option<NextFlights>, StageFailure> {
        let Some(parameters) = self.made.results.load_parameters(Rows::Weak)? else { return Ok(None) };
        let recorded: Vec<(&Motion, &[Stretch])> =
            self.recorded.iter().map(|r| (&r.rows.motion, r.flights.as_slice())).collect();
        let inputs = PlanInputs {
            made: self.made,
            setup,
            config,
            subject: &self.recorded[0].rows.subject,
            base: &self.base,
            prior: &self.prior,
            phi: &self.phi,
            parameters: &parameters,
            recorded: &recorded,
        };
        Ok(inputs.plan_or_note(notes))
    }

    fn base_prior(&self) -> Option<&Prior> {
        self.session.object.is_none().then_some(&self.prior)
    }

    fn weak(&self, flights: &[(usize, Stretch)], options: &WeakOptions) -> Result<Vec<Factor>, StageFailure> {
        flights
            .par_iter()
            .map(|(i, s)| self.weak_rows(&self.recorded[*i].rows.motion, s, options))
            .collect::<Result<_, _>>()
            .map_err(stop)
    }

    fn weak_rows(&self, motion: &Motion, flight: &Stretch, options: &WeakOptions) -> Result<Factor, RegressorError> {
        let model = &self.recorded[0].rows.subject.model;
        weak_factor(model, &self.base, &self.phi, motion, flight, Acting::nothing(), options, None)
    }

    fn windows(&self, flights: &[(usize, Stretch)]) -> Result<Option<WindowChoice>, StageFailure> {
        let of = |window_s: f64| {
            let options = WeakOptions { window_s: (window_s > 0.0).then_some(window_s), ..WeakOptions::default() };
            self.weak(flights, &options)
        };
        let candidates: Vec<(f64, Vec<Factor>)> =
            WINDOWS_S.iter().map(|w| Ok((*w, of(*w)?))).collect::<Result<_, StageFailure>>()?;
        choose_window(&candidates, &of(YARDSTICK_S)?, self.mass_kg, self.base_prior(), ClusterBy::Stretch)
            .map(Some)
            .map_err(stop)
    }

    /// The markers' noise in joint coordinates, from the recording that shows it in most frames.
    fn noise(&self) -> Option<DMatrix<f64>> {
        let longest = self.recorded.iter().max_by_key(|r| r.rows.motion.n_frames())?;
        noise_root(&longest.rows.subject.model, longest.rows.filtered.as_ref()?, &longest.rows.motion)
    }

    fn errors_in_variables(
        &self,
        rows: Rows,
        parameters: &Parameters,
        flights: &[(usize, Stretch)],
        root: &DMatrix<f64>,
    ) -> Result<ErrorsInVariables, StageFailure> {
        let model = &self.recorded[0].rows.subject.model;
        let chosen = match estimator(&identify::Params::of(self.session), rows) {
            Estimator::Regularised { .. } => Estimator::Regularised { weight: Some(parameters.prior_weight.max(1.0)) },
            other => other,
        };
        let weak = weak_options(self.session.config.regressor.window_s);
        let acceleration =
            AccelerationOptions { margin_s: self.session.config.flight.margin_s, ..AccelerationOptions::default() };
        let filter = low_pass(&self.session.config.filter);
        let noise = CoordinateNoise::Root(root);
        let found = simex(&LEVELS, REPLICATES, |level, replicate| {
            let mut factors = Vec::with_capacity(flights.len());
            for (i, recorded) in self.recorded.iter().enumerate() {
                let own: Vec<&Stretch> = flights.iter().filter(|(j, _)| *j == i).map(|(_, s)| s).collect();
                if own.is_empty() {
                    continue;
                }
                let seed = ((replicate as u64) << 32) | i as u64;
                let clean = &recorded.rows.motion;
                let noisy = if level > 0.0 { &add_noise(model, clean, &noise, level.sqrt(), seed)? } else { clean };
                if rows == Rows::Weak && chosen == Estimator::NoiseMetric {
                    // the noise that is in the motion and the noise that was added
                    let all = root * (1.0 + level).sqrt();
                    let noise = MatrixNoise::white(CoordinateNoise::Root(&all), &|_: &Motion| Ok(None));
                    for s in own {
                        let acting = Acting::nothing();
                        factors.push(weak_factor_with_noise(
                            model, &self.base, &self.phi, noisy, s, acting, &weak, None, &noise,
                        )?);
                    }
                } else if rows == Rows::Weak {
                    for s in own {
                        factors.push(self.weak_rows(noisy, s, &weak)?);
                    }
                } else {
                    let filtered = smooth(model, noisy, Some(filter))
                        .map_err(|e| aloft_identify::IdentifyError::Numeric(e.to_string()))?;
                    for s in own {
                        match acceleration_factor(model, &self.base, &filtered, s, Acting::nothing(), &acceleration) {
                            Err(RegressorError::TooShort { .. }) => {}
                            other => factors.push(other?),
                        }
                    }
                }
            }
            point_estimate(&Factor::merge(&factors)?, self.mass_kg, self.base_prior(), chosen)
        })
        .map_err(stop)?;
        let biases: Vec<NoiseBias> = parameters
            .base
            .iter()
            .enumerate()
            .skip(1)
            .map(|(i, b)| NoiseBias {
                name: b.name.clone(),
                value: found.naive[i],
                bias: found.bias[i],
                bias_se: found.extrapolation_se[i],
                se: b.se,
                unit: b.unit.clone(),
            })
            .collect();
        let in_se = |b: &NoiseBias| b.bias.abs() / b.se;
        // a bias within twice its own standard error is no more than the scatter of its estimate
        let shown = |b: &&NoiseBias| in_se(b).is_finite() && b.bias.abs() > 2.0 * b.bias_se;
        let worst = biases.iter().filter(shown).max_by(|a, b| in_se(a).total_cmp(&in_se(b)));
        let biased = biases.iter().filter(shown).filter(|b| in_se(b) > 0.5).count();
        let (all, of) = (biases.len(), rows.word());
        let words = match worst {
            None => format!(
                "noise of the markers moves none of the {of} rows' parameters beyond the scatter of this estimate"
            ),
            Some(b) => format!(
                "noise of the markers moves {of} rows' parameters by at most {:.2} standard errors ({}); {}",
                in_se(b),
                b.name,
                match biased {
                    0 => "no parameter by more than half of one".to_owned(),
                    n => format!("{n} of {all} by more than half of one"),
                }
            ),
        };
        Ok(ErrorsInVariables {
            rows: rows.word().to_owned(),
            estimator: chosen.name().to_owned(),
            flights: flights.len(),
            levels: LEVELS.to_vec(),
            replicates: REPLICATES,
            largest_in_se: biases.iter().map(in_se).filter(|x| x.is_finite()).fold(f64::NAN, f64::max),
            biased,
            parameters: biases,
            words,
        })
    }

    fn motions(&self) -> Result<Vec<MotionAdvice>, StageFailure> {
        let every: Vec<(usize, Stretch)> =
            self.recorded.iter().enumerate().flat_map(|(i, r)| r.flights.iter().map(move |s| (i, s.clone()))).collect();
        let weak = weak_options(self.session.config.regressor.window_s);
        let factors = self.weak(&every, &weak)?;
        let Some(first) = self.recorded.first() else { return Ok(Vec::new()) };
        let subject = &first.rows.subject;
        let pairs: Vec<(Stretch, Factor)> = every.iter().map(|(_, s)| s.clone()).zip(factors.clone()).collect();
        let params = identify::Params::of(self.session);
        // how much a motion adds does not depend on the noise of the rows' matrix, which these lack
        let chosen = match estimator(&params, Rows::Weak) {
            Estimator::NoiseMetric => Estimator::MassConstrained,
            other => other,
        };
        let found = identify_from(&params, subject, &pairs, chosen, 0)?;
        // the posture in the middle of the middle flight
        let (i, flight) = &every[every.len() / 2];
        let motion = &self.recorded[*i].rows.motion;
        let frames = flight.first_frame..flight.end_frame;
        let middle = (frames.start + frames.end) / 2;
        let posture = frames
            .filter(|f| motion.is_valid(*f))
            .min_by_key(|f| f.abs_diff(middle))
            .map(|f| motion.q(f))
            .ok_or_else(|| StageFailure::new("no frame of the middle flight was solved"))?;
        let durations =
            every.iter().map(|(i, s)| (s.end_frame - s.first_frame) as f64 / self.recorded[*i].rows.motion.rate_hz);
        let flight_s = durations.sum::<f64>() / every.len() as f64;
        let options = AdviceOptions {
            flight_s,
            rate_hz: motion.rate_hz.min(200.0),
            turning_over: params.turning_over(),
            ..AdviceOptions::default()
        };
        let mut advice = excitation_advice(
            &subject.model,
            &self.base,
            &factors,
            self.mass_kg,
            &self.links,
            posture,
            found.row_sd,
            &weak,
            &options,
        )
        .map_err(stop)?;
        advice.truncate(MOTIONS);
        Ok(advice)
    }
}
