//! The neighbors of all points of a window, kept for those who look at them more than once.

use super::grid::{Grid, Neighbor};
use super::search::Search;

/// The neighbors of each point, in ascending order of (distance, point id), the point itself being the first.
#[derive(Debug, Clone, PartialEq)]
pub struct Neighborhoods {
    search: Search,
    neighbors: Vec<u32>,
    order: Vec<u32>,
    /// Where each point's are among them, and how many.
    places: Vec<(usize, u32)>,
    support: Vec<f64>,
}

impl Neighborhoods {
    /// Nothing yet of what `search` finds for `points` points.
    pub fn new(search: Search, points: usize) -> Self {
        let neighbors = Vec::new();
        let order = Vec::with_capacity(points);
        Self { search, neighbors, order, places: vec![(0, 0); points], support: vec![0.0; points] }
    }

    /// Keeps the neighbors of `point`; what lies within `support` of it says who they are.
    pub fn keep(&mut self, point: u32, neighbors: impl Iterator<Item = u32>, support: f64) {
        self.order.push(point);
        let first = self.neighbors.len();
        self.neighbors.extend(neighbors);
        self.places[point as usize] = (first, (self.neighbors.len() - first) as u32);
        self.support[point as usize] = support;
    }

    /// The search that found them.
    pub fn search(&self) -> Search {
        self.search
    }

    /// The points in the order in which their neighbors were kept, which is that in memory.
    pub fn order(&self) -> &[u32] {
        &self.order
    }

    /// The neighbors of a point.
    pub fn of(&self, point: u32) -> &[u32] {
        let (first, count) = self.places[point as usize];
        &self.neighbors[first..first + count as usize]
    }

    /// How far around a point something could change its neighborhood, in units of the coordinates.
    pub fn support(&self, point: u32) -> f64 {
        self.support[point as usize]
    }

    /// The same with only the points at `kept`, in ascending order: the others are nobody's neighbors any more.
    #[must_use]
    pub fn restricted(&self, kept: &[u32]) -> Self {
        const GONE: u32 = u32::MAX;
        let mut number = vec![GONE; self.places.len()];
        for (new, &old) in (0..).zip(kept) {
            number[old as usize] = new;
        }
        let mut rest = Self::new(self.search, kept.len());
        for (new, &old) in (0..).zip(kept) {
            let neighbors = self.of(old).iter().map(|&neighbor| number[neighbor as usize]);
            rest.keep(new, neighbors.filter(|&neighbor| neighbor != GONE), self.support(old));
        }
        rest
    }
}

/// How far around a point something could change that `found` are its neighbors, in units of the coordinates; ∞ if
/// they are fewer than were asked for, and nothing limits how far they may be.
pub fn support(grid: &Grid, found: &[Neighbor]) -> f64 {
    match (grid.search(), found.last()) {
        (Search::Nearest { k, .. }, Some(last)) if found.len() == k => grid.length(last.squared),
        (search, _) => search.reach(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lattice::Lattice;

    #[test]
    fn what_is_kept_is_what_the_grid_finds_less_those_who_left() {
        let points: Vec<[f64; 3]> = (0..6).map(|i| [f64::from(i * i), 0.0, 0.0]).collect();
        let search = Search::nearest(3, None).unwrap();
        let ids: Vec<i64> = (0..6).collect();
        let grid = Grid::new(&points, &ids, &Lattice::REAL, search);
        let mut kept = Neighborhoods::new(search, 6);
        let mut found = Vec::new();
        for point in 0..6 {
            grid.neighbors(point, &mut found);
            kept.keep(point, found.iter().map(|neighbor| neighbor.point), support(&grid, &found));
        }
        assert_eq!((kept.of(0), kept.of(3), kept.support(3)), (&[0, 1, 2][..], &[3, 2, 4][..], 7.0));
        let rest = kept.restricted(&[0, 2, 3, 5]);
        assert_eq!((rest.of(0), rest.of(2), rest.support(2)), (&[0, 1][..], &[2, 1][..], 7.0));
    }

    #[test]
    fn fewer_than_asked_for_may_be_joined_by_anyone() {
        let points = [[0.0; 3], [1.0, 0.0, 0.0]];
        for (search, expected) in [
            (Search::nearest(3, None).unwrap(), f64::INFINITY),
            (Search::nearest(3, Some(5.0)).unwrap(), 5.0),
            (Search::nearest(2, None).unwrap(), 1.0),
            (Search::ball(3.0).unwrap(), 3.0),
        ] {
            let grid = Grid::new(&points, &[0, 1], &Lattice::REAL, search);
            let mut found = Vec::new();
            grid.neighbors(0, &mut found);
            assert_eq!(support(&grid, &found), expected);
        }
    }
}
