//! Reports the progress of a run: what begins, what ended, and how long the rest will take.

use crate::run_report::TaskReport;
use crate::stages::STAGES;
use aloft_study::recordings::SessionId;
use std::time::Instant;

/// Extent of a run: for each stage, in the order of [`STAGES`], the maximum number of tasks, and
/// how long one took last time.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Plan {
    /// Number of tasks of each stage.
    pub tasks: Vec<usize>,
    /// Mean wall time of a task of each stage in earlier runs, s; none if there were none.
    pub seconds: Vec<Option<f64>>,
}

/// Receives the progress of a run. Methods are called from several threads.
pub trait Progress: Sync {
    /// The run begins.
    fn begin(&self, _plan: &Plan) {}
    /// A stage of a study begins: `settled` tasks are up to date or cannot run, `tasks` are to be
    /// done.
    fn stage(&self, session: &SessionId, name: &'static str, settled: usize, tasks: usize);
    /// A task ended.
    fn task(&self, session: &SessionId, report: &TaskReport);
    /// The run ended.
    fn end(&self) {}
    /// True if the run is to end early. It is asked before each task: tasks that have begun are
    /// completed and kept, and the run ends with [`PipelineError::Stopped`].
    ///
    /// [`PipelineError::Stopped`]: aloft_workspace::error::PipelineError::Stopped
    fn stops(&self) -> bool {
        false
    }
}

/// Ignores all progress.
#[derive(Debug, Clone, Copy, Default)]
pub struct Silent;

impl Progress for Silent {
    fn stage(&self, _study: &SessionId, _name: &'static str, _settled: usize, _tasks: usize) {}
    fn task(&self, _study: &SessionId, _report: &TaskReport) {}
}

#[derive(Debug, Clone, Copy)]
struct StageTimes {
    remaining: usize,
    done: usize,
    seconds: f64,
    before: Option<f64>,
}

/// Estimates the remaining time of a run from the times of completed tasks and of earlier runs.
#[derive(Debug, Clone)]
pub struct Forecast {
    stages: Vec<StageTimes>,
    started: Instant,
}

impl Forecast {
    /// The forecast before anything ran.
    pub fn new(plan: &Plan) -> Self {
        let stages = (0..STAGES.len())
            .map(|i| StageTimes {
                remaining: plan.tasks.get(i).copied().unwrap_or(0),
                done: 0,
                seconds: 0.0,
                before: plan.seconds.get(i).copied().flatten(),
            })
            .collect();
        Self { stages, started: Instant::now() }
    }

    /// Counts tasks of a stage that need not run.
    pub fn settled(&mut self, stage: &str, tasks: usize) {
        if let Some(s) = self.stage(stage) {
            s.remaining = s.remaining.saturating_sub(tasks);
        }
    }

    /// Counts a task of a stage that ended after `seconds`.
    pub fn ended(&mut self, stage: &str, seconds: f64) {
        if let Some(s) = self.stage(stage) {
            s.remaining = s.remaining.saturating_sub(1);
            s.done += 1;
            s.seconds += seconds;
        }
    }

    fn stage(&mut self, name: &str) -> Option<&mut StageTimes> {
        STAGES.iter().position(|s| s.name == name).and_then(|i| self.stages.get_mut(i))
    }

    /// Number of completed tasks and of all planned ones, without those that need not run.
    pub fn tasks(&self) -> (usize, usize) {
        let done: usize = self.stages.iter().map(|s| s.done).sum();
        (done, done + self.stages.iter().map(|s| s.remaining).sum::<usize>())
    }

    /// Remaining time, s; none before the first task ended.
    pub fn seconds_left(&self) -> Option<f64> {
        self.seconds_left_after(self.started.elapsed().as_secs_f64())
    }

    /// The same after `elapsed` seconds since the beginning.
    pub fn seconds_left_after(&self, elapsed: f64) -> Option<f64> {
        let busy: f64 = self.stages.iter().map(|s| s.seconds).sum();
        if busy <= 0.0 || elapsed <= 0.0 {
            return None;
        }
        // the assumed times of stages not yet run are scaled by the ratio of measured to assumed
        // time of the others
        let expected: f64 =
            self.stages.iter().enumerate().map(|(i, s)| s.done as f64 * s.before.unwrap_or(assumed(i))).sum();
        let scale = if expected > 0.0 { busy / expected } else { 1.0 };
        let rest: f64 = self
            .stages
            .iter()
            .enumerate()
            .map(|(i, s)| {
                let one = if s.done > 0 { s.seconds / s.done as f64 } else { scale * s.before.unwrap_or(assumed(i)) };
                s.remaining as f64 * one
            })
            .sum();
        let side_by_side = (busy / elapsed).max(0.25);
        Some(rest / side_by_side)
    }
}

fn assumed(stage: usize) -> f64 {
    STAGES.get(stage).map_or(0.03, |s| s.seconds)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan(import: usize, ik: usize) -> Plan {
        let tasks = STAGES
            .iter()
            .map(|s| match s.name {
                "import" => import,
                "ik" => ik,
                _ => 0,
            })
            .collect();
        Plan { tasks, seconds: Vec::new() }
    }

    #[test]
    fn unit_time_left_follows_the_tasks_that_ended() {
        let mut f = Forecast::new(&plan(10, 0));
        assert_eq!(f.seconds_left_after(1.0), None);
        for _ in 0..4 {
            f.ended("import", 2.0);
        }
        // four tasks of 2 s took 4 s, so two ran in parallel; six tasks are left
        assert!(f.seconds_left_after(4.0).is_some_and(|s| (s - 6.0).abs() < 1e-9));
        assert_eq!(f.tasks(), (4, 10));
        f.settled("import", 6);
        assert!(f.seconds_left_after(4.0).is_some_and(|s| s == 0.0));
    }

    #[test]
    fn unit_a_stage_that_has_not_begun_counts_by_its_usual_share() {
        let mut f = Forecast::new(&plan(2, 2));
        f.ended("import", 0.06);
        f.ended("import", 0.06);
        // import took twice the assumed time, so inverse kinematics is expected to as well: 2 ×
        // 0.30 s, one after the other
        let left = f.seconds_left_after(0.12);
        assert!(left.is_some_and(|s| (s - 0.6).abs() < 1e-9), "{left:?}");
    }
}
