//! The segment-segment look-up table: from each segment in scope to every later segment that shares a point with it.
//!
//! While a window is woven its pairs are counted in [`Pairs`], which any number of threads may write at once. When all
//! its points have been seen the pairs are sealed into a sorted list, a slab of the table, so that nothing depends on
//! the order in which threads came. A segment goes out of scope with the last span that holds one of its points; a slab
//! of pairs goes when no segment that it starts from can be in scope.

use std::collections::VecDeque;

use crate::label::{NONE, SegmentId};
use crate::sync::{AtomicU64, Ordering};

/// A segment and one that shares points with it in a later window.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct SegmentRow {
    /// The earlier segment.
    pub segment_id: SegmentId,
    /// The later one; [`NONE`] while there is none.
    pub next_segment_id: SegmentId,
    /// The window in which they were seen to share points; [`NONE`] without a successor.
    pub window: i64,
    /// How many points they share.
    pub shared_points: u64,
}

/// Counts the points that pairs of segments share: a lock-free hash table with open addressing.
///
/// A key packs both segments (the distance of the earlier id from `from_base` and the later one's label, each plus one,
/// so that 0 means a free place). It is set once, by compare-exchange, and never changes while the table is shared.
///
/// All accesses are `Relaxed`: a key carries all there is to know of a place, a count belongs to its key's place from
/// the start, and whoever seals the table has joined the writing threads, which orders everything they did before it.
/// Model-checked in `tests/weaver_model.rs`.
pub struct Pairs {
    places: Box<[Place]>,
    from_base: SegmentId,
}

struct Place {
    key: AtomicU64,
    shared: AtomicU64,
}

impl Pairs {
    /// A table for pairs whose earlier segment has at least the id `from_base`.
    pub fn new(from_base: SegmentId, capacity: usize) -> Self {
        // At most half full, so that a probe soon finds a free place.
        let places = (2 * capacity.max(1)).next_power_of_two();
        let place = || Place { key: AtomicU64::new(0), shared: AtomicU64::new(0) };
        Self { places: (0..places).map(|_| place()).collect(), from_base }
    }

    /// Notes that the segment `from` shares `points` points with the segment of this window that has `label`.
    pub fn add(&self, from: SegmentId, label: i32, points: u64) {
        let key = (((from - self.from_base) as u64 + 1) << 32) | (label as u64 + 1);
        let mask = self.places.len() - 1;
        // Fibonacci hashing: the high half of the product depends on all bits of the key.
        let mut at = (key.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 32) as usize & mask;
        loop {
            let place = &self.places[at];
            // Relaxed, all four: see above.
            let mut found = place.key.load(Ordering::Relaxed);
            if found == 0 {
                found = match place.key.compare_exchange(0, key, Ordering::Relaxed, Ordering::Relaxed) {
                    Ok(_) => key,
                    Err(now) => now,
                };
            }
            if found == key {
                place.shared.fetch_add(points, Ordering::Relaxed);
                return;
            }
            at = (at + 1) & mask;
        }
    }

    /// The pairs, sorted: earlier segment, label of the later one, shared points.
    pub fn seal(self) -> Vec<(SegmentId, i32, u64)> {
        let mut pairs: Vec<(SegmentId, i32, u64)> = self
            .places
            .iter()
            // Relaxed: the writers have been joined.
            .map(|place| (place.key.load(Ordering::Relaxed), place.shared.load(Ordering::Relaxed)))
            .filter(|&(key, _)| key != 0)
            .map(|(key, shared)| (self.from_base + (key >> 32) as i64 - 1, ((key & 0xFFFF_FFFF) - 1) as i32, shared))
            .collect();
        pairs.sort_unstable();
        pairs
    }
}

/// The successors of all segments in scope.
#[derive(Debug, Default)]
pub struct SegmentSegment {
    slabs: VecDeque<Slab>,
    live: usize,
}

/// The segments and pairs of one window.
#[derive(Debug)]
struct Slab {
    first_id: SegmentId,
    /// Pairs whose later segment belongs to this window, sorted.
    pairs: Vec<SegmentRow>,
    /// Segments of this window by the last span that holds a point of theirs, ascending.
    leaving: VecDeque<(u64, Vec<SegmentId>)>,
}

impl SegmentSegment {
    /// Takes in a window: its segments with the last span of each, and its sealed pairs.
    pub fn push(&mut self, window: u64, first_id: SegmentId, last_spans: &[u64], pairs: &[(SegmentId, i32, u64)]) {
        // A window has few spans, so segments are dealt out to them, in ascending order of id.
        let first_span = last_spans.iter().min().copied().unwrap_or(0);
        let mut leaving: VecDeque<(u64, Vec<SegmentId>)> = VecDeque::new();
        for (&span, segment_id) in last_spans.iter().zip(first_id..) {
            while leaving.len() as u64 <= span - first_span {
                leaving.push_back((first_span + leaving.len() as u64, Vec::new()));
            }
            leaving[(span - first_span) as usize].1.push(segment_id);
        }
        let pairs = pairs
            .iter()
            .map(|&(segment_id, label, shared_points)| SegmentRow {
                segment_id,
                next_segment_id: first_id + SegmentId::from(label),
                window: window as i64,
                shared_points,
            })
            .collect();
        self.live += last_spans.len();
        self.slabs.push_back(Slab { first_id, pairs, leaving });
    }

    /// The pairs that the newest window brought, sorted.
    pub fn newest_pairs(&self) -> &[SegmentRow] {
        self.slabs.back().map_or(&[], |slab| &slab.pairs)
    }

    /// Lets the segments go that have no point behind `span`; one row per successor, or one with none, by segment id.
    pub fn evict_with(&mut self, span: u64) -> Vec<SegmentRow> {
        let mut gone: Vec<SegmentId> = Vec::new();
        for slab in &mut self.slabs {
            while slab.leaving.front().is_some_and(|(last, _)| *last <= span) {
                gone.extend(slab.leaving.pop_front().into_iter().flat_map(|(_, ids)| ids));
            }
        }
        gone.sort_unstable();
        self.live -= gone.len();
        let rows = self.rows_of(&gone);
        self.drop_slabs();
        rows
    }

    /// The rows of some segments in ascending order: one pass over each slab's pairs, which are in that order too.
    fn rows_of(&self, gone: &[SegmentId]) -> Vec<SegmentRow> {
        let first = gone.first().copied().unwrap_or(0);
        let mut rest: Vec<&[SegmentRow]> = Vec::with_capacity(self.slabs.len());
        for slab in &self.slabs {
            rest.push(&slab.pairs[slab.pairs.partition_point(|row| row.segment_id < first)..]);
        }
        let mut rows = Vec::with_capacity(gone.len());
        for &segment_id in gone {
            let before = rows.len();
            for pairs in &mut rest {
                while let Some((row, behind)) = pairs.split_first().filter(|(row, _)| row.segment_id <= segment_id) {
                    if row.segment_id == segment_id {
                        rows.push(*row);
                    }
                    *pairs = behind;
                }
            }
            if rows.len() == before {
                rows.push(SegmentRow { segment_id, next_segment_id: NONE, window: NONE, shared_points: 0 });
            }
        }
        rows
    }

    /// Drops the slabs that nothing in scope refers to: all their segments are gone, and so are those of the windows
    /// before, from which their pairs start.
    fn drop_slabs(&mut self) {
        while self.slabs.front().is_some_and(|slab| slab.leaving.is_empty()) {
            self.slabs.pop_front();
        }
    }

    /// No segment with a smaller id than this is in scope; none if no segment is.
    pub fn oldest_id(&self) -> Option<SegmentId> {
        self.slabs.front().map(|slab| slab.first_id)
    }

    /// How many segments are in scope.
    pub fn live(&self) -> usize {
        self.live
    }
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeMap;

    proptest! {
        #[test]
        fn pairs_equal_a_map(adds in prop::collection::vec((5i64..40, 0i32..30, 1u64..9), 0..300)) {
            let pairs = Pairs::new(5, adds.len());
            let mut map = BTreeMap::new();
            for &(from, label, points) in &adds {
                pairs.add(from, label, points);
                *map.entry((from, label)).or_insert(0) += points;
            }
            let expected: Vec<_> = map.into_iter().map(|((from, label), points)| (from, label, points)).collect();
            prop_assert_eq!(pairs.seal(), expected);
        }
    }

    #[test]
    fn threads_count_together() {
        let pairs = Pairs::new(1, 64);
        std::thread::scope(|scope| {
            for thread in 0..4 {
                let pairs = &pairs;
                scope.spawn(move || (0..40_000).for_each(|i| pairs.add(1 + (i + thread) % 8, i as i32 % 4, 1)));
            }
        });
        let sealed = pairs.seal();
        assert!(sealed.is_sorted());
        assert_eq!(sealed.iter().map(|pair| pair.2).sum::<u64>(), 160_000);
    }

    #[test]
    fn a_segment_goes_with_its_last_span_and_tells_its_successors() {
        let mut table = SegmentSegment::default();
        table.push(0, 1, &[0, 2, 2], &[]);
        table.push(1, 4, &[3, 4], &[(2, 0, 5), (2, 1, 6), (3, 1, 7)]);
        assert_eq!((table.live(), table.oldest_id()), (5, Some(1)));
        let row = |segment_id, next_segment_id, window, shared_points| SegmentRow {
            segment_id,
            next_segment_id,
            window,
            shared_points,
        };
        assert_eq!(table.evict_with(0), [row(1, NONE, NONE, 0)]);
        assert_eq!(table.evict_with(1), []);
        assert_eq!(table.evict_with(2), [row(2, 4, 1, 5), row(2, 5, 1, 6), row(3, 5, 1, 7)]);
        assert_eq!((table.live(), table.oldest_id()), (2, Some(4)));
        assert_eq!(table.evict_with(9).len(), 2);
        assert_eq!((table.live(), table.oldest_id()), (0, None));
    }
}
