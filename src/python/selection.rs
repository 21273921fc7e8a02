//! Which segments a run keeps in the end: the options that every segmentor has, and what they come to.

use std::collections::BTreeMap;

use super::spans::count;
use crate::error::Result;
use crate::label::ByCause;
use crate::size::{SizeLimits, Sort};
use crate::weaver::{Aliases, Selection};

/// The limits of size and the order that were asked for.
#[derive(Debug, Clone, Copy)]
pub(super) struct SizeOptions {
    pub(super) limits: SizeLimits,
    pub(super) sort: Sort,
}

impl SizeOptions {
    /// Checks what was given.
    pub(super) fn new(min_segment_size: i64, max_segment_size: Option<i64>, sort: &str) -> Result<Self> {
        let max = max_segment_size.map(|max| count("max_segment_size", max)).transpose()?;
        Ok(Self { limits: SizeLimits::new(count("min_segment_size", min_segment_size)?, max)?, sort: sort.parse()? })
    }

    /// Selects among the wholes of a log that has come to its end.
    pub(super) fn select(&self, log: &mut Aliases) -> Result<Selection> {
        Selection::new(log, self.limits, self.sort)
    }
}

/// Counts by the names of their causes.
pub(super) type Named = BTreeMap<&'static str, u64>;

/// Counts as Python has them.
pub(super) fn named(counts: &ByCause) -> Named {
    counts.named().collect()
}

/// How many segments are kept; how many are left out, by cause; and how many points those have.
pub(super) type Selected = (u64, Named, Named);

/// What a selection has come to.
pub(super) fn selected(selection: &Selection) -> Selected {
    (selection.kept_segments(), named(selection.left_out_segments()), named(selection.left_out_points()))
}
