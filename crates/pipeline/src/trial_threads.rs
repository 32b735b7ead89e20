//! Processes trials in parallel, at most one per thread.
//!
//! A rayon thread that waits inside one trial would start a second one, and inside that a third, so
//! that all their recordings would be in memory at once. Here each trial has one thread to itself,
//! and the loops inside it run on that thread.

use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Condvar, Mutex, PoisonError};

/// Threads that are assigned one at a time; shared by all studies of a run.
pub struct TrialThreads {
    threads: usize,
    free: Mutex<Vec<ThreadPool>>,
    freed: Condvar,
    studies: usize,
}

impl TrialThreads {
    /// As many single threads as rayon has, for `studies` studies in parallel.
    pub fn new(studies: usize) -> Self {
        let threads = rayon::current_num_threads();
        let pools: Vec<ThreadPool> =
            // none: fewer threads give the same results
            (0..threads).filter_map(|_| ThreadPoolBuilder::new().num_threads(1).build().ok()).collect();
        Self { threads: pools.len(), free: Mutex::new(pools), freed: Condvar::new(), studies: studies.max(1) }
    }

    /// One study's share of a resource that all studies together may use `of_all` times; at least
    /// one.
    pub fn share(&self, of_all: usize) -> usize {
        (of_all / self.studies).max(1)
    }

    /// Calls `work` for every item; results are in the order of the items. If there are fewer items
    /// than threads, rayon distributes the work over all threads instead.
    pub fn each<T: Sync, R: Send>(&self, items: &[T], work: impl Fn(&T) -> R + Sync) -> Vec<R> {
        if items.len() < self.threads || self.threads < 2 {
            return items.par_iter().map(&work).collect();
        }
        let next = AtomicUsize::new(0);
        let slots: Vec<Mutex<Option<R>>> = items.iter().map(|_| Mutex::new(None)).collect();
        std::thread::scope(|scope| {
            for _ in 0..self.threads {
                scope.spawn(|| {
                    while let Some((item, slot)) = {
                        let i = next.fetch_add(1, Ordering::Relaxed);
                        items.get(i).zip(slots.get(i))
                    } {
                        let pool = self.take();
                        let result = pool.install(|| work(item));
                        self.give(pool);
                        *slot.lock().unwrap_or_else(PoisonError::into_inner) = Some(result);
                    }
                });
            }
        });
        slots.into_iter().filter_map(|s| s.into_inner().unwrap_or_else(PoisonError::into_inner)).collect()
    }

    fn take(&self) -> ThreadPool {
        let mut free = self.free.lock().unwrap_or_else(PoisonError::into_inner);
        loop {
            match free.pop() {
                Some(pool) => return pool,
                None => free = self.freed.wait(free).unwrap_or_else(PoisonError::into_inner),
            }
        }
    }

    fn give(&self, pool: ThreadPool) {
        self.free.lock().unwrap_or_else(PoisonError::into_inner).push(pool);
        self.freed.notify_one();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_more_at_once_than_threads_and_in_order() {
        let pool = ThreadPoolBuilder::new().num_threads(3).build();
        let threads = pool.map(|p| p.install(|| TrialThreads::new(2))).unwrap_or_else(|_| TrialThreads::new(2));
        let (now, most) = (AtomicUsize::new(0), AtomicUsize::new(0));
        let items: Vec<usize> = (0..60).collect();
        let work = |i: &usize| {
            most.fetch_max(now.fetch_add(1, Ordering::SeqCst) + 1, Ordering::SeqCst);
            let sum: usize = (0..2000usize).into_par_iter().map(|k| k % (i + 1)).sum();
            now.fetch_sub(1, Ordering::SeqCst);
            sum
        };
        let plain: Vec<usize> = items.iter().map(|i| (0..2000).map(|k| k % (i + 1)).sum()).collect();
        // two studies share the threads
        std::thread::scope(|scope| {
            for _ in 0..2 {
                scope.spawn(|| assert_eq!(threads.each(&items, work), plain));
            }
        });
        assert!(most.load(Ordering::SeqCst) <= 3);
        assert_eq!(threads.each(&items[..2], |i| *i), [0, 1]);
        assert_eq!([64, 3, 1, 0].map(|all| threads.share(all)), [32, 1, 1, 1]);
    }
}
