//! `parameters --assess` for robots: trajectories of the joints for the flights to record next.
//!
//! Limits, noise, posture and turn come from the recordings where nothing states them. The
//! trajectories are written to `next_flights` in the workspace as CSV, and with `--next-flights
//! DIR` to a folder of the user's.

use crate::assess;
use crate::results::Made;
use aloft_body::{BaseParameters, Motion, Phi, State, Subject};
use aloft_identify::{Design, Parameters, Prior};
use aloft_pipeline::factors::load_factors;
use aloft_pipeline::stages::regressor::{self, row_noise, weak_options};
use aloft_pipeline::stages::robot::load_log;
use aloft_regressor::{Factor, Stretch, StretchKind};
pub use aloft_robot::next::{Expected, NextFlights};
use aloft_robot::next::{Extents, FrameErrors, JointLimits, PlanInput, PlanOptions, Seen, plan};
use aloft_signal::{median, quantile_of_sorted};
use aloft_study::config::RobotConfig;
use aloft_study::robot::RobotSetup;
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::disk;
use aloft_workspace::error::{PipelineError, StageFailure};
use aloft_workspace::theirs::write_new;
use std::path::{Path, PathBuf};

/// Frames from one posture to the next that is compared with planned ones.
const EVERY: usize = 10;
/// Duration of the beginning of a flight over which the base's turn is measured, s.
const START_S: f64 = 0.05;
/// Torques of this many in a thousand samples count as possible: contact gives single higher ones.
const MOST: usize = 999;

/// How notes on plans begin.
const NOTE: &str = "flights to record next";

/// Everything that a plan needs.
pub(crate) struct PlanInputs<'a> {
    pub made: &'a Made<'a>,
    pub setup: &'a RobotSetup,
    pub config: &'a RobotConfig,
    pub subject: &'a Subject,
    pub base: &'a BaseParameters,
    pub prior: &'a Prior,
    /// Parameters with which rows are formed.
    pub phi: &'a [Phi],
    pub parameters: &'a Parameters,
    /// Motion and flights of each recording.
    pub recorded: &'a [(&'a Motion, &'a [Stretch])],
}

fn stop(e: impl std::fmt::Display) -> StageFailure {
    StageFailure::new(e.to_string())
}

fn folder(session: &SubjectSession) -> PathBuf {
    session.workspace.join("next_flights")
}

impl PlanInputs<'_> {
    /// The plan, or none with a note why.
    pub fn plan_or_note(&self, notes: &mut Vec<String>) -> Option<NextFlights> {
        let why = match self.plan() {
            Ok(Some(found)) => return Some(found),
            Ok(None) => format!(
                "none was found within the limits of the joints that is long enough for rows (flights of {:.2} s)",
                self.duration()
            ),
            Err(failure) => failure.problem,
        };
        notes.push(format!("{NOTE}: {why}"));
        None
    }

    /// Plans flights and writes their trajectories to the workspace; none if no flight keeps the
    /// limits.
    fn plan(&self) -> Result<Option<NextFlights>, StageFailure> {
        let (model, robot) = (&self.subject.model, &self.setup.model);
        let phi: Vec<Phi> = self.parameters.links.iter().map(|l| l.inertia().to_phi()).collect();
        if phi.len() != model.n_links() {
            return Err(StageFailure::new("the identification gave no links"));
        }
        let mut recorded: Vec<(String, Factor)> = Vec::new();
        for (motion, _) in self.recorded {
            for (stretch, factor) in load_factors(&self.made.results.place("regressor", &motion.trial)?)? {
                if stretch.kind == StretchKind::Flight {
                    let plain = factor.with_effects(&[]).map_err(stop)?;
                    recorded.push((format!("flight {} of {}", stretch.index + 1, motion.trial), plain));
                }
            }
        }
        let weak = weak_options(self.made.session.config.regressor.window_s);
        let params = regressor::Params::of(self.made.session, None);
        let sd = self.deviations();
        let noise = row_noise(&params, self.subject, params.marker_sd_m).map(|n| FrameErrors {
            sd: &sd,
            slow: n.slow,
            slow_time_s: n.slow_time_s,
        });
        let (limits, mut notes) = JointLimits::of(robot, &self.seen()?, self.config.limit_share, self.config.faster);
        let links: Vec<_> = self.parameters.links.iter().map(aloft_identify::LinkEstimate::inertia).collect();
        let mut extents = Extents::of(model, &links, &robot.collision, self.config.clearance_m);
        if !robot.collision_meshes.is_empty() {
            notes.push(format!(
                "collision meshes are not read ({}): links without other collision geometry are spheres as thick as their mass and inertia",
                robot.collision_meshes.join(", ")
            ));
        }
        let mut state = State::new(model);
        for (motion, flights) in self.recorded {
            for frame in flights.iter().flat_map(|s| (s.first_frame..s.end_frame).step_by(EVERY)) {
                if motion.is_valid(frame) {
                    state.forward_position(model, motion.q(frame));
                    extents.allow(&state);
                }
            }
        }
        let rate_hz = self.recorded.iter().map(|r| r.0.rate_hz).fold(0.0, f64::max);
        let stated = self.config.next_turn_rad_s;
        let options = PlanOptions {
            flights: self.config.next_flights,
            flight_s: self.duration(),
            turn_rad_s: if stated > 0.0 { stated } else { self.largest_turn() },
            ..PlanOptions::default()
        };
        let units: Vec<String> = self.parameters.base.iter().map(|b| b.unit.clone()).collect();
        let input = PlanInput {
            robot,
            model,
            base: self.base,
            prior: self.phi,
            phi: &phi,
            before: Design::of_prior(self.prior, self.subject.facts.mass_kg, self.parameters.row_sd).map_err(stop)?,
            recorded: &recorded,
            weak,
            noise,
            rate_hz,
            hold: &self.posture(),
            limits: &limits,
            extents: &extents,
            units: &units,
        };
        let Some(mut found) = plan(&input, options).map_err(stop)? else { return Ok(None) };
        found.notes = notes;
        write(&folder(self.made.session), &found, self.setup, rate_hz)?;
        Ok(Some(found))
    }

    /// Frames of all flights.
    fn frames(&self) -> impl Iterator<Item = (&Motion, usize)> {
        self.recorded.iter().flat_map(|(motion, flights)| {
            let frames = flights.iter().flat_map(|s| s.first_frame..s.end_frame);
            frames.filter(|f| motion.is_valid(*f)).map(|f| (*motion, f))
        })
    }

    /// Median deviation of each velocity's direction in a frame of the flights.
    fn deviations(&self) -> Vec<f64> {
        let nv = self.subject.model.nv;
        (0..nv)
            .map(|k| {
                median(&mut self.frames().filter_map(|(m, f)| m.q_sd.get(f * nv + k).copied()).collect::<Vec<_>>())
            })
            .collect()
    }

    /// Median of each joint's coordinate in the flights.
    fn posture(&self) -> Vec<f64> {
        let joints = self.subject.model.links.iter().filter(|l| l.joint.kind.nq() == 1);
        joints.map(|l| median(&mut self.frames().map(|(m, f)| m.q(f)[l.joint.q_offset]).collect::<Vec<_>>())).collect()
    }

    /// Duration of a planned flight: as stated, or the median of the recordings.
    fn duration(&self) -> f64 {
        if self.config.next_flight_s > 0.0 {
            return self.config.next_flight_s;
        }
        let mut all: Vec<f64> = self
            .recorded
            .iter()
            .flat_map(|(m, flights)| flights.iter().map(|s| (s.end_frame - s.first_frame) as f64 / m.rate_hz))
            .collect();
        (100.0 * median(&mut all)).round() / 100.0
    }

    /// Largest turn of the base at the beginning of a flight, rad/s.
    fn largest_turn(&self) -> f64 {
        let model = &self.subject.model;
        let mut change = vec![0.0; model.nv];
        let mut largest: f64 = 0.0;
        for (motion, flights) in self.recorded {
            let steps = (START_S * motion.rate_hz).round().max(1.0) as usize;
            for s in *flights {
                let (a, b) = (s.first_frame, s.first_frame + steps);
                if b < s.end_frame && motion.is_valid(a) && motion.is_valid(b) {
                    model.difference(motion.q(a), motion.q(b), &mut change);
                    let turn = change[3..6].iter().map(|x| x * x).sum::<f64>().sqrt();
                    largest = largest.max(turn * motion.rate_hz / steps as f64);
                }
            }
        }
        largest
    }

    /// Ranges, rates and torques of the joints in all recordings with flights.
    fn seen(&self) -> Result<Vec<Seen>, StageFailure> {
        let joints = self.setup.model.joints.len();
        let mut out = vec![Seen { range: (f64::INFINITY, f64::NEG_INFINITY), rate: 0.0, effort: None }; joints];
        for (motion, flights) in self.recorded {
            let (log, _) = load_log(self.setup, self.made.results, &motion.trial)?;
            for (j, seen) in out.iter_mut().enumerate() {
                for q in log.q[j].iter().filter(|q| q.is_finite()) {
                    seen.range = (seen.range.0.min(*q), seen.range.1.max(*q));
                }
                let mut torque: Vec<f64> = log.torque[j].iter().map(|t| t.abs()).filter(|t| t.is_finite()).collect();
                torque.sort_by(f64::total_cmp);
                if let Some(most) = quantile_of_sorted(&torque, MOST, 1000) {
                    seen.effort = Some(seen.effort.unwrap_or(0.0).max(most));
                }
            }
            let places: Vec<usize> =
                self.subject.model.links.iter().filter(|l| l.joint.kind.nq() == 1).map(|l| l.joint.q_offset).collect();
            // differences over a hundredth of a second: encoders have steps
            let reach = (0.01 * motion.rate_hz).round().max(1.0) as usize;
            for s in *flights {
                for f in s.first_frame..s.end_frame.saturating_sub(reach) {
                    if motion.is_valid(f) && motion.is_valid(f + reach) {
                        for (seen, at) in out.iter_mut().zip(&places) {
                            let rate =
                                (motion.q(f + reach)[*at] - motion.q(f)[*at]).abs() * motion.rate_hz / reach as f64;
                            seen.rate = seen.rate.max(rate);
                        }
                    }
                }
            }
        }
        Ok(out)
    }
}

fn write(folder: &Path, found: &NextFlights, setup: &RobotSetup, rate_hz: f64) -> Result<(), PipelineError> {
    disk::create_dir_all(folder)?;
    for flight in &found.flights {
        disk::write_whole(&folder.join(&flight.file), flight.wave.csv(&setup.model, rate_hz).as_bytes())?;
    }
    Ok(())
}

/// Copies the planned trajectories to a folder of the user's, which may hold other files.
///
/// # Errors
/// A request without a robot, one for which no flight was planned, and a file that is there
/// already.
pub fn copy_to(session: &SubjectSession, dir: &Path) -> Result<Vec<PathBuf>, PipelineError> {
    refuse_without_robot(session)?;
    let found = assess::stored(session)?;
    let noted = found.iter().flat_map(|a| &a.notes).find(|n| n.starts_with(NOTE)).cloned();
    let plan = found.and_then(|a| a.next_flights).ok_or_else(|| {
        PipelineError::request_hint(
            noted.unwrap_or_else(|| format!("{NOTE}: none were planned")),
            "`robot: {next_flight_s: …, limit_share: …, faster: …}` in the pipeline sets what a planned flight may do",
        )
    })?;
    // a study of several robots: a folder for each
    let own = session.id.subject.as_ref().map(|_| dir.join(session.id.to_string().replace('/', "_")));
    let dir = own.as_deref().unwrap_or(dir);
    disk::create_dir_all(dir)?;
    let targets: Vec<PathBuf> = plan.flights.iter().map(|f| dir.join(&f.file)).collect();
    if let Some(there) = targets.iter().find(|t| t.symlink_metadata().is_ok()) {
        return Err(PipelineError::request_hint(
            format!("{} is there already; nothing was written", there.display()),
            "name an empty folder",
        ));
    }
    for (flight, target) in plan.flights.iter().zip(&targets) {
        let source = folder(session).join(&flight.file);
        write_new(target, &disk::read(&source)?)?;
    }
    Ok(targets)
}

/// Refuses a study without a robot.
///
/// # Errors
/// A study of a person or an object.
pub fn refuse_without_robot(session: &SubjectSession) -> Result<(), PipelineError> {
    if session.robot.is_some() {
        return Ok(());
    }
    Err(PipelineError::request_hint(
        format!(
            "`--next-flights` writes trajectories for a robot's joints, and {} has no `robot`",
            session.config_path.display()
        ),
        "`--assess` alone ranks motions for people and objects",
    ))
}
