//! Proximity segmentation: components of the Delaunay edges, or of all pairs, that are no longer than a distance.
//!
//! Source: the demonstration segmentor of the moving-window framework (ISPRS Annals I-3, 2012, section 3.2).
//! 1. Triangulate the window on the map ([`Delaunay`]).
//! 2. Keep an edge if its ends are within the distance, under the metric.
//! 3. Label the connected components of what was kept.
//!
//! Departure: points with equal xy are kept, all of them. Two points are neighbors when their xy is equal or
//! Delaunay-adjacent, and joined when within the distance. Of places on one empty circle all pairs are adjacent, not only
//! those that a triangulator happens to choose.
//!
//! With the xy metric the result is that of the 2-D radius graph, because the Euclidean minimum spanning tree is part of
//! every Delaunay triangulation; so any window that holds a pair decides it rightly. With lengths in space on the
//! triangulation of the map it is a segmentation of its own, which splits more: roofs from ground.
//!
//! The radius graph joins all pairs within the distance (Euclidean clustering: Rusu 2009). It needs no triangulation, and
//! any window that holds a pair decides it rightly under either metric.

use std::ops::Range;

use super::{Exactness, Segmented, Segmentor};
use crate::error::{Result, positive};
use crate::label::Labels;
use crate::lattice::{Metric, Within};
use crate::neighborhood::{Delaunay, Grid, Loaded, Search};
use crate::span::Extent;
use crate::union_find::UnionFind;
use crate::window::Window;

/// Which pairs of points are looked at.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Graph {
    /// Neighbors in the Delaunay triangulation of the map.
    #[default]
    Delaunay,
    /// All pairs.
    Radius,
}

/// Components of the pairs within a distance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Proximity {
    distance: f64,
    graph: Graph,
    metric: Metric,
}

impl Proximity {
    /// Joins Delaunay neighbors that are within `distance`, in units of the coordinates.
    ///
    /// # Errors
    /// If the distance is not a finite number above 0.
    pub fn new(distance: f64, metric: Metric) -> Result<Self> {
        Ok(Self { distance: positive("distance", distance)?, graph: Graph::default(), metric })
    }

    /// The same over the pairs of `graph`.
    #[must_use]
    pub fn with_graph(self, graph: Graph) -> Self {
        Self { graph, ..self }
    }

    /// Which pairs are looked at.
    pub fn graph(&self) -> Graph {
        self.graph
    }

    /// The greatest length of a kept edge.
    pub fn distance(&self) -> f64 {
        self.distance
    }

    /// Which coordinates count for the length.
    pub fn metric(&self) -> Metric {
        self.metric
    }
}

impl Segmentor for Proximity {
    fn name(&self) -> &'static str {
        "proximity"
    }

    fn exactness(&self) -> Exactness {
        match (self.graph, self.metric) {
            (Graph::Delaunay, Metric::Xyz) => Exactness::Proven { reach: self.distance },
            (Graph::Radius, _) | (_, Metric::Xy) => Exactness::ByLocality { reach: self.distance },
        }
    }

    fn bytes_per_point(&self) -> usize {
        match self.graph {
            Graph::Delaunay => 190,
            Graph::Radius => Grid::BYTES_PER_POINT + 20,
        }
    }

    fn segment(&self, window: &Window) -> Result<Segmented> {
        let labels = match self.graph {
            Graph::Delaunay => self.segment_triangulation(window),
            Graph::Radius => self.segment_pairs(window),
        };
        Ok(labels.into())
    }
}

impl Proximity {
    fn segment_pairs(&self, window: &Window) -> Labels {
        let (points, point_ids) = (window.points(), window.point_ids());
        let search = match self.metric {
            Metric::Xyz => Search::Ball { radius: self.distance },
            Metric::Xy => Search::Disc { radius: self.distance },
        };
        let mut sets = UnionFind::new(points.len());
        Grid::new(points, point_ids, window.lattice(), search).join_neighbors(&mut sets);
        Labels::from_representatives(sets.into_representatives().into_iter(), points.len())
    }

    fn segment_triangulation(&self, window: &Window) -> Labels {
        let points = window.points();
        let horizontal: Vec<[f64; 2]> = points.iter().map(|point| window.lattice().horizontal(point)).collect();
        let neighbors = Delaunay::new(&horizontal, |i| points[i as usize][2]);
        drop(horizontal);
        let mut joined = Joined {
            // In the order of the neighborhood, near points are near in memory.
            points: neighbors.order().iter().map(|&i| points[i as usize]).collect(),
            sets: UnionFind::new(points.len()),
            within: Within::new(self.distance, self.metric, window.lattice()),
            flat: self.metric == Metric::Xy,
        };
        for stack in neighbors.stacks() {
            joined.join_stack(stack);
        }
        // With lengths on the map any window that holds a pair decides it rightly.
        let loaded = window.extent().filter(|_| self.metric == Metric::Xyz);
        let loaded = loaded.map(|Extent { direction, low, high, .. }| Loaded { direction, low, high });
        neighbors.for_each_edge(|a, b, edge| {
            if loaded.is_none_or(|loaded| edge.is_final(&loaded)) {
                joined.join_neighbors(a, b);
            }
        });
        // On the map any choice of edges gives the same components; in space the canonical graph is what is meant.
        if self.metric == Metric::Xyz {
            let mut pairs = Vec::new();
            neighbors.for_each_cocircular_pair(
                |stacks| joined.are_one(stacks),
                |a, b, edge| {
                    if loaded.is_none_or(|loaded| edge.is_final(&loaded)) {
                        pairs.push([a, b]);
                    }
                },
            );
            for [a, b] in pairs {
                joined.join_neighbors(a, b);
            }
        }
        labels(&joined.sets.into_representatives(), neighbors.order())
    }
}

/// Labels in window order from representatives in neighborhood order.
fn labels(representatives: &[u32], order: &[u32]) -> Labels {
    let mut of_point = vec![0; order.len()];
    for (&point, &representative) in order.iter().zip(representatives) {
        of_point[point as usize] = representative;
    }
    Labels::from_representatives(of_point.into_iter(), order.len())
}

/// The points in neighborhood order, and which of them are one segment.
struct Joined {
    points: Vec<[f64; 3]>,
    sets: UnionFind,
    within: Within,
    flat: bool,
}

impl Joined {
    /// Joins the points of a stack. They are in order of height, so consecutive pairs are enough.
    fn join_stack(&mut self, stack: Range<usize>) {
        for upper in stack.start + 1..stack.end {
            self.join_pair(upper - 1, upper);
        }
    }

    #[inline]
    fn join_pair(&mut self, a: usize, b: usize) {
        if self.within.pair(&self.points[a], &self.points[b]) {
            self.sets.union(a as u32, b as u32);
        }
    }

    /// Whether all points of the stacks are one segment.
    fn are_one(&mut self, stacks: [Range<usize>; 4]) -> bool {
        let first = stacks[0].start as u32;
        stacks.into_iter().flatten().all(|point| self.sets.same(first, point as u32))
    }

    /// Joins the points of two neighboring stacks.
    #[inline]
    fn join_neighbors(&mut self, a: Range<usize>, b: Range<usize>) {
        if self.flat || (a.len() == 1 && b.len() == 1) {
            self.join_pair(a.start, b.start);
        } else {
            self.join_tall(a, b);
        }
    }

    /// Joins each point of `a` with the nearest of `b` above and below it. Those of `b` beyond them on the same side
    /// and within the distance of it are within the distance of each other, and so are joined already.
    fn join_tall(&mut self, a: Range<usize>, b: Range<usize>) {
        let mut above = b.start;
        for point in a {
            let height = self.points[point][2];
            while above < b.end && self.points[above][2] < height {
                above += 1;
            }
            if above < b.end {
                self.join_pair(point, above);
            }
            if above > b.start {
                self.join_pair(point, above - 1);
            }
        }
    }
}
