//! Work that takes longer than an answer. One worker does one piece after the other, so that no two
//! of them change or copy the workspace at the same time; pages hear of the progress and the
//! result.

use crate::events::ProgressSender;
use crate::state::{Studio, SwitchState};
use aloft_analysis::promise::{Changes, tried};
use aloft_analysis::switches::{Switches, fingerprint};
use aloft_analysis::{discover, effect, own_laws};
use aloft_pipeline::runner::{Selection, run};
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::error::{PipelineError, StageFailure};
use serde::Deserialize;
use serde_json::json;
use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex};

/// A piece of work.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(tag = "job", rename_all = "snake_case", deny_unknown_fields)]
pub(crate) enum Request {
    /// Bring all results up to date.
    Run,
    /// Ask which effects are missing.
    Discover,
    /// Compute a model with all stages, on a copy of the workspace.
    Exact {
        /// Number by which the page recognises the answer.
        ticket: u64,
        /// Keys of the model's effects.
        effects: Vec<String>,
        /// Settings and recordings that differ from the pipeline.
        #[serde(default)]
        changes: Changes,
    },
    /// Make the chosen effects the model, as `effect add` and `effect remove` do.
    Keep {
        /// Keys of the model's effects.
        effects: Vec<String>,
    },
    /// Take the last revision back.
    Undo,
    /// Prepare the switches.
    #[serde(skip)]
    Prepare,
}

impl Request {
    /// Its name in messages to the page.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Run => "run",
            Self::Discover => "discover",
            Self::Exact { .. } => "exact",
            Self::Keep { .. } => "keep",
            Self::Undo => "undo",
            Self::Prepare => "prepare",
        }
    }

    /// True if it changes results, so that the pages have to be read again afterwards.
    fn changes(&self) -> bool {
        matches!(self, Self::Run | Self::Discover | Self::Keep { .. } | Self::Undo)
    }
}

/// Work to do, oldest first, and what is being done.
#[derive(Default)]
pub(crate) struct Queue {
    waiting: Mutex<(VecDeque<Request>, Option<&'static str>)>,
    more: Condvar,
}

impl Queue {
    /// Adds work. Of several exact computations only the newest counts; of equal ones, one.
    pub fn add(&self, job: Request) {
        let mut state = self.waiting.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if matches!(job, Request::Exact { .. }) {
            state.0.retain(|j| !matches!(j, Request::Exact { .. }));
        }
        if !state.0.contains(&job) {
            state.0.push_back(job);
        }
        self.more.notify_one();
    }

    /// Name of the work that is being done, and of what waits.
    pub fn busy(&self) -> Vec<&'static str> {
        let state = self.waiting.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        state.1.into_iter().chain(state.0.iter().map(Request::name)).collect()
    }

    fn next(&self) -> Request {
        let mut state = self.waiting.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        state.1 = None;
        loop {
            if let Some(job) = state.0.pop_front() {
                state.1 = Some(job.name());
                return job;
            }
            state = self.more.wait(state).unwrap_or_else(std::sync::PoisonError::into_inner);
        }
    }
}

/// Starts the worker, with the switches as its first work. It ends with the process.
pub(crate) fn start(studio: &Arc<Studio>) {
    studio.queue.add(Request::Prepare);
    let studio = Arc::clone(studio);
    std::thread::spawn(move || {
        loop {
            let job = studio.queue.next();
            let (name, changes) = (job.name(), job.changes());
            // a defect in one piece of work must not end the worker for all that follows
            let done = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| work(&studio, job)));
            // none: the terminal has the panic's message
            let done = done.unwrap_or_else(|_| {
                Err(PipelineError::request_hint("a computation broke off", "see the terminal of `aloft studio`"))
            });
            if let Err(e) = done {
                let failure = StageFailure::from(e);
                studio.tell("problem", json!({"job": name, "problem": failure.problem, "hint": failure.hint}));
            } else if changes {
                studio.tell("changed", json!({"job": name}));
            }
            if changes {
                studio.queue.add(Request::Prepare);
            }
        }
    });
}

fn work(studio: &Studio, job: Request) -> Result<(), PipelineError> {
    let session = (studio.open)()?;
    let told = ProgressSender::new(studio, job.name());
    match job {
        Request::Run => run(&session, &Selection::default(), &told).map(|_| ()),
        Request::Discover => {
            let options = discover::options(Vec::new(), Vec::new(), false, None);
            let found = discover::discover(&session, &options, &|t| told.discovery(t))?;
            match found.not_computed.first().or(found.not_stored.as_ref()) {
                Some(why) => Err(PipelineError::request_hint(
                    format!("the answer is not whole or could not be stored: {why}"),
                    "make room on the disk or make it writable, and ask again",
                )),
                None => Ok(()),
            }
        }
        Request::Exact { ticket, effects, changes } => {
            let switches = studio.switches()?;
            let chosen = switches.chosen(&effects)?;
            let with = SubjectSession { own_effects: switches.session().own_effects.clone(), ..session };
            let found = tried(&with, chosen, &changes, &told)?;
            studio.tell("exact", json!({"ticket": ticket, "model": found}));
            Ok(())
        }
        Request::Keep { effects } => {
            let held: Vec<String> = session.refreshed()?.effects.iter().map(|e| e.key.clone()).collect();
            for gone in held.iter().filter(|k| !effects.contains(k)) {
                effect::remove(&session, gone, false, &told)?;
            }
            for new in effects.iter().filter(|k| !held.contains(k)) {
                let drafts = studio.drafts();
                let draft = drafts.iter().find(|d| d.spec.id == *new);
                let written = draft.map(|d| own_laws::keep(&session, d)).transpose()?;
                let now = session.with_own_effects_read_again()?;
                if let Err(e) = effect::add(&now, new, &[], false, &told) {
                    // the model does not hold it, so that it stays a draft
                    if let Some(path) = written {
                        aloft_workspace::disk::remove_file(&path)?;
                    }
                    return Err(e);
                }
                studio.change_drafts(|all| all.retain(|d| d.spec.id != *new));
            }
            Ok(())
        }
        Request::Undo => effect::undo(&session, false, &told).map(|_| ()),
        Request::Prepare => {
            prepare(studio, &told);
            Ok(())
        }
    }
}

/// Prepares the switches, unless they are ready for the present results.
fn prepare(studio: &Studio, told: &ProgressSender<'_>) {
    let made = || {
        let session = (studio.open)()?;
        let drafts = studio.drafts();
        let now = fingerprint(&session, &drafts)?;
        if matches!(studio.switch_state(), SwitchState::Ready(_, from) if from == now) {
            return Ok(None);
        }
        studio.set_switch_state(SwitchState::Preparing);
        let ready = Switches::prepare(&session, &drafts, &|done, of| told.count("recordings prepared", done, of))?;
        Ok::<_, PipelineError>(Some(SwitchState::Ready(Arc::new(ready), now)))
    };
    match made() {
        Ok(None) => {}
        Ok(Some(switch_state)) => studio.set_switch_state(switch_state),
        Err(e) => {
            let failure = StageFailure::from(e);
            studio.set_switch_state(SwitchState::Without(failure.problem, failure.hint));
        }
    }
    studio.tell("ready", json!({}));
}
