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
        for &at in counts.slabs().keys() {
            spool.expect(at);
        }
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
            let come = (ids.end - ids.start) as u64;
            match missing.get_mut(&at) {
                Some(missing) if *missing >= come => *missing -= come,
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

#[cfg(test)]
mod tests {
    use super::super::{Counting, Cutter, PointIds, SpanBy};
    use super::*;
    use proptest::prelude::*;

    fn chunks(xs: &[f64], size: usize) -> Vec<Chunk> {
        let chunk =
            |xs: &[f64]| Chunk { points: xs.iter().map(|&x| [x, 1.0, 2.0]).collect(), attributes: vec![xs.to_vec()] };
        xs.chunks(size).map(chunk).collect()
    }

    fn finalized(
        xs: &[f64],
        width: f64,
        size: usize,
        by: SpanBy,
        memory: usize,
    ) -> Finalized<impl Iterator<Item = Result<Span>>> {
        let mut counting = Counting::new(width, &Lattice::REAL).unwrap();
        for chunk in chunks(xs, size) {
            counting.add(&chunk).unwrap();
        }
        let spans = Cutter::new(chunks(xs, size).into_iter().map(Ok), by, &Lattice::REAL);
        let mut finalized = Finalized::new(spans, &counting.finish(), &Lattice::REAL);
        finalized.spool.memory = memory;
        finalized
    }

    proptest! {
        /// Also from disk, where what has been handed on leaves room for what comes later.
        #[test]
        fn every_point_comes_out_once_with_its_attributes(
            xs in prop::collection::vec(prop_oneof![6 => -50.0f64..50.0, 1 => Just(f64::NAN)], 1..300),
            strays in 0.0f64..80.0,
            size in 1usize..50,
            points in 1usize..50,
            memory in prop_oneof![Just(1usize), Just(500), Just(2000), Just(usize::MAX)],
        ) {
            // A stream that goes along x, more or less.
            let count = xs.len() as f64;
            let xs: Vec<f64> = xs.iter().enumerate().map(|(i, x)| i as f64 / count * 100.0 + x * strays / 50.0).collect();
            let mut slabs = finalized(&xs, 7.0, size, SpanBy::Count { points }, memory);
            let mut seen = vec![false; xs.len()];
            for span in slabs.by_ref() {
                let span = span.unwrap();
                let PointIds::Listed(ids) = &span.point_ids else { panic!("listed") };
                prop_assert!(ids.windows(2).all(|w| w[0] < w[1]));
                prop_assert_eq!(span.attributes.first().map_or(0, Vec::len), ids.len());
                for ((&id, point), value) in ids.iter().zip(&span.points).zip(&span.attributes[0]) {
                    prop_assert!(!std::mem::replace(&mut seen[id as usize], true));
                    prop_assert_eq!(value.to_bits(), xs[id as usize].to_bits());
                    prop_assert_eq!(point[0].to_bits(), xs[id as usize].to_bits());
                }
            }
            prop_assert!(seen.into_iter().all(|s| s));
            prop_assert_eq!(slabs.spool.points(), 0);
            prop_assert!(slabs.spool.bytes_on_disk() <= 40 * xs.len() as u64);
        }
    }

    #[test]
    fn disk_is_needed_for_those_that_wait_at_the_same_time_only() {
        // Forward along x, each tenth point in a place that is reached later.
        let xs: Vec<f64> = (0..100_000).map(|i| f64::from(i / 10) + if i % 10 == 0 { 300.0 } else { 0.0 }).collect();
        let mut slabs = finalized(&xs, 20.0, 1000, SpanBy::Count { points: 500 }, 10_000);
        let read: usize = slabs.by_ref().map(|span| span.unwrap().len()).sum();
        assert_eq!(read, 100_000);
        let most = slabs.waits().most;
        assert!((400..1000).contains(&most), "{most}");
        let kept = slabs.spool.bytes_on_disk() / 40;
        assert!(kept > 0 && kept < 3 * most, "room for {kept} points, at the most {most} waited");
    }
}
