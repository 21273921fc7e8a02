//! Conditional clustering: neighbors that a criterion holds for are one segment.
//!
//! Source: the generic region growing of OPALS' segmentation module (Pöchtrager, TU Wien, 2016), and PCL's conditional
//! Euclidean clustering.
//! * A *symmetric* criterion, P(p, n) = P(n, p), makes a graph: segments are its components, whatever the order.
//! * Any other makes segments grow from seeds: a segment takes in each neighbor n of its point p with P(p, n). Which
//!   segment gets there first depends on the order.
//!
//! Departure: OPALS picks seeds at random; ours are taken in the order of point ids, so that runs can be repeated.

use std::collections::VecDeque;

use super::{Exactness, Segmented, Segmentor};
use crate::error::Result;
use crate::expression::{BoundCriterion, Criterion, Pair, Symmetry};
use crate::label::{Cause, Labels, NONE};
use crate::neighborhood::{Grid, Search};
use crate::union_find::UnionFind;
use crate::window::Window;

/// Segments of points that hold together by a criterion.
#[derive(Debug, Clone)]
pub struct ConditionalClustering {
    criterion: Criterion,
    search: Search,
    is_symmetric: bool,
}

impl ConditionalClustering {
    /// Joins neighbors under `search` for which `criterion` holds.
    pub fn new(criterion: Criterion, search: Search) -> Self {
        let is_symmetric = search.is_symmetric() && matches!(criterion.symmetry(), Symmetry::Proven);
        Self { criterion, search, is_symmetric }
    }

    /// The criterion.
    pub fn criterion(&self) -> &Criterion {
        &self.criterion
    }

    /// Which points are looked at together.
    pub fn search(&self) -> Search {
        self.search
    }

    /// Whether P(p, n) = P(n, p) for all pairs, so that the result depends on no order.
    pub fn is_symmetric(&self) -> bool {
        self.is_symmetric
    }
}

impl Segmentor for ConditionalClustering {
    fn name(&self) -> &'static str {
        "conditional clustering"
    }

    fn exactness(&self) -> Exactness {
        let reach = self.search.reach();
        if self.is_symmetric { Exactness::ByLocality { reach } } else { Exactness::Measured { reach, halo: reach } }
    }

    fn attributes(&self) -> Vec<String> {
        self.criterion.attributes().map(ToString::to_string).collect()
    }

    fn check(&self, available: &[String]) -> Result<()> {
        self.criterion.check(available)
    }

    fn neighborhood(&self) -> Option<Search> {
        Some(self.search)
    }

    fn bytes_per_point(&self) -> usize {
        Grid::BYTES_PER_POINT + 60
    }

    fn cause(&self) -> Cause {
        Cause::NoSeed
    }

    fn segment(&self, window: &Window) -> Result<Segmented> {
        let criterion = self.criterion.bind(|name| window.columns().get(name))?;
        let grid = Grid::new(window.points(), window.point_ids(), window.lattice(), self.search);
        let pairs = Pairs { criterion, window };
        Ok(if self.is_symmetric { self.components(&grid, &pairs) } else { grown(&grid, &pairs) }.into())
    }
}

impl ConditionalClustering {
    fn components(&self, grid: &Grid<'_>, pairs: &Pairs<'_>) -> Labels {
        let points = pairs.window.points().len();
        let mut sets = UnionFind::new(points);
        if self.criterion.is_always_true() {
            grid.join_neighbors(&mut sets);
        } else {
            let ids = pairs.window.point_ids();
            grid.for_each_pair(|a, b| {
                // Always asked in the same direction, so that rounding cannot tell two windows apart.
                let (p, n) = if ids[a as usize] < ids[b as usize] { (a, b) } else { (b, a) };
                if !sets.same(p, n) && pairs.hold(p, n) {
                    sets.union(p, n);
                }
            });
        }
        Labels::from_representatives(sets.into_representatives().into_iter(), points)
    }
}

/// Segments that grow from seeds in the order of point ids.
fn grown(grid: &Grid<'_>, pairs: &Pairs<'_>) -> Labels {
    let window = pairs.window;
    let ids = window.point_ids();
    let mut seeds: Vec<u32> = (0..ids.len() as u32).filter(|&point| window.is_seed(point)).collect();
    seeds.sort_unstable_by_key(|&point| ids[point as usize]);
    let mut labels = vec![NONE; ids.len()];
    let mut next = 0;
    let (mut queue, mut found) = (VecDeque::new(), Vec::new());
    for seed in seeds {
        if labels[seed as usize] != NONE {
            continue;
        }
        labels[seed as usize] = next;
        queue.push_back(seed);
        while let Some(point) = queue.pop_front() {
            grid.neighbors(point, &mut found);
            for neighbor in &found {
                let label = &mut labels[neighbor.point as usize];
                if *label == NONE && pairs.hold(point, neighbor.point) {
                    *label = next;
                    queue.push_back(neighbor.point);
                }
            }
        }
        next += 1;
    }
    Labels::from_any(&labels)
}

/// The criterion over the points of a window.
struct Pairs<'a> {
    criterion: BoundCriterion<'a>,
    window: &'a Window,
}

impl Pairs<'_> {
    #[inline]
    fn hold(&self, point: u32, neighbor: u32) -> bool {
        let (p, n) = (point as usize, neighbor as usize);
        let points = self.window.points();
        let offset = self.window.lattice().offset_between(&points[p], &points[n]);
        self.criterion.holds(p, n, &Pair::of_offset(offset))
    }
}
