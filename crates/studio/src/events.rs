//! What the server tells every open page by itself: the progress of its work, and results.

use crate::state::Studio;
use aloft_discover::Told;
use aloft_pipeline::progress::{Forecast, Plan, Progress};
use aloft_pipeline::runner::{Ended, TaskReport};
use aloft_study::recordings::SessionId;
use axum::response::sse;
use futures_util::stream::{Stream, unfold};
use serde_json::{Value, json};
use std::convert::Infallible;
use std::sync::Mutex;
use std::time::{Duration, Instant};
use tokio::sync::broadcast;
use tokio::sync::broadcast::error::RecvError;

/// Name and JSON of one event.
pub(crate) type Message = (&'static str, String);

/// Number of events that a slow page may be behind before it misses some.
pub(crate) const BEHIND: usize = 256;

/// The events from now on as a stream of server-sent events.
pub(crate) fn stream(from: broadcast::Receiver<Message>) -> impl Stream<Item = Result<sse::Event, Infallible>> {
    unfold(from, |mut from| async move {
        loop {
            match from.recv().await {
                Ok((name, data)) => return Some((Ok(sse::Event::default().event(name).data(data)), from)),
                // what was missed is progress; the page asks for the state when a job ends
                Err(RecvError::Lagged(_)) => {}
                Err(RecvError::Closed) => return None,
            }
        }
    })
}

/// Tells all pages how far a job is.
pub(crate) struct ProgressSender<'a> {
    studio: &'a Studio,
    job: &'static str,
    forecast: Mutex<Option<Forecast>>,
    last: Mutex<Option<Instant>>,
}

/// Shortest time between two messages about the same job.
const PAUSE: Duration = Duration::from_millis(80);

impl<'a> ProgressSender<'a> {
    pub fn new(studio: &'a Studio, job: &'static str) -> Self {
        Self { studio, job, forecast: Mutex::new(None), last: Mutex::new(None) }
    }

    /// Tells a count.
    pub fn count(&self, words: &str, done: usize, of: usize) {
        self.tell(words, done, of, None);
    }

    /// Tells how far a discovery is, or what it knows already.
    pub fn discovery(&self, told: Told<'_>) {
        match told {
            Told::Steps { part, done, expected } => self.count(&part.to_string(), done, expected),
            Told::SoFar(words) => self.studio.tell("so_far", json!({"job": self.job, "words": words})),
        }
    }

    fn tell(&self, words: &str, done: usize, of: usize, seconds_left: Option<f64>) {
        let Ok(mut last) = self.last.lock() else { return };
        if done < of && last.is_some_and(|l| l.elapsed() < PAUSE) {
            return;
        }
        *last = Some(Instant::now());
        let seconds_left = seconds_left.filter(|s| s.is_finite());
        let data = json!({"job": self.job, "words": words, "done": done, "of": of, "seconds_left": seconds_left});
        self.studio.tell("progress", data);
    }

    fn step(&self, words: &str, change: impl FnOnce(&mut Forecast)) {
        let Ok(mut forecast) = self.forecast.lock() else { return };
        let Some(forecast) = forecast.as_mut() else { return };
        change(forecast);
        let (done, of) = forecast.tasks();
        self.tell(words, done, of, forecast.seconds_left());
    }
}

impl Progress for ProgressSender<'_> {
    fn begin(&self, plan: &Plan) {
        if let Ok(mut forecast) = self.forecast.lock() {
            *forecast = Some(Forecast::new(plan));
        }
    }
    fn stage(&self, _: &SessionId, name: &'static str, settled: usize, _: usize) {
        self.step(name, |f| f.settled(name, settled));
    }
    fn task(&self, _: &SessionId, report: &TaskReport) {
        if matches!(report.ended, Ended::Ran | Ended::Failed(_)) {
            self.step(report.stage, |f| f.ended(report.stage, report.seconds));
        }
    }
}

impl Studio {
    /// Tells all open pages.
    pub(crate) fn tell(&self, name: &'static str, data: Value) {
        // no page is connected
        let _ = self.events.send((name, data.to_string()));
    }
}
