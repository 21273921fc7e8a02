//! The spans of a stored cloud, any of which can be looked at again at any time.

use super::{Extent, Span};
use crate::error::Result;

/// Spans that are kept as long as the run lasts.
pub trait Archive: Send + Sync {
    /// Where the spans lie, in order; nothing before the first of them has been handed out.
    fn extents(&self) -> &[Extent];

    /// Reads a span again, as it was when it was handed out.
    ///
    /// # Errors
    /// If it cannot be read.
    fn read(&self, index: u64) -> Result<Span>;
}
