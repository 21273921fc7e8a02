//! Counts a cloud before it is read again: how many points each slab will get, and along which direction fewest wait.
//!
//! Source: finalization of Isenburg, Liu, Shewchuk and Snoeyink, "Streaming computation of Delaunay triangulations" (2006).
//! There a grid of cells is counted, and a tag in the stream tells when a cell is final; here the cells are slabs and
//! the counts are kept.

use std::collections::BTreeMap;

use rustc_hash::FxHashMap;

use super::spool::Places;
use super::{Chunk, Direction, SlabIndex, SpanBy};
use crate::error::{Result, positive};
use crate::lattice::Lattice;

/// Along both axes, forward and backward: there slabs are exact wherever the lattice is.
const DIRECTIONS: [Direction; 4] = [Direction::X, Direction::Y, Direction::Azimuth(270.0), Direction::Azimuth(180.0)];

/// The first reading of a cloud, chunk by chunk. Its memory is that of the slabs, not of the points.
pub struct Counting {
    width: f64,
    points: i64,
    candidates: Vec<Candidate>,
}

/// A direction, and what is known of its slabs.
struct Candidate {
    direction: Direction,
    places: Places,
    slabs: FxHashMap<i64, Count>,
}

#[derive(Clone, Copy, Default)]
struct Count {
    points: u64,
    /// The id of the last of them.
    last: i64,
}

/// How many points each slab of a cloud has.
#[derive(Debug, Clone, PartialEq)]
pub struct SlabCounts {
    width: f64,
    direction: Direction,
    slabs: BTreeMap<i64, u64>,
    points: u64,
    most_waiting: u64,
}

impl Counting {
    /// Counts points on `lattice` in slabs of `width`, in units of the coordinates.
    ///
    /// # Errors
    /// If the width is not above zero.
    pub fn new(width: f64, lattice: &Lattice) -> Result<Self> {
        positive("width", width)?;
        let candidate = |direction| {
            let places = Places::new(SlabIndex::new(width, direction, lattice));
            Candidate { direction, places, slabs: FxHashMap::default() }
        };
        Ok(Self { width, points: 0, candidates: DIRECTIONS.into_iter().map(candidate).collect() })
    }

    /// Counts the next points.
    ///
    /// # Errors
    /// If slabs are so narrow that they cannot be numbered.
    pub fn add(&mut self, chunk: &Chunk) -> Result<()> {
        let first = self.points;
        for Candidate { places, slabs, .. } in &mut self.candidates {
            places.for_each_run(&chunk.points, |at, run| {
                let count = slabs.entry(at).or_default();
                count.points += run.len() as u64;
                count.last = first + run.end as i64 - 1;
            })?;
        }
        self.points += chunk.points.len() as i64;
        Ok(())
    }

    /// The counts along the direction in which the fewest points wait.
    pub fn finish(self) -> SlabCounts {
        let candidates = self.candidates.into_iter().map(|Candidate { direction, slabs, .. }| {
            let slabs: BTreeMap<i64, Count> = slabs.into_iter().collect();
            (most_waiting(slabs.values()), direction, slabs)
        });
        // Of equal ones the first.
        let (most_waiting, direction, slabs) =
            candidates.min_by_key(|(most_waiting, ..)| *most_waiting).unwrap_or((0, Direction::X, BTreeMap::new()));
        let slabs = slabs.into_iter().map(|(at, count)| (at, count.points)).collect();
        SlabCounts { width: self.width, direction, slabs, points: self.points as u64, most_waiting }
    }
}

/// How many points wait at the most, if they come one by one, and each slab is handed on as soon as it and all before it
/// have got their last point.
fn most_waiting<'a>(slabs: impl Iterator<Item = &'a Count>) -> u64 {
    let (mut handed_on, mut complete_at, mut most) = (0, -1, 0);
    // Those that wait grow in number until the slab is complete, and are then fewer by all slabs complete by then.
    for slab in slabs {
        if slab.last > complete_at {
            complete_at = slab.last;
            most = most.max(complete_at as u64 + 1 - handed_on);
        }
        handed_on += slab.points;
    }
    most
}

impl SlabCounts {
    /// The slabs, as spans.
    pub fn by(&self) -> SpanBy {
        SpanBy::Width { width: self.width, direction: self.direction }
    }

    /// The width of the slabs, in units of the coordinates.
    pub fn width(&self) -> f64 {
        self.width
    }

    /// Along which the slabs follow each other.
    pub fn direction(&self) -> Direction {
        self.direction
    }

    /// How many points were counted.
    pub fn points(&self) -> u64 {
        self.points
    }

    /// How many points wait at the most, if they come one by one.
    pub fn most_waiting(&self) -> u64 {
        self.most_waiting
    }

    /// How many points each slab has.
    pub(super) fn slabs(&self) -> &BTreeMap<i64, u64> {
        &self.slabs
    }

    pub(super) fn slab_of(&self, lattice: &Lattice) -> SlabIndex {
        SlabIndex::new(self.width, self.direction, lattice)
    }
}
