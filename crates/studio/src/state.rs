//! What the server knows.

use crate::events::{BEHIND, Message};
use crate::jobs::Queue;
use aloft_analysis::switches::Switches;
use aloft_study::data_set::DataSet;
use aloft_study::effects::OwnEffect;
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::error::PipelineError;
use std::sync::{Arc, Mutex};
use tokio::sync::broadcast;

/// Opens the study: reads the pipeline again, so that a change of the file is seen.
pub type Opener = Box<dyn Fn() -> Result<SubjectSession, PipelineError> + Send + Sync>;

/// Opens all subjects of the study in the same way.
pub type SetOpener = Box<dyn Fn() -> Result<DataSet, PipelineError> + Send + Sync>;

/// The switches, or why there are none.
#[derive(Clone, Default)]
pub(crate) enum SwitchState {
    /// They are being prepared.
    #[default]
    Preparing,
    /// Ready, for the results of this hash.
    Ready(Arc<Switches>, String),
    /// They cannot be prepared, in words.
    Without(String, Option<String>),
}

/// State of the server, shared by all answers and the worker.
pub(crate) struct Studio {
    pub open: Opener,
    /// The study with all its subjects; none if it has only one.
    pub open_set: Option<SetOpener>,
    pub token: String,
    pub port: u16,
    pub events: broadcast::Sender<Message>,
    pub queue: Queue,
    /// Threads for quick numbers: those of the queue's work may be busy for seconds.
    pub quick: rayon::ThreadPool,
    switch_state: Mutex<SwitchState>,
    /// Laws written in a page and not kept yet.
    drafts: Mutex<Vec<OwnEffect>>,
}

impl Studio {
    pub fn new(
        open: Opener,
        open_set: Option<SetOpener>,
        token: String,
        port: u16,
    ) -> Result<Arc<Self>, rayon::ThreadPoolBuildError> {
        let (events, _) = broadcast::channel(BEHIND);
        Ok(Arc::new(Self {
            open,
            open_set,
            token,
            port,
            events,
            queue: Queue::default(),
            quick: rayon::ThreadPoolBuilder::new().thread_name(|i| format!("quick {i}")).build()?,
            switch_state: Mutex::default(),
            drafts: Mutex::default(),
        }))
    }

    /// Laws written in a page and not kept yet.
    pub fn drafts(&self) -> Vec<OwnEffect> {
        self.drafts.lock().map_or_else(|e| e.into_inner().clone(), |d| d.clone())
    }

    /// Changes them.
    pub fn change_drafts(&self, change: impl FnOnce(&mut Vec<OwnEffect>)) {
        change(&mut self.drafts.lock().unwrap_or_else(std::sync::PoisonError::into_inner));
    }

    pub fn switch_state(&self) -> SwitchState {
        self.switch_state.lock().map_or_else(|e| e.into_inner().clone(), |b| b.clone())
    }

    pub fn set_switch_state(&self, switch_state: SwitchState) {
        match self.switch_state.lock() {
            Ok(mut b) => *b = switch_state,
            Err(e) => *e.into_inner() = switch_state,
        }
    }

    /// The switches, if they are ready.
    pub fn switches(&self) -> Result<Arc<Switches>, PipelineError> {
        match self.switch_state() {
            SwitchState::Ready(switches, _) => Ok(switches),
            SwitchState::Preparing => {
                Err(PipelineError::request_hint("the switches are being prepared", "this takes a few seconds"))
            }
            SwitchState::Without(problem, hint) => Err(PipelineError::Request { problem, hint }),
        }
    }
}
