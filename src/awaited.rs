//! Whether anybody still waits for what this thread does.
//!
//! A job that was given up, because its run was interrupted or dropped, should end soon. Its answer goes nowhere, so
//! whoever asks [`is_given_up`] in a long loop may leave the loop with any answer.

use std::cell::RefCell;
use std::sync::{Arc, Weak};

thread_local! {
    static WAITER: RefCell<Option<Weak<()>>> = const { RefCell::new(None) };
}

/// Who waits for a job; the job is given up when this is dropped.
#[derive(Debug, Default)]
pub struct Waiter(Arc<()>);

/// A job's view of its waiter.
pub struct Awaited(Weak<()>);

impl Waiter {
    /// What the job takes along.
    pub fn awaited(&self) -> Awaited {
        Awaited(Arc::downgrade(&self.0))
    }
}

impl Awaited {
    /// Does `job` on this thread, which knows meanwhile whether it is still waited for.
    pub fn during<R>(self, job: impl FnOnce() -> R) -> R {
        WAITER.set(Some(self.0));
        let result = job();
        WAITER.set(None);
        result
    }
}

/// Whether this thread works on a job that nobody waits for any more.
pub fn is_given_up() -> bool {
    WAITER.with_borrow(|waiter| waiter.as_ref().is_some_and(|waiter| waiter.strong_count() == 0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_job_is_given_up_when_its_waiter_is_gone() {
        let waiter = Waiter::default();
        waiter.awaited().during(|| {
            assert!(!is_given_up());
            drop(waiter);
            assert!(is_given_up());
        });
        assert!(!is_given_up());
    }
}
