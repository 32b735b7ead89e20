//! `identify`: base parameters from the factors of all flights, with weak rows and with the paper's
//! beside them.

use crate::factors::{load_factors, load_repeated, row_kind};
use crate::graph::{Need, Scope, Stage, StageInputs, StageReport, StageWork, parameters_of, run_of};
use crate::merge;
use crate::results::parameters_file;
use crate::stages::calibrate::contradicted;
use crate::stages::stage_of;
use aloft_body::{BaseParameters, Subject};
use aloft_identify::{
    ClusterBy, ColumnScaling, Estimator, IdentifyOptions, LinkPrior, Parameters, PreparedPrior, RotatedRows, Visible,
    balanced, identify_with_errors, point_estimate_prepared,
};
use aloft_regressor::{Factor, RepeatedErrors, RowKind, Stretch, StretchKind, leave_group_out};
use aloft_study::config::{Estimator as ChosenEstimator, IdentifyConfig, Rows};
use aloft_study::revision::ModelEffect;
use aloft_study::robot::RobotSetup;
use aloft_study::subject_session::{Role, SubjectSession, TrialEntry};
use aloft_workspace::error::StageFailure;
use aloft_workspace::json::{read_json_if_there, write_json};
use nalgebra::DVector;
use serde::Serialize;
use std::collections::{HashMap, HashSet};

/// The stage.
pub static STAGE: Stage = Stage {
    name: "identify",
    version: 12,
    scope: Scope::Session,
    seconds: 0.3,
    reads: "all factors",
    gives: "base parameters with intervals, consistent link inertias",
    needs: &[
        Need::Once("calibrate"),
        Need::Merged("regressor", &[Role::Identify]),
        Need::Merged("acceleration", &[Role::Identify]),
    ],
    parameters: parameters_of::<Work>,
    run: run_of::<Work>,
};

/// Parameters of the stage.
#[derive(Debug, Serialize)]
pub struct Params {
    /// Settings of identification.
    pub identify: IdentifyConfig,
    /// Whether contact takes part in identification.
    pub contact: bool,
    /// The rows chosen in the pipeline.
    pub rows: Rows,
    /// True for objects.
    pub is_object: bool,
    /// The robot, whose joints' torques are fitted beside the base parameters.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub robot: Option<RobotSetup>,
    /// How much the standard error of each coefficient grows because the nonlinear parameters of
    /// its effect were fitted, by name. Everything that follows from the model's effects is stored
    /// under `effects`, so that revisions of the model can be compared (`made::made_with`).
    #[serde(rename = "effects", skip_serializing_if = "Vec::is_empty")]
    pub widening: Vec<(String, f64)>,
}

impl Params {
    /// Parameters for a study.
    pub fn of(session: &SubjectSession) -> Self {
        let widening =
            |e: &ModelEffect| e.widening.iter().map(|(n, by)| (format!("{}.{n}", e.key), *by)).collect::<Vec<_>>();
        Self {
            identify: session.config.identify.clone(),
            contact: session.identifies_from_contact(),
            rows: session.config.regressor.rows,
            is_object: session.object.is_some(),
            robot: session.robot.clone(),
            widening: session.effects.iter().flat_map(widening).collect(),
        }
    }
}

impl Params {
    /// Whether advice may contain turning over in the air.
    pub fn turning_over(&self) -> bool {
        self.is_object || self.identify.somersaults
    }
}

/// Work of the stage.
#[derive(Debug)]
pub struct Work;

impl StageWork for Work {
    type Params = Params;
    fn params(session: &SubjectSession, _: Option<&TrialEntry>) -> Params {
        Params::of(session)
    }
    fn run(params: &Params, inputs: &StageInputs<'_>) -> Result<StageReport, StageFailure> {
        run(params, inputs)
    }
}

/// Flights (and contact stretches, if requested) of the identification trials, from one kind of
/// rows.
pub fn training_factors(
    inputs: &StageInputs<'_>,
    rows: Rows,
    contact: bool,
) -> Result<Vec<(Stretch, Factor)>, StageFailure> {
    let mut out = Vec::new();
    for name in inputs.trials_with_role(stage_of(rows), |role| role == Role::Identify) {
        let factors = load_factors(&inputs.results.place(stage_of(rows), &name)?)?;
        out.extend(
            factors.into_iter().filter(|(s, f)| f.rows == row_kind(rows) && (contact || s.kind == StretchKind::Flight)),
        );
    }
    Ok(out)
}

/// Estimator for a kind of rows: the paper's rows use the paper's estimator unless the pipeline
/// states another.
pub fn estimator(params: &Params, rows: Rows) -> Estimator {
    let config = &params.identify;
    let weight = (config.prior_weight > 0.0).then_some(config.prior_weight);
    match (config.estimator, rows) {
        (ChosenEstimator::NullVector, _)
        | (ChosenEstimator::Auto | ChosenEstimator::NoiseMetric, Rows::Acceleration) => {
            Estimator::NullVector(ColumnScaling::default())
        }
        (ChosenEstimator::MassConstrained, _) => Estimator::MassConstrained,
        (ChosenEstimator::Regularised, _) => Estimator::Regularised { weight },
        (ChosenEstimator::NoiseMetric, Rows::Weak) => Estimator::NoiseMetric,
        (ChosenEstimator::Auto, Rows::Weak) if params.is_object || params.robot.is_some() => Estimator::NoiseMetric,
        (ChosenEstimator::Auto, Rows::Weak) => Estimator::Regularised { weight },
    }
}

/// What errors that repeat do to the weak rows of some factors, in their order; empty if a trial
/// has none (objects).
fn training_errors(
    inputs: &StageInputs<'_>,
    factors: &[(Stretch, Factor)],
) -> Result<Vec<RepeatedErrors>, StageFailure> {
    let mut of_trials: HashMap<&str, Vec<(Stretch, RepeatedErrors)>> = HashMap::new();
    let mut out = Vec::with_capacity(factors.len());
    for (stretch, factor) in factors.iter().filter(|(_, f)| f.rows == RowKind::Weak) {
        if !of_trials.contains_key(factor.trial.as_str()) {
            of_trials.insert(&factor.trial, load_repeated(&inputs.results.place("regressor", &factor.trial)?)?);
        }
        let found = of_trials.get(factor.trial.as_str()).and_then(|all| all.iter().find(|(s, _)| s == stretch));
        match found {
            Some((_, errors)) => out.push(errors.clone()),
            None if out.is_empty() => {}
            None => return Err(without_errors(&factor.trial)),
        }
    }
    match factors.get(out.len()) {
        Some((_, factor)) if !out.is_empty() => Err(without_errors(&factor.trial)),
        _ => Ok(out),
    }
}

/// Intervals with the errors of some recordings only would be too narrow.
fn without_errors(trial: &str) -> StageFailure {
    StageFailure::with_hint(
        format!("{trial}: the errors of its markers and of the geometry are missing beside its rows"),
        "make them again: `aloft run` with `--from regressor`",
    )
}

/// Base parameters, and coefficients of effects by name.
pub type PointEstimate = (DVector<f64>, Vec<(String, f64)>);

/// Identifies from the given factors.
pub fn identify_from(
    params: &Params,
    subject: &Subject,
    factors: &[(Stretch, Factor)],
    estimator: Estimator,
    bootstrap: usize,
) -> Result<Parameters, StageFailure> {
    identify_with(params, subject, factors, None, &[], estimator, bootstrap)
}

/// Unit of independent evidence: a flight; where contact takes part, a trial, because errors of the
/// plates (zero, time) are the same in all contact of one recording. With fewer than three trials
/// there is no spread among them.
fn unit_of_evidence(factors: &[(Stretch, Factor)]) -> ClusterBy {
    let trials: HashSet<&str> = factors.iter().map(|(_, f)| f.trial.as_str()).collect();
    let contact = factors.iter().any(|(s, _)| s.kind == StretchKind::Contact);
    if contact && trials.len() >= 3 { ClusterBy::Trial } else { ClusterBy::Stretch }
}

/// The same with flights already merged ([`merge::root`]) and with errors that repeat.
fn identify_with(
    params: &Params,
    subject: &Subject,
    factors: &[(Stretch, Factor)],
    flights: Option<&Factor>,
    errors: &[RepeatedErrors],
    estimator: Estimator,
    bootstrap: usize,
) -> Result<Parameters, StageFailure> {
    let base = BaseParameters::of(&subject.model);
    let prior = LinkPrior::of_subject(subject).map_err(|e| StageFailure::new(e.to_string()))?;
    let flight_error_correlation = params.identify.flight_error_correlation.unwrap_or(0.0);
    let widening = params.widening.iter().cloned().collect();
    let options = IdentifyOptions {
        estimator,
        cluster: unit_of_evidence(factors),
        bootstrap,
        flight_error_correlation,
        widening,
        turning_over: params.turning_over(),
        ..IdentifyOptions::default()
    };
    let plain: Vec<Factor> = factors.iter().map(|(_, f)| f.clone()).collect();
    identify_with_errors(&subject.model, &base, &plain, flights, errors, subject.facts.mass_kg, Some(&prior), &options)
        .map(|i| i.parameters)
        .map_err(|e| StageFailure::new(e.to_string()))
}

/// Estimates base parameters and effect coefficients without intervals and without links: all that
/// predictions need.
pub struct Predicting {
    prior: Option<PreparedPrior>,
    mass_kg: f64,
    estimator: Estimator,
    contact_weight: f64,
}

impl Predicting {
    /// Uses the settings of identified parameters: their estimator, their weight of the prior and
    /// of contact.
    pub fn like(subject: &Subject, parameters: &Parameters) -> Result<Self, StageFailure> {
        let fail = |e: aloft_identify::IdentifyError| StageFailure::new(e.to_string());
        let prior = match parameters.estimator {
            Estimator::Regularised { .. } | Estimator::NoiseMetric => {
                let base = BaseParameters::of(&subject.model);
                let prior = LinkPrior::of_subject(subject).map_err(fail)?;
                let mass_kg = subject.facts.mass_kg;
                let prior = prior.base(&base).map_err(fail)?;
                Some(prior.prepared(mass_kg).map_err(fail)?)
            }
            _ => None,
        };
        let contact_weight = parameters.contact.as_ref().map_or(1.0, |c| c.contact_weight);
        Ok(Self { prior, mass_kg: subject.facts.mass_kg, estimator: parameters.estimator, contact_weight })
    }

    /// Weight of contact beside flights in an identification from these factors, as the stage
    /// estimates it; none if the estimator uses flights only.
    pub fn weight_of_contact(&self, subject: &Subject, factors: &[Factor]) -> Result<Option<f64>, StageFailure> {
        let fail = |e: aloft_identify::IdentifyError| StageFailure::new(e.to_string());
        let prior = match self.estimator {
            Estimator::NullVector(_) => return Ok(None),
            Estimator::MassConstrained => None,
            Estimator::Regularised { .. } | Estimator::NoiseMetric => {
                let base = BaseParameters::of(&subject.model);
                Some(LinkPrior::of_subject(subject).map_err(fail)?.base(&base).map_err(fail)?)
            }
        };
        let visible = Visible::among(factors, prior.is_some()).map_err(fail)?;
        let reduced = visible.reduce_all(factors).map_err(fail)?;
        let (_, balance) = balanced(&reduced, self.mass_kg, prior.as_ref()).map_err(fail)?;
        Ok(Some(balance.map_or(1.0, |b| b.contact_weight)))
    }

    /// Weight of contact rows beside those of flights; none if the estimator uses flights only.
    pub fn contact_weight(&self) -> Option<f64> {
        (!matches!(self.estimator, Estimator::NullVector(_))).then_some(self.contact_weight)
    }

    /// The factors that the estimator uses, with contact weighted.
    fn weighed(&self, factors: &[&Factor]) -> Vec<Factor> {
        let flights_only = matches!(self.estimator, Estimator::NullVector(_));
        factors
            .iter()
            .filter(|f| !(flights_only && f.kind == StretchKind::Contact))
            .map(|f| if f.kind == StretchKind::Contact { f.scaled(self.contact_weight) } else { (*f).clone() })
            .collect()
    }

    /// Estimates from the factors of some stretches.
    pub fn solve(&self, factors: &[&Factor]) -> Result<PointEstimate, StageFailure> {
        let merged = Factor::merge(&self.weighed(factors)).map_err(|e| StageFailure::new(e.to_string()))?;
        self.solve_merged(&merged)
    }

    /// The same for each trial without its factors. For `n` trials the merging costs `3 n` steps in
    /// all, not `n` for each.
    ///
    /// # Errors
    /// The factors do not fit together.
    pub fn solve_without_each(
        &self,
        factors: &[&Factor],
    ) -> Result<HashMap<String, Result<PointEstimate, StageFailure>>, StageFailure> {
        let weighed = self.weighed(factors);
        let mut names: Vec<&str> = Vec::new();
        let mut group: HashMap<&str, usize> = HashMap::new();
        let groups: Vec<usize> = weighed
            .iter()
            .map(|f| {
                *group.entry(f.trial.as_str()).or_insert_with(|| {
                    names.push(&f.trial);
                    names.len() - 1
                })
            })
            .collect();
        // with a single trial nothing is left
        if names.len() < 2 {
            return Ok(HashMap::new());
        }
        let found = leave_group_out(&weighed, &groups, |_, rest| self.solve_merged(rest))
            .map_err(|e| StageFailure::new(e.to_string()))?;
        Ok(names.iter().map(|n| (*n).to_owned()).zip(found).collect())
    }

    /// Weighed and merged factors in coordinates from which a browser estimates; none for an
    /// estimator that is no least squares.
    pub fn rotated(&self, merged: &Factor) -> Result<Option<RotatedRows>, StageFailure> {
        RotatedRows::of(merged, self.mass_kg, self.prior.as_ref(), self.estimator)
            .map_err(|e| StageFailure::new(e.to_string()))
    }

    /// Whether [`Predicting::rotated`] gives other choices of effects only nearly: rows in the
    /// metric of their noise are corrected for as much of it as all effects leave.
    pub fn rotates_nearly(&self) -> bool {
        self.estimator == Estimator::NoiseMetric
    }

    /// Estimates from factors that were weighed and merged before.
    pub fn solve_merged(&self, merged: &Factor) -> Result<PointEstimate, StageFailure> {
        let x = point_estimate_prepared(merged, self.mass_kg, self.prior.as_ref(), self.estimator)
            .map_err(|e| StageFailure::new(e.to_string()))?;
        let p = merged.n_parameters();
        let effects = merged.columns.effects.iter().cloned().zip(x.iter().skip(p).copied()).collect();
        Ok((x.rows(0, p).into_owned(), effects))
    }
}

/// File with the reason why a session identifies nothing, beside which there are no parameters.
pub const NOTHING_IDENTIFIED: &str = "nothing_identified.json";

/// Why these recordings identify nothing although every stage before succeeded: the model is not
/// the whole body, its points are estimates, or nothing in them is a flight. The table's body is
/// then compared with the plates.
fn nothing_to_identify(
    params: &Params,
    inputs: &StageInputs<'_>,
    subject: &Subject,
) -> Result<Option<String>, StageFailure> {
    if let Some(unseen) = subject.model.unseen_parts() {
        return Ok(Some(format!(
            "nothing is identified: {unseen} move unseen, so the equations of the whole body do not hold; the masses are \
             from tables"
        )));
    }
    if let Some(points) = &subject.estimated {
        return Ok(Some(format!(
            "nothing is identified: the joints of {} lie some {:.0} mm from the bones', alike in every recording, which flights \
             cannot tell from masses; the masses are from tables",
            points.source,
            1e3 * points.position_sd_m
        )));
    }
    if params.is_object || params.robot.is_some() || inputs.trials_with_role("regressor", |_| true).is_empty() {
        return Ok(None);
    }
    for rows in Rows::ALL {
        if !training_factors(inputs, rows, params.contact)?.is_empty() {
            return Ok(None);
        }
    }
    let contact = if params.contact { "" } else { " (`identify: {contact: true}` takes contact on plates, too)" };
    Ok(Some(format!(
        "nothing is identified: no flight in the trials to identify from{contact}; the masses are from tables"
    )))
}

/// What the model adds to the noise of the markers in the recordings to identify from: the first of
/// them, and in how many more there is something. Numbers from a model whose joints or markers are
/// elsewhere are no results.
fn misfit_of(inputs: &StageInputs<'_>) -> Result<Option<String>, StageFailure> {
    let mut found = Vec::new();
    for name in inputs.trials_with_role("regressor", |role| role == Role::Identify) {
        let file = inputs.results.place("regressor", &name)?.join(super::regressor::MISFITS_FILE);
        let words: Option<Vec<String>> = read_json_if_there(&file)?;
        found.extend(words.into_iter().flatten().next().map(|words| (name, words)));
    }
    let others = match found.len() {
        0 | 1 => String::new(),
        2 => " and one other recording".to_owned(),
        n => format!(" and {} other recordings", n - 1),
    };
    Ok(found.into_iter().next().map(|(name, words)| format!("{name}{others}: {words}")))
}

fn run(params: &Params, inputs: &StageInputs<'_>) -> Result<StageReport, StageFailure> {
    let subject = inputs.results.load_subject("calibrate")?;
    let mut done = StageReport::default();
    let chosen = params.rows;
    if let Some(why) = nothing_to_identify(params, inputs, &subject)? {
        done.note("identified", false);
        write_json(&inputs.out.join(NOTHING_IDENTIFIED), &why)?;
        done.warnings.push(why);
        return Ok(done);
    }
    for rows in Rows::ALL {
        let factors = training_factors(inputs, rows, params.contact)?;
        if factors.is_empty() {
            let problem = format!("no flight of an identification trial gave {} rows", rows.word());
            if rows == chosen && !inputs.expected().iter().any(|(_, role)| *role == Role::Identify) {
                return Err(StageFailure::with_hint(
                    "there is no recording to identify from",
                    "`trials: {identify: […]}` of the pipeline matches none; `aloft check` lists the recordings that match no pattern",
                ));
            }
            if rows == chosen {
                return Err(StageFailure::with_hint(
                    problem,
                    "look at `aloft status` and the warnings of the stage `flight`",
                ));
            }
            done.warnings.push(problem);
            continue;
        }
        let flights = merge::root(inputs, &factors, row_kind(rows))?;
        let bootstrap = params.identify.bootstrap;
        let errors = training_errors(inputs, &factors)?;
        match identify_with(params, &subject, &factors, flights.as_ref(), &errors, estimator(params, rows), bootstrap) {
            Ok(mut parameters) => {
                parameters.gate.reasons.splice(0..0, contradicted(inputs.results)?);
                if let Some(misfit) = misfit_of(inputs)? {
                    parameters.gate.passed = false;
                    parameters.gate.reasons.insert(0, misfit.clone());
                    parameters.gate.misfit = Some(misfit);
                }
                write_json(&inputs.out.join(parameters_file(rows)), &parameters)?;
                if let (Some(robot), Rows::Weak) = (&params.robot, rows) {
                    super::robot_torques::fit_joints(
                        robot,
                        inputs,
                        &subject,
                        &factors,
                        &parameters,
                        &params.widening,
                        &mut done,
                    )?;
                }
                if rows == chosen {
                    let unseen = parameters.effects.iter().filter_map(|e| Some((&e.name, e.not_determined.as_ref()?)));
                    done.warnings.extend(unseen.map(|(name, why)| format!("effect {name} is not determined: {why}")));
                    done.note("flights", parameters.n_flights());
                    done.note("rows", parameters.n_rows);
                    done.note("gate_passed", parameters.gate.passed);
                    if !parameters.gate.passed {
                        done.warnings.extend(parameters.gate.reasons.iter().cloned());
                    }
                }
                done.note(&format!("sigma_ratio_{}", rows.word()), parameters.sigma.ratio);
            }
            Err(failure) if rows != chosen => done.warnings.push(format!("{} rows: {}", rows.word(), failure.problem)),
            Err(failure) => return Err(failure),
        }
    }
    Ok(done)
}
