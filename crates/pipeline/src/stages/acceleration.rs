//! `acceleration`: one triangular factor a flight and a contact stretch, from the paper's
//! acceleration rows. They use the filtered motion and plates.

use crate::factors::{FactorsAndRemarks, save_factors};
use crate::graph::{Need, Scope, Stage, StageInputs, StageReport, StageWork, parameters_of, run_of};
use crate::trial_rows::{TrialRows, each_stretch, effect_columns};
use aloft_body::BaseParameters;
use aloft_regressor::{AccelerationOptions, Acting, acceleration_factor};
use aloft_study::config::FilterConfig;
use aloft_study::effects::ModelEffects;
use aloft_study::subject_session::{Role, SubjectSession, TrialEntry};
use aloft_workspace::error::StageFailure;
use serde::Serialize;

/// The stage.
pub static STAGE: Stage = Stage {
    name: "acceleration",
    version: 3,
    scope: Scope::Trial(&[Role::Identify, Role::Validate]),
    seconds: 0.03,
    reads: "filtered `Motion`, flights, plates",
    gives: "the paper's rows: one triangular factor a flight and contact stretch",
    needs: &[
        Need::Same("import"),
        Need::Same("ik"),
        Need::Same("filter"),
        Need::Same("flight"),
        Need::Once("calibrate"),
        // for effects that grow over the session
        Need::Times,
    ],
    parameters: parameters_of::<Work>,
    run: run_of::<Work>,
};

/// Parameters of the stage.
#[derive(Debug, Serialize)]
pub struct Params {
    /// Time at both ends of a flight that the rows leave out, s.
    pub margin_s: f64,
    /// Filter for the motion, also applied to the plates.
    pub filter: FilterConfig,
    /// Effects of the model.
    pub effects: ModelEffects,
}

impl Params {
    /// Parameters for a session.
    pub fn of(session: &SubjectSession) -> Self {
        Self {
            margin_s: session.config.flight.margin_s,
            filter: session.config.filter.clone(),
            effects: session.model_effects(),
        }
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
        let results = inputs.results;
        let subject = results.load_subject("calibrate")?;
        let rows = TrialRows::load(results, Some(&params.filter), &|| inputs.calendar(), inputs.trial()?, &subject)?;
        let (factors, warnings) = acceleration_factors(params, &rows)?;
        let mut done = StageReport { warnings: warnings.into(), ..StageReport::default() };
        save_factors(inputs.out, &factors)?;
        done.note("acceleration_rows", factors.iter().map(|(_, f)| f.n_rows).sum::<usize>());
        Ok(done)
    }
}

/// Factors of every stretch of a trial from acceleration rows, with remarks; none without a
/// filtered motion.
pub fn acceleration_factors(params: &Params, rows: &TrialRows) -> Result<FactorsAndRemarks, StageFailure> {
    let Some(filtered) = &rows.filtered else { return Ok((Vec::new(), Vec::new())) };
    let base = BaseParameters::of(&rows.subject.model);
    let options = AccelerationOptions { margin_s: params.margin_s, ..AccelerationOptions::default() };
    let effects = effect_columns(&params.effects, rows)?;
    let acting = Acting { measured: rows.wrench_filtered.as_deref(), effects: effects.as_ref() };
    each_stretch(rows, |stretch| acceleration_factor(&rows.subject.model, &base, filtered, stretch, acting, &options))
}
