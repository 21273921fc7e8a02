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
//! triangulation of the map it is a segmentation of its own, which splits more: roofs from ground. There an edge counts only
//! if a circle proves it that lies inside what the window has loaded; what is left open at its borders ([`Frontier`]) is
//! decided from window to window.
//!
//! [`Frontier`]: crate::front::Frontier
//!
//! The radius graph joins all pairs within the distance (Euclidean clustering: Rusu 2009). It needs no triangulation, and
//! any window that holds a pair decides it rightly under either metric.

mod borders;
mod joined;

use super::{Exactness, Segmented, Segmentor};
use crate::certificate::Tally;
use crate::error::{Result, positive};
use crate::label::Labels;
use crate::lattice::{Metric, Within};
use crate::neighborhood::{Delaunay, Edge, Grid, Search};
use crate::union_find::UnionFind;
use crate::window::Window;
use borders::{frontier, loaded};
use joined::Joined;

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
        Ok(match self.graph {
            Graph::Delaunay => self.segment_triangulation(window),
            Graph::Radius => self.segment_pairs(window).into(),
        })
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

    fn segment_triangulation(&self, window: &Window) -> Segmented {
        let points = window.points();
        let horizontal: Vec<[f64; 2]> = points.iter().map(|point| window.lattice().horizontal(point)).collect();
        let neighbors = Delaunay::new(horizontal, |i| points[i as usize][2]);
        // In the order of the neighborhood, near points are near in memory.
        let ordered = neighbors.order().iter().map(|&i| points[i as usize]).collect();
        let mut joined = Joined::new(ordered, Within::new(self.distance, self.metric, window.lattice()));
        for stack in neighbors.stacks() {
            joined.join_stack(stack);
        }
        match self.metric {
            Metric::Xy => {
                neighbors.for_each_edge(|a, b, _| joined.join_on_the_map(a, b));
                labels(&joined.into_representatives(), neighbors.order()).into()
            }
            Metric::Xyz => in_space(window, &neighbors, joined),
        }
    }
}

/// Joins what the canonical graph joins, as far as the window can know it; the rest is left to the front.
fn in_space(window: &Window, neighbors: &Delaunay, mut joined: Joined) -> Segmented {
    // Where spans are cut in stream order nothing is known of what else may come.
    let finality = loaded(window).map(|loaded| neighbors.finality(loaded));
    let is_final = |edge: &Edge<'_>| finality.as_ref().is_none_or(|finality| edge.is_final(finality));
    neighbors.for_each_edge(|a, b, edge| joined.decide(a, b, || is_final(&edge)));
    // Only now: most of the places on a circle are one segment already, and then there is nothing to be decided.
    let mut on_circles = Vec::new();
    neighbors.for_each_cocircular_pair(
        |stacks| joined.are_one(stacks),
        |a, b, edge| on_circles.push((a, b, is_final(&edge))),
    );
    for (a, b, is_final) in on_circles {
        joined.decide_again(a, b, is_final);
    }
    let (decided, open) = joined.decisions();
    let labels = labels(&joined.into_representatives(), neighbors.order());
    let Some(finality) = finality else { return labels.into() };
    let frontier = frontier(window, neighbors, &finality, open, &labels);
    let tally = Tally { decided_edges: decided, waiting_edges: frontier.edges.len() as u64, ..Tally::default() };
    Segmented { frontier: Some(frontier), tally, ..labels.into() }
}

/// Labels in window order from representatives in neighborhood order.
fn labels(representatives: &[u32], order: &[u32]) -> Labels {
    let mut of_point = vec![0; order.len()];
    for (&point, &representative) in order.iter().zip(representatives) {
        of_point[point as usize] = representative;
    }
    Labels::from_representatives(of_point.into_iter(), order.len())
}
