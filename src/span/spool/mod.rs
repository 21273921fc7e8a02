//! Points that wait in their slabs: in memory until there are [`SPOOL_MEMORY`] bytes of them, then in one temporary file.
//!
//! Inside a slab the points keep the order of the stream. What a slab leaves in the file when it is handed on is written
//! to again.

mod file;
mod laid;
mod places;

use std::collections::BTreeMap;
use std::ops::{Range, RangeInclusive};
use std::sync::Mutex;

pub(super) use laid::Laid;
pub(super) use places::Places;

use super::{Chunk, PointIds, SlabIndex, Span};
use crate::error::{Error, Result};
use crate::lattice::Lattice;
use file::{SpoolFile, Stretch};

/// How many bytes of points wait in memory before they go to disk.
const SPOOL_MEMORY: usize = 16 << 20;

/// Bytes of a point without attributes.
const BYTES_PER_POINT: usize = size_of::<[f64; 3]>() + size_of::<i64>();

/// Points of a stream, slab by slab.
pub(super) struct Spool {
    places: Places,
    lattice: Lattice,
    slabs: BTreeMap<i64, Slab>,
    /// The id of the next point that comes.
    next_id: i64,
    /// The number of the next slab that is handed on, and the slabs before which all have been.
    index: u64,
    open_from: i64,
    /// How many points wait.
    points: u64,
    /// Bytes of those in memory, with the room that lists keep to grow into, and how many there can be.
    bytes: usize,
    pub(super) memory: usize,
    /// Most points of several slabs that are handed on as one span; 0 = each is one.
    pub(super) most: usize,
    file: SpoolFile,
}

impl Spool {
    pub(super) fn new(slab_of: SlabIndex, lattice: Lattice) -> Self {
        Self {
            places: Places::new(slab_of),
            lattice,
            slabs: BTreeMap::new(),
            next_id: 0,
            index: 0,
            open_from: i64::MIN,
            points: 0,
            bytes: 0,
            memory: SPOOL_MEMORY,
            most: 0,
            file: SpoolFile::default(),
        }
    }

    /// Makes room for a slab that will have points.
    pub(super) fn expect(&mut self, at: i64) {
        self.slabs.entry(at).or_default();
    }

    /// Puts the next points of the stream into their slabs, and tells `note` which slab lies where some of them lie. Points
    /// of a slab that has been handed on go to the next that has not.
    pub(super) fn lay(&mut self, chunk: &Chunk, mut note: impl FnMut(i64, Range<i64>)) -> Result<()> {
        let Self { places, slabs, next_id: first_id, open_from, bytes, .. } = self;
        places.for_each_run(&chunk.points, |at, run| {
            let ids = *first_id + run.start as i64..*first_id + run.end as i64;
            note(at, ids.clone());
            let slab = slabs.entry(at.max(*open_from)).or_default();
            let before = slab.bytes_held();
            slab.point_ids.extend(ids);
            slab.held.append(chunk, run);
            *bytes += slab.bytes_held() - before;
        })?;
        self.next_id += chunk.points.len() as i64;
        self.points += chunk.points.len() as u64;
        Ok(())
    }

    /// The id of the next point that comes.
    pub(super) fn next_id(&self) -> i64 {
        self.next_id
    }

    /// How many points wait.
    pub(super) fn points(&self) -> u64 {
        self.points
    }

    /// Writes everything to disk if too much of it is in memory.
    pub(super) fn relieve(&mut self) -> Result<()> {
        if self.bytes >= self.memory { self.write() } else { Ok(()) }
    }

    /// Writes everything to disk if some of it is there already: the windows that follow can use the memory.
    pub(super) fn settle(&mut self) -> Result<()> {
        if self.file.is_open() { self.write() } else { Ok(()) }
    }

    fn write(&mut self) -> Result<()> {
        self.bytes = 0;
        self.file.write(self.slabs.values_mut()).map_err(|e| Error::spool("written", e))
    }

    /// The first slab, filled up with those behind it, and the numbers of the first and the last of them.
    fn pop_filled(&mut self) -> Option<(RangeInclusive<i64>, Slab)> {
        let (first, mut slab) = self.slabs.pop_first()?;
        self.bytes = self.bytes.saturating_sub(slab.bytes_held());
        let mut last = first;
        while let Some(next) = self.slabs.first_entry()
            && slab.len() + next.get().len() <= self.most
            && self.most > 0
        {
            last = *next.key();
            let next = next.remove();
            self.bytes = self.bytes.saturating_sub(next.bytes_held());
            slab.append(next);
        }
        Some((first..=last, slab))
    }

    /// Takes out the first slab, or as many as there is room for, as the span that follows those taken out before.
    pub(super) fn hand_on(&mut self) -> Option<Result<Span>> {
        let (taken, slab) = self.pop_filled()?;
        let index = self.index;
        self.index += 1;
        self.open_from = taken.end() + 1;
        // Slabs passed over have no points, so the extent goes on to the next that has some.
        let (first, end) = ((index > 0).then_some(*taken.start()), self.slabs.keys().next().copied());
        let extent = Some(self.places.slab_of.extent(first, end, &self.lattice));
        Some(match self.file.take(slab) {
            Ok(points) => {
                let (point_ids, Chunk { points, attributes }) = in_stream_order(points);
                self.points -= points.len() as u64;
                Ok(Span { index, point_ids: PointIds::Listed(point_ids), points, attributes, extent })
            }
            Err(error) => Err(Error::spool("read", error)),
        })
    }

    /// All spans, to be read in any order.
    pub(super) fn lay_out(&mut self) -> Laid {
        let (numbers, slabs): (Vec<i64>, Vec<Slab>) =
            std::iter::from_fn(|| self.pop_filled()).map(|(taken, slab)| (*taken.start(), slab)).unzip();
        let extent = |(at, &number): (usize, &i64)| {
            self.places.slab_of.extent((at > 0).then_some(number), numbers.get(at + 1).copied(), &self.lattice)
        };
        let extents = numbers.iter().enumerate().map(extent).collect();
        Laid { extents, slabs, file: Mutex::new(std::mem::take(&mut self.file)) }
    }

    /// How long the file is.
    #[cfg(test)]
    pub(super) fn bytes_on_disk(&self) -> u64 {
        self.file.end
    }

    /// Forgets everything that waits.
    pub(super) fn clear(&mut self) {
        self.slabs.clear();
        self.points = 0;
    }
}

/// The points of one slab: those already on disk, and those that wait in memory.
#[derive(Default)]
struct Slab {
    written: Vec<Stretch>,
    point_ids: Vec<i64>,
    held: Chunk,
}

impl Slab {
    fn len(&self) -> usize {
        self.point_ids.len() + self.written.iter().map(|stretch| stretch.points).sum::<usize>()
    }

    /// Bytes that its points take in memory: lists grow by doubling, so up to twice what they hold.
    fn bytes_held(&self) -> usize {
        let attributes: usize = self.held.attributes.iter().map(Vec::capacity).sum();
        let (ids, points) = (self.point_ids.capacity(), self.held.points.capacity());
        (ids + attributes) * size_of::<i64>() + points * size_of::<[f64; 3]>()
    }

    fn append(&mut self, next: Slab) {
        self.written.extend(next.written);
        self.point_ids.extend(next.point_ids);
        self.held.append(&next.held, 0..next.held.points.len());
    }
}

/// Points of several slabs in the order of their ids.
fn in_stream_order((point_ids, chunk): (Vec<i64>, Chunk)) -> (Vec<i64>, Chunk) {
    if point_ids.is_sorted() {
        return (point_ids, chunk);
    }
    let mut order: Vec<u32> = (0..point_ids.len() as u32).collect();
    // Not unstable: this sort makes use of the order that the points of each slab are in.
    order.sort_by_key(|&i| point_ids[i as usize]);
    (order.iter().map(|&i| point_ids[i as usize]).collect(), chunk.in_order(&order))
}

fn bytes_per_point(attributes: usize) -> usize {
    BYTES_PER_POINT + attributes * size_of::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::span::Direction;

    /// What lists keep to grow into counts, in whichever slab it is and however the slabs go.
    #[test]
    fn the_bytes_are_those_that_lists_take() {
        let slab_of = SlabIndex::new(1.0, Direction::X, &Lattice::REAL);
        let mut spool = Spool { most: 30, memory: 4000, ..Spool::new(slab_of, Lattice::REAL) };
        let held = |spool: &Spool| spool.slabs.values().map(Slab::bytes_held).sum::<usize>();
        let mut most = 0;
        for turn in 0..40_i32 {
            let xs = (0..7).map(|i| f64::from((turn * 7 + i * 5) % 11));
            let chunk = Chunk { points: xs.clone().map(|x| [x, 0.0, 0.0]).collect(), attributes: vec![xs.collect()] };
            spool.lay(&chunk, |_, _| ()).unwrap();
            assert_eq!(spool.bytes, held(&spool));
            most = most.max(spool.bytes);
            spool.relieve().unwrap();
            assert!(spool.bytes == held(&spool) && spool.bytes < spool.memory);
        }
        assert!(most >= spool.memory && spool.file.is_open());
        while spool.hand_on().is_some() {
            assert_eq!(spool.bytes, held(&spool));
        }
        assert_eq!(spool.bytes, 0);
    }
}
