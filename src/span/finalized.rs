//! Hands on each slab of a cloud as soon as it is final, while the cloud is still being read in the order of its stream.
//!
//! Source: finalization of Isenburg, Liu, Shewchuk and Snoeyink, "Streaming computation of Delaunay triangulations" (2006).
//! [`Counting`](super::Counting) has told how many points each slab will get. A slab with all of its points is final, and
//! it is handed on when all before it have been: what follows sees spans by width, which know what they hold.

use std::collections::BTreeMap;

use super::spool::Spool;
use super::{Chunk, SlabCounts, Span, SpanSource, Waits};
use crate::error::{Error, Result};
use crate::lattice::Lattice;

/// An iterator of slabs over spans in the order of a stream.
pub struct Finalized<S> {
    /// The source until it has ended.
    spans: Option<S>,
    spool: Spool,
    /// How many points of each slab have not come yet.
    missing: BTreeMap<i64, u64>,
    counted: u64,
    /// The first point of the span that came last.
    newest: i64,
    waits: Waits,
    /// Why the source ended early.
    failure: Option<Error>,
}

impl<S: Iterator<Item = Result<Span>>> Finalized<S> {
    /// Lays `spans`, whose coordinates lie on `lattice`, into the slabs that were counted.
    pub fn new(spans: S, counts: &SlabCounts, lattice: &Lattice) -> Self {
        let mut spool = Spool::new(counts.slab_of(lattice), *lattice);
        counts.slabs().keys().for_each(|&at| spool.expect(at));
        Self {
            spans: Some(spans),
            spool,
            missing: counts.slabs().clone(),
            counted: counts.points(),
            newest: 0,
            waits: Waits::default(),
            failure: None,
        }
    }

    /// Whether the first slab that has not been handed on can be.
    fn is_first_final(&self) -> bool {
        self.spans.is_none() || self.missing.first_key_value().is_some_and(|(_, missing)| *missing == 0)
    }

    fn hand_on(&mut self) -> Option<Result<Span>> {
        self.missing.pop_first();
        let span = self.spool.hand_on()?;
        if let Ok(span) = &span {
            self.waits.points += (0..span.len()).take_while(|&i| span.point_id(i) < self.newest).count() as u64;
        }
        Some(span)
    }

    /// Takes the next span of the source in.
    fn read_on(&mut self) {
        self.waits.most = self.waits.most.max(self.spool.points());
        let read = match self.spool.relieve() {
            Ok(()) => self.spans.as_mut().and_then(Iterator::next),
            Err(full) => Some(Err(full)),
        };
        let outcome = match read {
            Some(span) => span.and_then(|span| self.lay(span)),
            None => self.end(),
        };
        if let Err(failure) = outcome {
            // What waits has holes if the source could not go on; if it has changed, it has all that came.
            if !matches!(failure, Error::Changed { .. }) {
                self.spool.clear();
            }
            (self.spans, self.failure) = (None, Some(failure));
        }
    }

    fn lay(&mut self, span: Span) -> Result<()> {
        self.newest = self.spool.next_id();
        let Span { points, attributes, .. } = span;
        let mut surplus = None;
        let missing = &mut self.missing;
        self.spool.lay(&Chunk { points, attributes }, |at, ids| {
            match missing.get_mut(&at).map(|missing| (missing.checked_sub((ids.end - ids.start) as u64), missing)) {
                Some((Some(left), missing)) => *missing = left,
                _ => surplus = surplus.or(Some(ids.start)),
            }
        })?;
        surplus.map_or(Ok(()), |point_id| {
            Err(Error::Changed { difference: format!("where point {point_id} lies, fewer points were counted") })
        })
    }

    fn end(&mut self) -> Result<()> {
        self.spans = None;
        let read = self.spool.next_id();
        if self.missing.values().all(|&missing| missing == 0) {
            return Ok(());
        }
        Err(Error::Changed { difference: format!("it ended after {read} points, and {} were counted", self.counted) })
    }
}

impl<S: Iterator<Item = Result<Span>>> Iterator for Finalized<S> {
    type Item = Result<Span>;

    fn next(&mut self) -> Option<Self::Item> {
        while !self.is_first_final() {
            self.read_on();
        }
        self.hand_on().or_else(|| self.failure.take().map(Err))
    }
}

impl<S: Iterator<Item = Result<Span>> + Send> SpanSource for Finalized<S> {
    fn stop(&mut self) {
        self.spans = None;
        self.spool.clear();
    }

    fn waits(&self) -> Waits {
        self.waits
    }
}
