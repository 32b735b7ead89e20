//! Tells how far a discovery is: effects scored, of those expected.

use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

/// Receives the number of effects scored and of those expected.
type Told<'a> = &'a (dyn Fn(usize, usize) + Sync);

/// The time at which the search for laws stops beginning anything new; never without a budget.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Until(Option<Instant>);

impl Until {
    /// The end of a budget (s) that begins now.
    pub fn of(budget_s: Option<f64>) -> Self {
        let length = budget_s.and_then(|s| Duration::try_from_secs_f64(s.max(0.0)).ok());
        Self(length.and_then(|length| Instant::now().checked_add(length)))
    }
    /// True once the budget is used up.
    pub fn is_over(&self) -> bool {
        self.0.is_some_and(|end| Instant::now() >= end)
    }
}

/// Counts the effects that were scored. Clones count together.
#[derive(Clone, Default)]
pub(crate) struct Counter<'a> {
    told: Option<Told<'a>>,
    done: Arc<AtomicUsize>,
    expected: Arc<AtomicUsize>,
}

impl fmt::Debug for Counter<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Counter").field("done", &self.done).field("expected", &self.expected).finish_non_exhaustive()
    }
}

impl<'a> Counter<'a> {
    pub fn new(told: Told<'a>) -> Self {
        Self { told: Some(told), ..Self::default() }
    }

    /// Sets how many effects are expected to be scored from now on.
    pub fn expect(&self, more: usize) {
        let done = self.done.load(Ordering::Relaxed);
        self.expected.store(done + more, Ordering::Relaxed);
        self.tell(done);
    }

    /// One effect was scored.
    pub fn one(&self) {
        let done = self.done.fetch_add(1, Ordering::Relaxed) + 1;
        self.tell(done);
    }

    fn tell(&self, done: usize) {
        if let Some(told) = self.told {
            told(done, self.expected.load(Ordering::Relaxed).max(done));
        }
    }
}
