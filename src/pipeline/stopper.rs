//! The wish that a run ends, which any thread can have at any time.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Asks a run to end. All clones ask the same run; nobody ever waits for it.
#[derive(Debug, Clone, Default)]
pub struct Stopper(Arc<Mutex<Wish>>);

#[derive(Debug, Default)]
struct Wish {
    is_asked: bool,
    deadline: Option<Instant>,
}

impl Stopper {
    /// Asks for nothing more from the source. Windows that are not segmented after so much `patience` are given up; without,
    /// none is.
    pub fn stop(&self, patience: Option<Duration>) {
        let mut wish = self.wish();
        wish.is_asked = true;
        wish.deadline = patience.and_then(|patience| Instant::now().checked_add(patience)).or(wish.deadline);
    }

    /// Whether the run is to end.
    pub fn is_asked(&self) -> bool {
        self.wish().is_asked
    }

    /// When windows that are not segmented yet are given up.
    pub fn deadline(&self) -> Option<Instant> {
        self.wish().deadline
    }

    /// The items of a source up to the one that comes after the wish.
    pub fn until_asked<I: Iterator>(&self, mut items: I) -> impl Iterator<Item = I::Item> + use<I> {
        let stopper = self.clone();
        std::iter::from_fn(move || if stopper.is_asked() { None } else { items.next() })
    }

    fn wish(&self) -> MutexGuard<'_, Wish> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;

    #[test]
    fn a_source_gives_what_came_before_the_wish() {
        let stopper = Stopper::default();
        let mut items = stopper.until_asked(0..);
        assert_eq!(items.next(), Some(0));
        assert!(!stopper.is_asked());
        stopper.clone().stop(None);
        assert_eq!((items.next(), stopper.deadline()), (None, None));
    }

    #[test]
    fn patience_once_given_is_not_taken_back() {
        let stopper = Stopper::default();
        stopper.stop(Some(Duration::ZERO));
        let deadline = stopper.deadline();
        assert!(deadline.is_some_and(|deadline| deadline <= Instant::now()));
        stopper.stop(None);
        assert_eq!(stopper.deadline(), deadline);
    }
}
