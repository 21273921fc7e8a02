//! Which process something belongs to.
//!
//! A forked process has a copy of a run, but not its threads, and it shares the places in its files. So it can neither go on
//! with the run nor end it.

use pyo3::prelude::*;

use super::errors::StreamInUse;

/// The process that something was made in.
#[derive(Clone, Copy)]
pub(super) struct Home {
    what: &'static str,
    process: u32,
}

impl Home {
    /// This process is home to `what`.
    pub(super) fn of(what: &'static str) -> Self {
        Self { what, process: std::process::id() }
    }

    /// Whether this still is that process.
    pub(super) fn is_here(self) -> bool {
        std::process::id() == self.process
    }

    /// Refuses to go on in another process.
    pub(super) fn check(self) -> PyResult<()> {
        if self.is_here() {
            return Ok(());
        }
        let (what, process) = (self.what, self.process);
        Err(StreamInUse::new_err(format!(
            "{what} belongs to process {process}; a forked process cannot go on with it, so open it anew there"
        )))
    }

    /// Keeps `owner` for ever in any other process: to let go of it would end threads that are not there.
    pub(super) fn keep_elsewhere<T>(self, owner: &std::sync::Arc<T>) {
        if !self.is_here() {
            std::mem::forget(std::sync::Arc::clone(owner));
        }
    }
}
