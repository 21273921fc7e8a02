//! The one neighbor search: a counting-sort grid over the points of a window.

use super::search::Search;
use crate::lattice::Lattice;
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

/// The points of a window, sorted into cells.
pub struct Grid<'a> {
    points: &'a [[f64; 3]],
    point_ids: &'a [i64],
    lattice: Lattice,
    search: Search,
    order: Vec<u32>,
}

impl<'a> Grid<'a> {
    /// Sorts `points`, which lie on `lattice`, into cells that suit `search`; `point_ids` break ties.
    pub fn new(points: &'a [[f64; 3]], point_ids: &'a [i64], lattice: &Lattice, search: Search) -> Self {
        Self { points, point_ids, lattice: *lattice, search, order: (0..points.len() as u32).collect() }
    }

    /// The numbers of all points, cell by cell: points near each other are mostly near each other here.
    pub fn order(&self) -> &[u32] {
        &self.order
    }

    /// The search.
    pub fn search(&self) -> Search {
        self.search
    }

    /// The length of a squared distance, in units of the coordinates.
    pub fn length(&self, squared: f64) -> f64 {
        squared.sqrt()
    }

    /// Replaces `found` by the neighbors of `point` and the point itself, in ascending order of (distance, point id); the
    /// point itself comes first.
    pub fn neighbors(&self, point: u32, found: &mut Vec<Neighbor>) {
        found.clear();
        let scale = self.lattice.scale();
        let p = self.points[point as usize];
        for (i, q) in (0..).zip(self.points) {
            let d: [f64; 3] = std::array::from_fn(|k| (q[k] - p[k]) * scale[k]);
            let flat = d[0] * d[0] + d[1] * d[1];
            let (squared, near) = match self.search {
                Search::Disc { radius } => (flat, flat <= radius * radius),
                Search::Cylinder { radius, low, high } => {
                    (flat, flat <= radius * radius && low <= d[2] && d[2] <= high)
                }
                Search::Ball { radius } => (flat + d[2] * d[2], flat + d[2] * d[2] <= radius * radius),
                Search::Nearest { flat: on_map, within, .. } => {
                    let squared = if on_map { flat } else { flat + d[2] * d[2] };
                    (squared, squared <= within * within)
                }
            };
            if near {
                found.push(Neighbor { point: i, squared });
            }
        }
        let id = |n: &Neighbor| (n.point != point, self.point_ids[n.point as usize]);
        found.sort_by(|a, b| a.squared.total_cmp(&b.squared).then_with(|| id(a).cmp(&id(b))));
        if let Search::Nearest { k, .. } = self.search {
            found.truncate(k);
        }
    }

    /// Makes all neighbors one set: the components of the radius graph. Only for symmetric searches.
    pub fn join_neighbors(&self, sets: &mut UnionFind) {
        self.for_each_pair(|a, b| sets.union(a, b));
    }

    /// Calls `visit` for every pair of neighbors once, the smaller number of the window not necessarily first. Only for
    /// symmetric searches.
    pub fn for_each_pair(&self, mut visit: impl FnMut(u32, u32)) {
        let mut found = Vec::new();
        for &a in &self.order {
            self.neighbors(a, &mut found);
            for neighbor in found.iter().filter(|neighbor| neighbor.point > a) {
                visit(a, neighbor.point);
            }
        }
    }
}
