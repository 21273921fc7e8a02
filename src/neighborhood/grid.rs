//! The one neighbor search: a grid over the points of a window, sorted by counting.
//!
//! Squared distances are those of [`Within`]: on a lattice exact whole numbers, so a pair at exactly the radius is a
//! neighbor, and equal distances are equal. What is found for a point depends on the points around it alone: not on
//! their order, nor on what else the window holds.

use std::cmp::Ordering;

use super::cells::{BLOCK, Cells, squared_distances, up_to};
use super::components::components;
use super::finder::Finder;
use super::nearest::Nearest;
use super::search::Search;
use crate::awaited::is_given_up;
use crate::lattice::{Lattice, Metric, Rise, Within};
use crate::union_find::UnionFind;

/// A neighbor of a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Neighbor {
    /// Its number in the window.
    pub point: u32,
    /// Its squared distance under the search's metric, in the grid's own unit, in which lattice distances are exact;
    /// [`Grid::length`] turns it into a length.
    pub squared: f64,
}

impl Neighbor {
    /// In ascending order of (distance, point id).
    pub(super) fn compare(&self, other: &Neighbor, point_ids: &[i64]) -> Ordering {
        let id = |neighbor: &Neighbor| point_ids[neighbor.point as usize];
        self.squared.total_cmp(&other.squared).then_with(|| id(self).cmp(&id(other)))
    }
}

/// The points of a window, sorted into cells.
pub struct Grid<'a> {
    point_ids: &'a [i64],
    search: Search,
    within: Within,
    rise: Option<Rise>,
    cells: Cells,
    /// Where each point is in the order of the cells.
    places: Vec<u32>,
}

impl Grid<'_> {
    /// Bytes of memory per point, measured, those while it is made included.
    pub const BYTES_PER_POINT: usize = 70;
}

impl<'a> Grid<'a> {
    /// Sorts `points`, which lie on `lattice`, into cells that suit `search`; `point_ids` break ties.
    pub fn new(points: &'a [[f64; 3]], point_ids: &'a [i64], lattice: &Lattice, search: Search) -> Self {
        let (metric, rise) = match search {
            Search::Ball { .. } | Search::Nearest { flat: false, .. } => (Metric::Xyz, None),
            Search::Disc { .. } | Search::Nearest { flat: true, .. } => (Metric::Xy, None),
            Search::Cylinder { low, high, .. } => (Metric::Xy, Some(Rise::new(low, high, lattice))),
        };
        // However many are asked for, that one more than there are cannot be found says enough.
        let search = match search {
            Search::Nearest { k, flat, within } => Search::Nearest { k: k.min(points.len() + 1), flat, within },
            search => search,
        };
        let within = Within::new(search.reach(), metric, lattice);
        let cells = Cells::new(points, point_ids, &within);
        let mut places = vec![0; points.len()];
        for (place, &point) in (0..).zip(&cells.order) {
            places[point as usize] = place;
        }
        Self { point_ids, search, within, rise, cells, places }
    }

    /// The numbers of all points, cell by cell: points near each other are mostly near each other here.
    pub fn order(&self) -> &[u32] {
        &self.cells.order
    }

    /// The search.
    pub fn search(&self) -> Search {
        self.search
    }

    /// The length of a squared distance, in units of the coordinates.
    pub fn length(&self, squared: f64) -> f64 {
        self.within.length(squared)
    }

    /// Replaces `found` by the neighbors of `point` and the point itself, in ascending order of (distance, point id); the
    /// point itself comes first.
    pub fn neighbors(&self, point: u32, found: &mut Vec<Neighbor>) {
        if is_given_up() {
            found.clear();
            found.push(Neighbor { point, squared: 0.0 });
            return;
        }
        if let Search::Nearest { k, .. } = self.search {
            Nearest::search(&self.cells, self.point_ids, &self.within, self.places[point as usize], k, found);
            return;
        }
        found.clear();
        self.for_each_neighbor(point, |neighbor| found.push(neighbor));
        // The point itself takes the first place, whatever the ids of points that coincide with it.
        if let Some(own) = found.iter().position(|neighbor| neighbor.point == point) {
            found.swap(0, own);
            found[1..].sort_unstable_by(|a, b| a.compare(b, self.point_ids));
        }
    }

    /// Finds the neighbors of many points, one after the other.
    pub fn finder(&self) -> Finder<'_> {
        Finder::new(self)
    }

    /// Calls `visit` for all neighbors of `point` and for the point itself, in an order that is nobody's business: it
    /// depends on the window. For a number of nearest points use [`Self::neighbors`].
    pub fn for_each_neighbor(&self, point: u32, mut visit: impl FnMut(Neighbor)) {
        if is_given_up() {
            return;
        }
        self.visit(self.places[point as usize], false, |neighbor| {
            visit(neighbor);
            true
        });
    }

    /// Whether `point` has at least so many neighbors, itself included; stops to look when it has.
    pub fn has_neighbors(&self, point: u32, at_least: usize) -> bool {
        if is_given_up() {
            return false;
        }
        let mut count = 0;
        self.visit(self.places[point as usize], false, |_| {
            count += 1;
            count < at_least
        });
        count >= at_least
    }

    /// Makes all neighbors one set: the components of the radius graph. Only for symmetric searches.
    pub fn join_neighbors(&self, sets: &mut UnionFind) {
        if self.rise.is_some() {
            self.for_each_pair(|a, b| sets.union(a, b));
            return;
        }
        let order = self.order();
        let representatives = components(&self.cells, &self.within).into_representatives();
        for (&point, &representative) in order.iter().zip(&representatives) {
            sets.union(order[representative as usize], point);
        }
    }

    /// Calls `visit` for every pair of neighbors once, the smaller number of the window not necessarily first. Only for
    /// symmetric searches.
    pub fn for_each_pair(&self, mut visit: impl FnMut(u32, u32)) {
        for (place, &point) in (0..).zip(self.order()).take_while(|_| !is_given_up()) {
            self.visit(place, true, |neighbor| {
                visit(point, neighbor.point);
                true
            });
        }
    }

    pub(super) fn point_ids(&self) -> &[i64] {
        self.point_ids
    }

    pub(super) fn within(&self) -> &Within {
        &self.within
    }

    pub(super) fn cells(&self) -> &Cells {
        &self.cells
    }

    /// Where a point is in the order.
    pub(super) fn place(&self, point: u32) -> u32 {
        self.places[point as usize]
    }

    /// Whether the point at `other`, whose squared distance is known, is a neighbor of `point`.
    #[inline]
    pub(super) fn is_pair(&self, squared: f64, point: &[f64; 3], other: u32) -> bool {
        self.within.pair_if(squared, || (*point, self.cells.point(other)))
            && self.rise.is_none_or(|rise| rise.pair(point[2], self.cells.point(other)[2]))
    }

    /// Calls `visit` for the neighbors of the point at `place` of the order until it says no; with `onward`, only for
    /// those behind it in the order.
    #[inline]
    fn visit(&self, place: u32, onward: bool, mut visit: impl FnMut(Neighbor) -> bool) {
        let (cells, within) = (&self.cells, &self.within);
        let point = cells.point(place);
        cells.visit_near(place as usize / BLOCK, onward, &point, within, &mut |block| {
            let squared = squared_distances(&point, &cells.blocks[block], &within.weights());
            for i in up_to(within.limit(), &squared) {
                let (other, squared) = ((block * BLOCK + i) as u32, squared[i]);
                if self.is_pair(squared, &point, other)
                    && (other > place || !onward)
                    && !visit(Neighbor { point: cells.order[other as usize], squared })
                {
                    return false;
                }
            }
            true
        });
    }
}
