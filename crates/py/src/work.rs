//! Work without the interpreter's lock: a job runs in a thread of its own, while the calling thread
//! passes its progress to Python and watches for Ctrl-C.

use crate::errors::{defect, raise};
use aloft_discover::Told;
use aloft_pipeline::progress::{Forecast, Plan, Progress};
use aloft_pipeline::runner::TaskReport;
use aloft_study::recordings::SessionId;
use aloft_workspace::error::PipelineError;
use pyo3::prelude::*;
use std::any::Any;
use std::panic::resume_unwind;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// How long Ctrl-C may wait before it is noticed.
const WATCH: Duration = Duration::from_millis(50);

/// Stack of a job: that of a main thread on most systems, where the command line runs it.
const STACK_BYTES: usize = 8 << 20;

/// One step of a job.
#[derive(Debug, Clone, Default)]
pub struct Step {
    /// Stage, or what is done.
    what: String,
    /// Subject and session, in a study of several.
    of: String,
    /// Trial, if it is one trial's.
    trial: Option<String>,
    done: usize,
    total: usize,
    seconds_left: Option<f64>,
    /// What is known already, in words.
    so_far: Option<String>,
}

/// Payload with which a job unwinds when it is to stop inside a computation that reports its
/// progress but cannot return early. `resume_unwind` calls no panic hook, and nothing is printed.
struct Stopping;

/// Where a job reports its progress.
pub struct Reporter {
    steps: mpsc::Sender<Step>,
    stop: Arc<AtomicBool>,
    forecast: Mutex<Option<Forecast>>,
}

impl Reporter {
    fn tell(&self, what: &str, of: &SessionId, trial: Option<&str>, change: impl FnOnce(&mut Forecast)) {
        let Ok(mut forecast) = self.forecast.lock() else { return };
        let Some(forecast) = forecast.as_mut() else { return };
        change(forecast);
        let (done, total) = forecast.tasks();
        let step = Step {
            what: what.to_owned(),
            of: of.to_string(),
            trial: trial.map(str::to_owned),
            done,
            total,
            seconds_left: forecast.seconds_left(),
            so_far: None,
        };
        // the caller has gone after a second Ctrl-C
        let _ = self.steps.send(step);
    }

    /// Reports a number of equal steps; ends the computation if it is to stop.
    pub fn counted(&self, what: &'static str) -> impl Fn(usize, usize) + Sync + '_ {
        // a sender cannot be shared between threads
        let steps = Mutex::new(self.steps.clone());
        move |done, total| self.send(&steps, Step { what: what.to_owned(), done, total, ..Step::default() })
    }

    /// Reports the steps of a discovery and what it knows already; ends it if it is to stop.
    pub fn discovery(&self) -> impl Fn(Told<'_>) + Sync + '_ {
        let steps = Mutex::new(self.steps.clone());
        let last = Mutex::new((0, 0));
        move |told| {
            let Ok(mut last) = last.lock() else { return };
            let so_far = match told {
                Told::Steps { done, expected, .. } => {
                    *last = (done, expected);
                    None
                }
                Told::SoFar(words) => Some(words.to_owned()),
            };
            let (done, total) = *last;
            drop(last);
            self.send(&steps, Step { what: "discover".to_owned(), done, total, so_far, ..Step::default() });
        }
    }

    fn send(&self, steps: &Mutex<mpsc::Sender<Step>>, step: Step) {
        if self.stop.load(Ordering::Relaxed) {
            resume_unwind(Box::new(Stopping));
        }
        if let Ok(steps) = steps.lock() {
            let _ = steps.send(step);
        }
    }
}

impl Progress for Reporter {
    fn begin(&self, plan: &Plan) {
        if let Ok(mut forecast) = self.forecast.lock() {
            *forecast = Some(Forecast::new(plan));
        }
    }

    fn stage(&self, session: &SessionId, name: &'static str, settled: usize, _tasks: usize) {
        self.tell(name, session, None, |f| f.settled(name, settled));
    }

    fn task(&self, session: &SessionId, report: &TaskReport) {
        self.tell(report.stage, session, Some(&report.trial), |f| f.ended(report.stage, report.seconds));
    }

    fn stops(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

/// Runs a job without the interpreter's lock. `progress` is called in the calling thread with
/// `(what, of, trial, done, total, seconds_left, so_far)`. Ctrl-C, or an error of `progress`, asks
/// the job to stop and is raised when it has; a second Ctrl-C is raised at once, and what the job
/// still computes goes on in its thread.
pub fn work<T: Send + 'static>(
    py: Python<'_>,
    progress: Option<Bound<'_, PyAny>>,
    job: impl FnOnce(&Reporter) -> Result<T, PipelineError> + Send + 'static,
) -> PyResult<T> {
    refuse_after_fork(py)?;
    let stop = Arc::new(AtomicBool::new(false));
    let (steps, told) = mpsc::channel();
    let reporter = Reporter { steps, stop: stop.clone(), forecast: Mutex::new(None) };
    let thread = std::thread::Builder::new()
        .name("aloft".to_owned())
        .stack_size(STACK_BYTES)
        // the reporter is dropped with the closure, which ends the loop below
        .spawn(move || job(&reporter))
        .map_err(|e| raise(py, &PipelineError::request(format!("cannot begin a thread: {e}"))))?;
    let mut problem: Option<PyErr> = None;
    let mut told = told;
    loop {
        let step;
        (step, told) = py.detach(move || (told.recv_timeout(WATCH), told));
        let answer = match (&step, &progress, &problem) {
            (Ok(s), Some(call), None) => {
                call.call1((&s.what, &s.of, &s.trial, s.done, s.total, s.seconds_left, &s.so_far)).map(drop)
            }
            _ => Ok(()),
        };
        if let Err(e) = answer.and_then(|()| py.check_signals()) {
            if problem.is_some() {
                return Err(e);
            }
            stop.store(true, Ordering::Relaxed);
            problem = Some(e);
        }
        if matches!(step, Err(RecvTimeoutError::Disconnected)) {
            break;
        }
    }
    let done = py.detach(|| thread.join());
    match (problem, done) {
        // the job may have ended by itself before it noticed; what was asked for is the same
        (Some(e), _) => Err(e),
        (None, Ok(Ok(answer))) => Ok(answer),
        (None, Ok(Err(e))) => Err(raise(py, &e)),
        (None, Err(panic)) => Err(defect(py, &panic_message(panic.as_ref()))),
    }
}

fn panic_message(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("no message").to_owned()
}

/// Refuses to work in a process that was forked after its parent worked: threads are not copied by
/// a fork, and a job would wait for them forever.
fn refuse_after_fork(py: Python<'_>) -> PyResult<()> {
    static FIRST: AtomicU32 = AtomicU32::new(0);
    let now = std::process::id();
    match FIRST.compare_exchange(0, now, Ordering::Relaxed, Ordering::Relaxed) {
        Err(first) if first != now => Err(raise(
            py,
            &PipelineError::request_hint(
                "this process was forked after aloft had worked in its parent, and has none of its threads",
                "begin processes with multiprocessing.get_context(\"spawn\")",
            ),
        )),
        _ => Ok(()),
    }
}
