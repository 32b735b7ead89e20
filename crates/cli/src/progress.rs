//! One progress bar with the time left, shown only on a terminal.

use aloft_pipeline::progress::{Forecast, Plan, Progress};
use aloft_pipeline::runner::{Ended, TaskReport};
use aloft_study::quote::visible;
use aloft_study::recordings::SessionId;
use indicatif::{ProgressBar, ProgressStyle};
use std::sync::Mutex;
use std::time::Duration;

/// A bar for a number of equal steps.
#[derive(Debug)]
pub struct Counted(ProgressBar, Mutex<String>);

impl Counted {
    /// A bar with a name.
    pub fn new(name: &str) -> Self {
        let bar = ProgressBar::new(1);
        // none: only how a bar looks
        if let Ok(style) = ProgressStyle::with_template("{prefix} {bar:30} {pos}/{len}  {eta} left  {elapsed} passed") {
            bar.set_style(style);
        }
        bar.set_prefix(name.trim().to_owned());
        bar.enable_steady_tick(Duration::from_millis(250));
        Self(bar, Mutex::default())
    }
    /// Sets the number of steps done, of all.
    pub fn at(&self, done: usize, all: usize) {
        self.0.set_length(all as u64);
        self.0.set_position(done as u64);
    }
    /// Sets the number of steps done in a part of the work. The time left is not shown: how many
    /// parts follow is not known.
    pub fn in_part(&self, part: &str, done: usize, all: usize) {
        if let Ok(mut last) = self.1.lock()
            && *last != part
        {
            part.clone_into(&mut last);
            // none: only how a bar looks
            if let Ok(style) = ProgressStyle::with_template("{prefix} {bar:30} {pos}/{len} {msg}  {elapsed} passed") {
                self.0.set_style(style);
            }
            self.0.set_message(part.to_owned());
        }
        self.at(done, all);
    }
    /// Writes something above the bar.
    pub fn aside(&self, write: impl FnOnce()) {
        self.0.suspend(write);
    }
}

impl Drop for Counted {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}

/// A line that moves while something is computed whose length is not known, with the time that has
/// passed.
#[derive(Debug)]
pub struct Waiting(ProgressBar);

impl Waiting {
    /// Begins to wait for something with a name.
    pub fn new(name: &str) -> Self {
        let bar = ProgressBar::new_spinner();
        // none: only how a bar looks
        if let Ok(style) = ProgressStyle::with_template("{spinner} {prefix} {elapsed}") {
            bar.set_style(style);
        }
        bar.set_prefix(name.to_owned());
        bar.enable_steady_tick(Duration::from_millis(120));
        Self(bar)
    }
}

impl Drop for Waiting {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}

/// The progress bar of a run.
#[derive(Debug, Default)]
pub struct Bars {
    current: Mutex<Option<(ProgressBar, Forecast)>>,
}

impl Bars {
    fn show(&self, change: impl FnOnce(&mut Forecast) -> String) {
        let Ok(mut current) = self.current.lock() else { return };
        let Some((bar, forecast)) = current.as_mut() else { return };
        let message = change(forecast);
        let (done, all) = forecast.tasks();
        bar.set_length(all as u64);
        bar.set_position(done as u64);
        bar.set_prefix(forecast.seconds_left().map_or(String::new(), |s| format!("{} left", duration(s))));
        bar.set_message(visible(&message));
    }
}

/// A duration in readable form.
fn duration(seconds: f64) -> String {
    let s = seconds.round().max(0.0) as u64;
    match s {
        0..60 => format!("{s} s"),
        60..3600 => format!("{} min {:02} s", s / 60, s % 60),
        _ => format!("{} h {:02} min", s / 3600, s / 60 % 60),
    }
}

impl Progress for Bars {
    fn begin(&self, plan: &Plan) {
        let bar = ProgressBar::new(plan.tasks.iter().sum::<usize>() as u64);
        // none: only how a bar looks
        if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos}/{len}  {prefix}  {msg}") {
            bar.set_style(style);
        }
        if let Ok(mut current) = self.current.lock() {
            *current = Some((bar, Forecast::new(plan)));
        }
    }

    fn stage(&self, session: &SessionId, name: &'static str, settled: usize, _tasks: usize) {
        self.show(|f| {
            f.settled(name, settled);
            format!("{name} {session}")
        });
    }

    fn task(&self, session: &SessionId, report: &TaskReport) {
        self.show(|f| {
            f.ended(report.stage, report.seconds);
            let word = if matches!(report.ended, Ended::Failed(_)) { " failed" } else { "" };
            format!("{} {session} {}{word}", report.stage, report.trial)
        });
    }

    fn end(&self) {
        if let Ok(mut current) = self.current.lock()
            && let Some((bar, _)) = current.take()
        {
            bar.finish_and_clear();
        }
    }
}
