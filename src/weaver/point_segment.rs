//! The point-segment look-up table: the segment id of every point in scope.
//!
//! Points are woven in stream order, so a point's *arrival* (its position in the sequence of all points of all spans) is
//! dense and the table is a ring, not a hash map. The slabs of the live spans lie one behind the other in it:
//!
//! ```text
//!            base                             next
//!   ┌─────────┬──────────┬──────────┬──────────┬─────────┐      word of arrival a: words[a mod capacity]
//!   │ evicted │  span 4  │  span 5  │  span 6  │  free   │      bits 63..56  lap of the ring, 1..=255; 0 = never written
//!   └─────────┴──────────┴──────────┴──────────┴─────────┘      bits 55..0   segment id, from 1; at the top, a cause
//! ```
//!
//! A word belongs to an arrival only if it carries the arrival's lap. So evicting a span means moving `base` on: nothing
//! is cleared, nothing is freed, and a reader that comes late finds another lap and answers "none". A stale word would
//! have to survive 255 laps to be taken for a live one; points that nobody has written yet overwrite nothing, so the words
//! of every 255th lap are cleared when its points come in.
//!
//! A point without a segment keeps *why* in the place of the id, so that none can leave without a reason. It is no entry: a
//! later window may still give the point a segment.
//!
//! # What writers and readers may see
//! Any number of threads may look up and insert at once. An id is written at most once per lap, by one compare-exchange:
//! of two writers for one point one wins and the other is told the winner's id. A cause gives way to an id and to an
//! earlier cause only, so what is left depends on no order. A word carries all there is to know, no
//! other memory is published through it, so all word accesses are `Relaxed`: the coherence of a single atomic is enough.
//! `base` is `Relaxed` too. It publishes nothing: whether a word belongs to an arrival is decided by its lap alone, and a
//! reader that has not yet seen an eviction gets the evicted point's own id or none, never another's. Neither pairs with
//! anything. Model-checked in `tests/weaver_model.rs`.

use crate::label::{Cause, SegmentId};
use crate::sync::{AtomicU64, Ordering};

/// One segment id per point in scope.
pub struct PointSegment {
    /// A power of two of them.
    words: Box<[AtomicU64]>,
    /// The oldest arrival in scope.
    base: AtomicU64,
    /// The arrival of the next new point.
    next: u64,
}

const ID_BITS: u32 = 56;
const ID_MASK: u64 = (1 << ID_BITS) - 1;
const LAPS: u64 = 255;

/// From here on a word tells why a point has no segment; no id is as large.
const WHY: u64 = ID_MASK - Cause::ALL.len() as u64;

/// What an insertion found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Inserted {
    /// The point was new and now has the id.
    New,
    /// The point was there and keeps this id.
    Kept(SegmentId),
}

impl PointSegment {
    /// An empty table with room for at least `capacity` points in scope.
    pub fn with_capacity(capacity: usize) -> Self {
        Self { words: ring(capacity), base: AtomicU64::new(0), next: 0 }
    }

    /// Makes room for `points` new points and returns the arrival of the first.
    pub fn extend(&mut self, points: usize) -> u64 {
        let first = self.next;
        let live = (first - self.base()) as usize + points;
        if live > self.words.len() {
            self.grow(live);
        }
        self.next += points as u64;
        self.wipe(first);
        first
    }

    /// Every 255th lap starts from empty words, so that no word can survive until its lap's number comes round again.
    fn wipe(&self, first: u64) {
        let starts_round = |arrival: u64| self.lap(arrival).is_multiple_of(LAPS);
        if starts_round(first) || starts_round(self.next) {
            for arrival in (first..self.next).filter(|&arrival| starts_round(arrival)) {
                // Relaxed: writers start after `extend`, which has the table for itself.
                self.word(arrival).store(0, Ordering::Relaxed);
            }
        }
    }

    #[inline]
    fn lap(&self, arrival: u64) -> u64 {
        arrival >> self.words.len().trailing_zeros()
    }

    fn grow(&mut self, live: usize) {
        let grown = Self { words: ring(live), base: AtomicU64::new(self.base()), next: self.next };
        for arrival in self.base()..self.next {
            if let Some(told) = self.told(arrival) {
                // Relaxed: nobody else has the new table yet.
                grown.word(arrival).store(grown.packed(arrival, told), Ordering::Relaxed);
            }
        }
        *self = grown;
    }

    fn base(&self) -> u64 {
        // Relaxed: see "What writers and readers may see".
        self.base.load(Ordering::Relaxed)
    }

    #[inline]
    fn word(&self, arrival: u64) -> &AtomicU64 {
        &self.words[arrival as usize & (self.words.len() - 1)]
    }

    /// The word of `arrival` with what is told of it.
    #[inline]
    fn packed(&self, arrival: u64, told: u64) -> u64 {
        let lap = self.lap(arrival) % LAPS + 1;
        lap << ID_BITS | (told & ID_MASK)
    }

    /// What a word tells of `arrival`: an id or a cause; nothing if it is another's.
    #[inline]
    fn unpacked(&self, arrival: u64, word: u64) -> Option<u64> {
        (word >> ID_BITS == self.packed(arrival, 0) >> ID_BITS).then_some(word & ID_MASK)
    }

    #[inline]
    fn told(&self, arrival: u64) -> Option<u64> {
        // Relaxed: see "What writers and readers may see".
        let word = self.word(arrival).load(Ordering::Relaxed);
        if arrival < self.base() { None } else { self.unpacked(arrival, word) }
    }

    /// The segment id of a point in scope, if it has one.
    #[inline]
    pub fn get(&self, arrival: u64) -> Option<SegmentId> {
        self.told(arrival).and_then(segment_id)
    }

    /// The segment id of a point in scope, or else why it has none.
    ///
    /// # Errors
    /// With the reason, if the point has no segment id.
    #[inline]
    pub fn find(&self, arrival: u64) -> std::result::Result<SegmentId, Cause> {
        let told = self.told(arrival).ok_or(Cause::BySegmentor)?;
        segment_id(told).ok_or_else(|| cause(told))
    }

    /// Gives `id` to a point in scope that has none; a point that has one keeps it.
    #[inline]
    pub fn insert_if_absent(&self, arrival: u64, id: SegmentId) -> Inserted {
        let word = self.word(arrival);
        // Relaxed, all three: see "What writers and readers may see".
        let mut seen = word.load(Ordering::Relaxed);
        loop {
            if let Some(kept) = self.unpacked(arrival, seen).and_then(segment_id) {
                return Inserted::Kept(kept);
            }
            match word.compare_exchange(seen, self.packed(arrival, id as u64), Ordering::Relaxed, Ordering::Relaxed) {
                Ok(_) => return Inserted::New,
                Err(now) => seen = now,
            }
        }
    }

    /// Notes why a point in scope has no segment, unless it has one, or an earlier cause is known.
    #[inline]
    pub fn explain(&self, arrival: u64, why: Cause) {
        let word = self.word(arrival);
        let noted = self.packed(arrival, WHY + why as u64);
        // Relaxed, all three: see "What writers and readers may see".
        let mut seen = word.load(Ordering::Relaxed);
        // Any id is smaller than any cause.
        while self.unpacked(arrival, seen).is_none() || seen > noted {
            match word.compare_exchange(seen, noted, Ordering::Relaxed, Ordering::Relaxed) {
                Ok(_) => return,
                Err(now) => seen = now,
            }
        }
    }

    /// Lets all points before `arrival` go out of scope.
    pub fn evict_before(&self, arrival: u64) {
        // Relaxed: see "What writers and readers may see".
        self.base.store(arrival, Ordering::Relaxed);
    }

    /// How many points in scope have a segment id, counted one by one.
    pub fn live(&self) -> usize {
        (self.base()..self.next).filter(|&arrival| self.get(arrival).is_some()).count()
    }
}

/// The id that a word tells; none if it tells why there is none.
#[inline]
fn segment_id(told: u64) -> Option<SegmentId> {
    (told < WHY).then_some(told as SegmentId)
}

fn cause(told: u64) -> Cause {
    Cause::ALL.get((told - WHY) as usize).copied().unwrap_or(Cause::BySegmentor)
}

fn ring(capacity: usize) -> Box<[AtomicU64]> {
    (0..capacity.next_power_of_two()).map(|_| AtomicU64::new(0)).collect()
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::HashMap;

    #[test]
    fn a_point_keeps_its_first_id() {
        let mut table = PointSegment::with_capacity(1);
        let first = table.extend(3);
        assert_eq!(table.insert_if_absent(first, 7), Inserted::New);
        assert_eq!(table.insert_if_absent(first, 9), Inserted::Kept(7));
        assert_eq!((table.get(first), table.get(first + 1)), (Some(7), None));
        assert_eq!(table.live(), 1);
    }

    #[test]
    fn the_earliest_cause_stays_until_there_is_an_id() {
        let mut table = PointSegment::with_capacity(1);
        let point = table.extend(1);
        assert_eq!(table.find(point), Err(Cause::BySegmentor));
        for (said, known) in
            [(Cause::Undecided, Cause::Undecided), (Cause::Noise, Cause::Noise), (Cause::Filtered, Cause::Noise)]
        {
            table.explain(point, said);
            assert_eq!((table.find(point), table.get(point), table.live()), (Err(known), None, 0));
        }
        table.extend(5);
        assert_eq!(table.find(point), Err(Cause::Noise), "also in a larger table");
        assert_eq!(table.insert_if_absent(point, 4), Inserted::New);
        table.explain(point, Cause::BySegmentor);
        assert_eq!(table.find(point), Ok(4));
    }

    proptest! {
        /// The ring behaves like a map from which the oldest keys are removed.
        #[test]
        fn equals_a_map(steps in prop::collection::vec((1usize..9, 0usize..9, 1i64..1000), 1..200)) {
            let mut table = PointSegment::with_capacity(2);
            let mut map: HashMap<u64, i64> = HashMap::new();
            let mut base = 0;
            for (arriving, leaving, id) in steps {
                let first = table.extend(arriving);
                // Every second point of the new ones gets an id; some older ones are offered another.
                for arrival in (base..first + arriving as u64).filter(|a| a % 2 == 0) {
                    table.explain(arrival, Cause::ALL[id as usize % Cause::ALL.len()]);
                    let expected = map.get(&arrival).map_or(Inserted::New, |&kept| Inserted::Kept(kept));
                    prop_assert_eq!(table.insert_if_absent(arrival, id), expected);
                    map.entry(arrival).or_insert(id);
                }
                base = (base + leaving as u64).min(first + arriving as u64);
                table.evict_before(base);
                map.retain(|&arrival, _| arrival >= base);
                prop_assert_eq!(table.live(), map.len());
                for arrival in 0..first + arriving as u64 {
                    prop_assert_eq!(table.get(arrival), map.get(&arrival).copied());
                }
            }
        }
    }
}
