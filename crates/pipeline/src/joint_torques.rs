//! Torques of a robot's joints as evidence: their rows in all flights, joint by joint, what they
//! leave in flights that were left out, and what a perfect model would leave.
//!
//! The floor of a joint is made as that of the body: errors of encoders, base pose and inertial
//! unit are drawn and passed through the smoothers that made the motion, white noise is drawn for
//! the torques, and the rows are formed again. What they change is what a perfect model would
//! leave.

use crate::factors::load_factors;
use crate::results::Results;
use crate::stages::robot::{RobotErrors, failed, load_log};
use crate::stages::robot_torques::{TORQUE, carried, laws_of_joints};
use crate::trial_rows::{TrialRows, effect_columns};
use aloft_body::{BaseParameters, Motion, Subject};
use aloft_compare::PoseErrors;
use aloft_effects::{EffectInstance, Scene};
use aloft_identify::LinkPrior;
use aloft_regressor::{Factor, RegressorError, Stretch, StretchKind};
use aloft_robot::joint_evidence::{
    BodyEvidence, JointEvidence, JointFlight, JointFolds, ReducedFold, WINDOW_S, floor_of_draws, moving,
};
use aloft_robot::noise::{noisy_torques, white_sd};
use aloft_robot::torque::{TorqueRows, TorqueSource, Torques};
use aloft_study::calendar::Calendar;
use aloft_study::config::Rows;
use aloft_study::effects::{KnownEffects, ModelEffects};
use aloft_study::robot::RobotSetup;
use aloft_workspace::disk::is_there;
use aloft_workspace::error::StageFailure;
use nalgebra::DVector;
use rayon::prelude::*;
use std::sync::Arc;

/// Draws of the sensors' errors for the floors.
const DRAWS: u64 = 8;
/// Seed of the draws.
const SEED: u64 = 20_261_123;

/// A recording with everything that its torque rows are formed from.
struct Recorded {
    motion: Motion,
    stretches: Vec<Stretch>,
    /// `[joint][frame]`.
    torques: Vec<Vec<f64>>,
    carried: Vec<(String, Option<DVector<f64>>)>,
    errors: Option<RobotErrors>,
}

/// The torques of all flights from which the body is identified.
pub struct JointTorques<'a> {
    robot: &'a RobotSetup,
    /// The body with the names of its joints.
    pub scene: Scene,
    base: BaseParameters,
    body: BodyEvidence,
    recorded: Vec<Recorded>,
    flights: Vec<JointFlight>,
    /// White noise of each joint's torque, N·m (N).
    sensor_sd: Vec<f64>,
}

/// What the rows of one joint leave.
#[derive(Debug, Clone)]
pub struct JointError {
    /// Root mean square in flights (or recordings) that were left out, N·m (N).
    pub held_out: f64,
    /// What a perfect model would leave, with its 95 % interval; none if it is not known.
    pub floor: Option<(f64, [f64; 2])>,
    /// Number of rows.
    pub rows: usize,
}

/// A joint fitted beside the body to all flights.
struct Fitted {
    held_out: f64,
    rows: usize,
    solution: DVector<f64>,
    /// What it leaves in each flight, N·m (N).
    left: Vec<DVector<f64>>,
}

impl<'a> JointTorques<'a> {
    /// Loads the torques of the trials in `names`. None where no log holds torques, where they are
    /// not used (another unit, the opposite sign), or where an effect of the model acts from
    /// outside, of which the joints do not know where it enters.
    pub fn load(
        robot: &'a RobotSetup,
        results: Results<'_>,
        names: &[String],
        effects: &ModelEffects,
        calendar: &(dyn Fn() -> Result<Arc<Calendar>, StageFailure> + Sync),
    ) -> Result<Option<Self>, StageFailure> {
        let mut with_rows: Vec<&String> = Vec::new();
        for name in names {
            if is_there(&results.place("regressor", name)?.join(format!("{TORQUE}.json")))? {
                with_rows.push(name);
            }
        }
        let names = with_rows;
        let Some(parameters) = results.load_parameters(Rows::Weak)?.filter(|_| !names.is_empty()) else {
            return Ok(None);
        };
        let subject = results.load_subject("calibrate")?;
        let (base, prior) = (BaseParameters::of(&subject.model), subject.prior_phi());
        let scene = Scene::new(&subject.model, &prior, &[]);
        let one = |name: &&String| Recorded::load(robot, results, name, &subject, effects, calendar);
        let each = names.par_iter().map(one).collect::<Result<Vec<_>, StageFailure>>()?;
        let recorded: Vec<Recorded> = each.into_iter().flatten().collect();
        if recorded.len() < names.len() {
            return Ok(None);
        }
        let mut factors: Vec<Factor> = Vec::new();
        for name in &names {
            let own = load_factors(&results.place("regressor", name)?)?;
            factors.extend(own.into_iter().filter(|(s, _)| s.kind == StretchKind::Flight).map(|(_, f)| f));
        }
        let fail = |e: aloft_identify::IdentifyError| StageFailure::new(e.to_string());
        let of_links = LinkPrior::of_subject(&subject).map_err(fail)?.base(&base).map_err(fail)?;
        let Some(body) = BodyEvidence::of(&of_links, subject.facts.mass_kg, &factors, parameters.row_sd) else {
            return Ok(None);
        };
        let sd_nm = robot.description.noise.torque_nm;
        let sensor_sd = (0..robot.model.joints.len())
            .map(|j| {
                let of = |r: &'_ Recorded| -> Vec<Vec<f64>> {
                    r.stretches.iter().map(|s| r.torques[j][s.first_frame..s.end_frame].to_vec()).collect()
                };
                let all: Vec<Vec<f64>> = recorded.iter().flat_map(of).collect();
                white_sd(&all).map_or(sd_nm, |found| found.min(sd_nm))
            })
            .collect();
        let mut out = Self { robot, scene, base, body, recorded, flights: Vec::new(), sensor_sd };
        let each = out.recorded.iter().map(|r| out.formed(r, &r.motion, &r.torques));
        out.flights = each.collect::<Result<Vec<_>, _>>()?.into_iter().flatten().collect();
        Ok((!out.flights.is_empty()).then_some(out))
    }

    /// Laws of joints in a model.
    pub fn laws<'k>(
        &self,
        known: &'k KnownEffects,
        model: &ModelEffects,
    ) -> Result<Vec<EffectInstance<'k>>, StageFailure> {
        laws_of_joints(known, &self.scene, model)
    }

    /// Rows of each flight of a recording with a motion and torques; none for flights that are too
    /// short.
    fn formed(&self, of: &Recorded, motion: &Motion, torques: &[Vec<f64>]) -> Result<Vec<JointFlight>, StageFailure> {
        let torques = Torques { values: torques, sd_nm: self.robot.description.noise.torque_nm, white_nm: &[] };
        let mut out = Vec::new();
        for stretch in &of.stretches {
            let source = TorqueSource { scene: &self.scene, motion, stretch, torques };
            match TorqueRows::of(&self.robot.model, source, WINDOW_S) {
                Ok(rows) => {
                    let (trial, flight, carried) = (stretch.trial.clone(), stretch.index, of.carried.clone());
                    out.push(JointFlight { trial, flight, moving: moving(&rows), rows, carried });
                }
                Err(RegressorError::TooShort { .. }) => {}
                Err(e) => return Err(StageFailure::new(e.to_string())),
            }
        }
        Ok(out)
    }

    /// Name of each joint, the link that it carries, and the unit of its torque.
    pub fn joints(&self) -> Vec<(String, usize, &'static str)> {
        let Some(first) = self.flights.first() else { return Vec::new() };
        (0..first.rows.n_joints())
            .map(|j| {
                let (name, link) = first.rows.joint(j);
                (name.to_owned(), link, if self.scene.slides(link) { "N" } else { "N·m" })
            })
            .collect()
    }

    fn evidence(&self, joint: usize, laws: &[EffectInstance<'_>], tried: &[EffectInstance<'_>]) -> JointEvidence {
        let (name, link) = self.flights[0].rows.joint(joint);
        JointEvidence {
            name: name.to_owned(),
            link,
            blocks: self
                .flights
                .iter()
                .filter(|f| !f.moving[joint].is_empty())
                .map(|f| f.block(joint, &self.base, laws, tried))
                .collect(),
        }
    }

    /// A joint with the laws of its model and columns of others, one flight (or recording) left out
    /// at a time; the last fold leaves nothing out.
    pub fn folds(
        &self,
        joint: usize,
        laws: &[EffectInstance<'_>],
        tried: &[EffectInstance<'_>],
    ) -> Option<Vec<ReducedFold>> {
        JointFolds::of(&self.evidence(joint, laws, tried), &self.body, &self.robot.model)?.reduced()
    }

    /// What each joint's rows leave with the laws of a model, and what a perfect model would leave.
    ///
    /// # Errors
    /// Rows with drawn errors cannot be formed.
    pub fn errors(&self, laws: &[EffectInstance<'_>]) -> Result<Vec<Option<JointError>>, StageFailure> {
        self.errors_of(&|_| true, laws)
    }

    /// The same of one joint.
    ///
    /// # Errors
    /// As [`Self::errors`].
    pub fn error(&self, joint: usize, laws: &[EffectInstance<'_>]) -> Result<Option<JointError>, StageFailure> {
        Ok(self.errors_of(&|j| j == joint, laws)?.into_iter().nth(joint).flatten())
    }

    fn errors_of(
        &self,
        wanted: &(dyn Fn(usize) -> bool + Sync),
        laws: &[EffectInstance<'_>],
    ) -> Result<Vec<Option<JointError>>, StageFailure> {
        let n = self.sensor_sd.len();
        let found: Vec<Option<Fitted>> = (0..n)
            .into_par_iter()
            .map(|j| {
                if !wanted(j) {
                    return None;
                }
                let evidence = self.evidence(j, &self.of_joint(j, laws), &[]);
                let folds = JointFolds::of(&evidence, &self.body, &self.robot.model)?;
                let solution = folds.solution().clone();
                let own = self.of_joint(j, laws);
                let left = self.flights.iter().map(|f| f.left(j, &self.base, &own, &solution)).collect();
                Some(Fitted { held_out: folds.held_out_nm()?, rows: folds.rows(), solution, left })
            })
            .collect();
        let jobs: Vec<(usize, u64)> = (0..DRAWS).flat_map(|d| (0..self.recorded.len()).map(move |r| (r, d))).collect();
        // squares and rows of each joint in each draw of each recording
        let drawn: Vec<Vec<(f64, usize)>> =
            jobs.par_iter().map(|(r, d)| self.drawn(*r, *d, laws, &found)).collect::<Result<_, _>>()?;
        let known = self.recorded.iter().all(|r| r.errors.is_some());
        let errors = (0..n)
            .map(|j| {
                let fitted = found[j].as_ref()?;
                let of_draw = |d: u64| {
                    let own = jobs.iter().zip(&drawn).filter(|(job, _)| job.1 == d).map(|(_, sums)| sums[j]);
                    own.fold((0.0, 0), |s, x| (s.0 + x.0, s.1 + x.1))
                };
                let draws: Vec<(f64, usize)> = (0..DRAWS).map(of_draw).collect();
                let floor = floor_of_draws(&draws).filter(|_| known);
                Some(JointError { held_out: fitted.held_out, floor, rows: fitted.rows })
            })
            .collect();
        Ok(errors)
    }

    /// The laws that act on one joint.
    fn of_joint<'e>(&self, joint: usize, laws: &[EffectInstance<'e>]) -> Vec<EffectInstance<'e>> {
        let link = self.flights[0].rows.joint(joint).1;
        laws.iter().filter(|l| l.target.link() == link).cloned().collect()
    }

    /// By how much one draw of the sensors' errors changes what the rows of each joint leave: sum
    /// of squares and number of rows.
    fn drawn(
        &self,
        recording: usize,
        draw: u64,
        laws: &[EffectInstance<'_>],
        found: &[Option<Fitted>],
    ) -> Result<Vec<(f64, usize)>, StageFailure> {
        let mut out = vec![(0.0, 0); found.len()];
        let of = &self.recorded[recording];
        let Some(errors) = &of.errors else { return Ok(out) };
        let wanted = |f: usize| of.stretches.iter().any(|s| (s.first_frame..s.end_frame).contains(&f));
        let motion = errors.draw(&of.motion, &wanted, SEED, draw);
        let torques = noisy_torques(&of.torques, &self.sensor_sd, &of.motion.trial, SEED, draw);
        // where friction stands among the unknowns
        let friction = self.body.unknowns() + 2;
        for mut flight in self.formed(of, &motion, &torques)? {
            let same = |f: &JointFlight| f.trial == flight.trial && f.flight == flight.flight;
            let Some(at) = self.flights.iter().position(same) else { continue };
            flight.moving.clone_from(&self.flights[at].moving);
            for (j, found) in found.iter().enumerate() {
                let Some(Fitted { solution: x, left, .. }) = found else { continue };
                let changed = flight.left(j, &self.base, &self.of_joint(j, laws), x) - &left[at];
                out[j].0 += changed.norm_squared() + flight.sticking(j, x[friction]);
                out[j].1 += changed.len();
            }
        }
        Ok(out)
    }
}

impl Recorded {
    /// None where an effect of the model acts from outside the body, or the log holds no torques.
    fn load(
        robot: &RobotSetup,
        results: Results<'_>,
        name: &str,
        subject: &Subject,
        effects: &ModelEffects,
        calendar: &(dyn Fn() -> Result<Arc<Calendar>, StageFailure> + Sync),
    ) -> Result<Option<Self>, StageFailure> {
        let rows = TrialRows::load(results, None, calendar, name, subject)?;
        let columns = effect_columns(effects, &rows)?;
        let (log, _) = load_log(robot, results, name)?;
        let torques = log.torques_at_frames().map_err(|e| failed(&e))?;
        let (Some(torques), Some(carried)) = (torques, carried(&rows, columns.as_ref(), effects)?) else {
            return Ok(None);
        };
        let errors = RobotErrors::load(results, &rows.motion)?;
        let frames = torques.iter().map(Vec::len).min().unwrap_or(0);
        let whole = |s: &Stretch| s.kind == StretchKind::Flight && s.end_frame <= frames;
        let stretches = rows.stretches.into_iter().filter(whole).collect();
        Ok(Some(Self { motion: rows.motion, stretches, torques, carried, errors }))
    }
}
