//! The nearest points of some places, wherever in a stored cloud they are.
//!
//! From the spans that hold the places on to those beside them, as far as a span can hold something nearer than what has
//! been found: spans lie across a direction, so their borders say how near it can be. In a span, points are looked at in
//! the order of how far they are across the direction. Distances and ties are those of the one neighbor search, so what is
//! found is what a window with the whole cloud would find.

use std::cmp::Ordering;
use std::collections::{BTreeSet, BinaryHeap};

use crate::error::Result;
use crate::lattice::{Lattice, Metric, Within, is_valid};
use crate::span::{Archive, Extent, Span};

/// A point of the archive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Stored {
    pub(super) span: u64,
    pub(super) position: u32,
    pub(super) point_id: i64,
    pub(super) place: [f64; 3],
}

/// The nearest points of a point.
#[derive(Debug, Clone, Default)]
pub(super) struct Nearest {
    /// In no particular order, the point itself not among them.
    pub(super) points: Vec<Stored>,
    /// No other point is nearer than this, in units of the coordinates; ∞ if there are no others.
    pub(super) radius: f64,
    /// Whether there are more at exactly this radius, with larger ids.
    pub(super) is_tied: bool,
}

/// A point that may be one of the nearest.
struct Candidate {
    squared: f64,
    stored: Stored,
}

impl Ord for Candidate {
    fn cmp(&self, other: &Self) -> Ordering {
        self.squared.total_cmp(&other.squared).then_with(|| self.stored.point_id.cmp(&other.stored.point_id))
    }
}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Candidate {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Candidate {}

/// The nearest points so far.
#[derive(Default)]
struct Candidates {
    nearest: BinaryHeap<Candidate>,
    /// The least squared distance of those that were dropped.
    beyond: Option<f64>,
}

/// Finds the nearest points of many points at the same time.
pub(super) struct Search<'a> {
    archive: &'a dyn Archive,
    lattice: &'a Lattice,
    within: Within,
    /// How many are wanted, the point itself not counted.
    wanted: usize,
}

impl<'a> Search<'a> {
    /// For `wanted` others, `flat` on the map or in space.
    pub(super) fn new(archive: &'a dyn Archive, lattice: &'a Lattice, flat: bool, wanted: usize) -> Self {
        let metric = if flat { Metric::Xy } else { Metric::Xyz };
        Self { archive, lattice, within: Within::new(f64::INFINITY, metric, lattice), wanted }
    }

    /// The nearest points of each of `points`.
    pub(super) fn nearest(&self, points: &[Stored]) -> Result<Vec<Nearest>> {
        let mut found: Vec<Candidates> = points.iter().map(|_| Candidates::default()).collect();
        let mut ring: BTreeSet<u64> = points.iter().filter(|_| self.wanted > 0).map(|point| point.span).collect();
        let mut seen = BTreeSet::new();
        // What is found nearby keeps the way to other spans short.
        for &index in &ring {
            self.look_in(index, |point| point.span == index, points, &mut found)?;
        }
        while !ring.is_empty() {
            let mut goes_on = seen.is_empty();
            for &index in &ring {
                goes_on |= self.look_in(index, |point| point.span != index, points, &mut found)?;
            }
            let spans = self.archive.extents().len() as u64;
            let beside = ring.iter().flat_map(|&index| [index.checked_sub(1), Some(index + 1)]).flatten();
            let next =
                beside.filter(|index| goes_on && *index < spans && !ring.contains(index) && !seen.contains(index));
            let next = next.collect();
            seen = std::mem::replace(&mut ring, next);
        }
        Ok(found.into_iter().map(|candidates| self.told(candidates)).collect())
    }

    fn told(&self, Candidates { nearest, beyond }: Candidates) -> Nearest {
        let is_all = nearest.len() < self.wanted;
        let last = nearest.peek().map_or(0.0, |last| last.squared);
        let points = nearest.into_iter().map(|candidate| candidate.stored).collect();
        let radius = if is_all { f64::INFINITY } else { self.within.length(last) };
        // Where no other is wanted, nobody has looked whether there are some at the same place.
        Nearest { points, radius, is_tied: self.wanted == 0 || beyond == Some(last) }
    }

    /// How far away the last of those found is; nothing is too far while more are wanted.
    fn reach(&self, Candidates { nearest, .. }: &Candidates) -> f64 {
        match nearest.peek() {
            Some(last) if nearest.len() == self.wanted => self.within.length(last.squared) * (1.0 + SLACK),
            _ => f64::INFINITY,
        }
    }

    /// Looks in one span for whatever may be nearer than what has been found; whether there may have been anything.
    fn look_in(
        &self,
        index: u64,
        for_whom: impl Fn(&Stored) -> bool,
        points: &[Stored],
        found: &mut [Candidates],
    ) -> Result<bool> {
        let extent = self.archive.extents()[index as usize];
        let is_near = |at: &usize| {
            let point = &points[*at];
            for_whom(point) && extent.gap(&point.place, self.lattice) <= self.reach(&found[*at])
        };
        let near: Vec<usize> = (0..points.len()).filter(is_near).collect();
        if near.is_empty() {
            return Ok(false);
        }
        let span = self.archive.read(index)?;
        let across = Across::new(&span, extent, self.lattice);
        for at in near {
            let point = &points[at];
            for (away, position) in across.outward_from(&point.place) {
                if away > self.reach(&found[at]) {
                    break;
                }
                let (place, point_id) = (span.points[position as usize], span.point_id(position as usize));
                if point_id != point.point_id {
                    let stored = Stored { span: index, position, point_id, place };
                    self.consider(
                        Candidate { squared: self.within.squared(&point.place, &place), stored },
                        &mut found[at],
                    );
                }
            }
        }
        Ok(true)
    }

    fn consider(&self, candidate: Candidate, found: &mut Candidates) {
        found.nearest.push(candidate);
        if found.nearest.len() > self.wanted
            && let Some(dropped) = found.nearest.pop()
        {
            found.beyond = Some(found.beyond.map_or(dropped.squared, |beyond| beyond.min(dropped.squared)));
        }
    }
}

/// More than what rounding does to a length.
const SLACK: f64 = 1e-9;

/// The points of a span in the order of where they lie across the direction of the spans.
struct Across<'a> {
    lattice: &'a Lattice,
    extent: Extent,
    sorted: Vec<(f64, u32)>,
}

impl<'a> Across<'a> {
    fn new(span: &Span, extent: Extent, lattice: &'a Lattice) -> Self {
        let valid = (0..).zip(&span.points).filter(|(_, place)| is_valid(place));
        let mut across = Self { lattice, extent, sorted: Vec::new() };
        across.sorted = valid.map(|(position, place)| (across.of(place), position)).collect();
        across.sorted.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        across
    }

    /// In units of the coordinates.
    fn of(&self, place: &[f64; 3]) -> f64 {
        let ([x, y], [along_x, along_y]) = (self.lattice.horizontal(place), self.extent.direction);
        (along_x * y - along_y * x) * self.lattice.horizontal_unit()
    }

    /// Positions of all points in the order of how far across they are from `place`, and at least how far.
    fn outward_from(&self, place: &[f64; 3]) -> impl Iterator<Item = (f64, u32)> {
        let from = self.of(place);
        let (mut low, mut high) = {
            let middle = self.sorted.partition_point(|(across, _)| *across < from);
            (middle, middle)
        };
        let rounding = 16.0 * f64::EPSILON * (1.0 + from.abs());
        std::iter::from_fn(move || {
            let below = low.checked_sub(1).map(|at| from - self.sorted[at].0);
            let above = self.sorted.get(high).map(|(across, _)| across - from);
            let (away, at) = match (below, above) {
                (None, None) => return None,
                (Some(below), above) if above.is_none_or(|above| below < above) => {
                    low -= 1;
                    (below, low)
                }
                (below, above) => {
                    high += 1;
                    (above.or(below).unwrap_or_default(), high - 1)
                }
            };
            Some((away - rounding, self.sorted[at].1))
        })
    }
}
