//! Tells how far a discovery is, and what it knows already.

use std::fmt;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Parts of a discovery, in their order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Part {
    /// Effects of the catalogue are scored.
    #[default]
    Catalogue,
    /// Beyond the catalogue: places, directions and variables are scored in flight.
    Atlas,
    /// Beyond the catalogue: the same in flight and contact together.
    WithContact,
    /// Beyond the catalogue: laws are fitted.
    Laws,
    /// Beyond the catalogue: laws are tried with a delay.
    Delays,
}

impl fmt::Display for Part {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Catalogue => "effects tried",
            Self::Atlas => "links tried beyond the catalogue",
            Self::WithContact => "places tried in flight and contact",
            Self::Laws => "laws tried",
            Self::Delays => "delays tried",
        })
    }
}

/// What a discovery tells while it runs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Told<'w> {
    /// Steps done in the present part, of those expected in it.
    Steps {
        /// The part.
        part: Part,
        /// Steps done.
        done: usize,
        /// Steps expected.
        expected: usize,
    },
    /// What is known so far, in words. The answer may still differ.
    SoFar(&'w str),
}

/// Receives what is told.
pub(crate) type Tell<'a> = &'a (dyn Fn(Told<'_>) + Sync);

/// The time at which the search for laws stops beginning anything new; never without a budget.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Until(Option<Instant>);

impl Until {
    /// The end of a budget (s) that begins now.
    pub fn of(budget_s: Option<f64>) -> Self {
        // none: a budget longer than any run is no budget
        let length = budget_s.and_then(|s| Duration::try_from_secs_f64(s.max(0.0)).ok());
        Self(length.and_then(|length| Instant::now().checked_add(length)))
    }
    /// True once the budget is used up.
    pub fn is_over(&self) -> bool {
        self.0.is_some_and(|end| Instant::now() >= end)
    }
}

/// Counts the steps that were done. Clones count together.
#[derive(Clone, Default)]
pub(crate) struct Counter<'a> {
    tell: Option<Tell<'a>>,
    part: Arc<Mutex<Part>>,
    done: Arc<AtomicUsize>,
    expected: Arc<AtomicUsize>,
}

impl fmt::Debug for Counter<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Counter").field("done", &self.done).field("expected", &self.expected).finish_non_exhaustive()
    }
}

impl<'a> Counter<'a> {
    pub fn new(tell: Tell<'a>) -> Self {
        Self { tell: Some(tell), ..Self::default() }
    }

    /// Sets how many steps are expected from now on in the present part.
    pub fn expect(&self, more: usize) {
        let done = self.done.load(Ordering::Relaxed);
        self.expected.store(done + more, Ordering::Relaxed);
        self.steps(done);
    }

    /// Begins a part of so many steps.
    pub fn begin(&self, part: Part, steps: usize) {
        *self.part.lock().unwrap_or_else(PoisonError::into_inner) = part;
        self.done.store(0, Ordering::Relaxed);
        self.expect(steps);
    }

    /// One step was done.
    pub fn one(&self) {
        let done = self.done.fetch_add(1, Ordering::Relaxed) + 1;
        self.steps(done);
    }

    /// Tells what is known so far.
    pub fn so_far(&self, words: &str) {
        if let Some(tell) = self.tell {
            tell(Told::SoFar(words));
        }
    }

    fn steps(&self, done: usize) {
        if let Some(tell) = self.tell {
            let part = *self.part.lock().unwrap_or_else(PoisonError::into_inner);
            tell(Told::Steps { part, done, expected: self.expected.load(Ordering::Relaxed).max(done) });
        }
    }
}
