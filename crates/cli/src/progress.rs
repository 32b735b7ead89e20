//! Progress bars, on a terminal only; failures are told as they happen.

use aloft_pipeline::runner::{Ended, Progress, TaskReport};
use indicatif::{ProgressBar, ProgressStyle};
use std::sync::Mutex;

/// One bar for a number of equal steps.
#[derive(Debug)]
pub struct Counted(ProgressBar);

impl Counted {
    /// A bar with a name.
    pub fn new(name: &str) -> Self {
        let bar = ProgressBar::new(1);
        if let Ok(style) = ProgressStyle::with_template("{prefix:>10} {bar:30} {pos}/{len} {eta}") {
            bar.set_style(style);
        }
        bar.set_prefix(name.to_owned());
        Self(bar)
    }
    /// So many steps of all are done.
    pub fn at(&self, done: usize, all: usize) {
        self.0.set_length(all as u64);
        self.0.set_position(done as u64);
    }
}

impl Drop for Counted {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}

/// One bar a stage.
#[derive(Debug, Default)]
pub struct Bars {
    current: Mutex<Option<ProgressBar>>,
}

impl Progress for Bars {
    fn stage(&self, name: &str, tasks: usize) {
        let bar = ProgressBar::new(tasks as u64);
        if let Ok(style) = ProgressStyle::with_template("{prefix:>10} {bar:30} {pos}/{len} {eta} {msg}") {
            bar.set_style(style);
        }
        bar.set_prefix(name.to_owned());
        if let Ok(mut current) = self.current.lock() {
            if let Some(old) = current.take() {
                old.finish_and_clear();
            }
            *current = Some(bar);
        }
    }

    fn task(&self, report: &TaskReport) {
        let Ok(current) = self.current.lock() else { return };
        let Some(bar) = current.as_ref() else { return };
        bar.set_message(report.trial.clone());
        bar.inc(1);
        if let Ended::Failed(_) = report.ended {
            bar.set_message(format!("{} failed", report.trial));
        }
        if bar.position() == bar.length().unwrap_or(0) {
            bar.finish_and_clear();
        }
    }
}
