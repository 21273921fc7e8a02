//! Which triangles of a triangulation are triangles of the whole cloud's, whatever may come.
//!
//! A triangle is *final* if its circumcircle lies inside what has been loaded ([`Loaded`]). Triangles that share an empty
//! circle are final together: rounding may see it from one of them and not from another. A vertex is *open* if one of its
//! triangles is not final, or if it is on the hull, beyond which nothing is known: it may get further neighbors. All
//! others have the neighbors that they have for good. On a straight part of the hull less will do ([`Opening`]).
//!
//! The triangles whose circles hold a place are connected, and reach the hull if the place lies beyond (Bowyer 1981, Watson
//! 1981). So those that are not final are found from the hull on, and no others need be looked at.

use std::collections::BTreeMap;

use rustc_hash::FxHashSet;
use spade::handles::VertexHandle;
use spade::{DelaunayTriangulation, Point2, Triangulation};

use super::cocircular::{Face, corners, is_one_circle};
use super::opening::{Opening, straight_parts};
use crate::neighborhood::Loaded;

type Triangles = DelaunayTriangulation<Point2<f64>>;

/// What of a neighborhood is final.
pub struct Finality {
    pub(super) loaded: Loaded,
    /// The triangles that are not.
    open: FxHashSet<Face>,
}

impl Finality {
    /// What is final of a line of places.
    pub(super) fn of_line(loaded: Loaded) -> Self {
        Self { loaded, open: FxHashSet::default() }
    }

    pub(super) fn of_triangles(triangulation: &Triangles, loaded: Loaded) -> Self {
        let mut finality = Self { loaded, open: FxHashSet::default() };
        if loaded.is_everything() {
            return finality;
        }
        let on_hull = triangulation.convex_hull().filter_map(|edge| Some(edge.rev().face().as_inner()?.fix()));
        let mut waiting: Vec<Face> = on_hull.collect();
        while let Some(face) = waiting.pop() {
            let corners = triangulation.face(face).positions().map(|place| [place.x, place.y]);
            if !loaded.holds_circle(&corners) && finality.open.insert(face) {
                let edges = triangulation.face(face).adjacent_edges().into_iter();
                waiting.extend(edges.filter_map(|edge| Some(edge.rev().face().as_inner()?.fix())));
            }
        }
        for face in finality.open.iter().copied().collect::<Vec<Face>>() {
            finality.spread_to(triangulation, face);
        }
        finality
    }

    /// Makes a triangle final that shares its circle with one that is, and then those that share it further on.
    fn spread_to(&mut self, triangulation: &Triangles, face: Face) {
        let mut waiting = vec![face];
        while let Some(face) = waiting.pop() {
            let edges = triangulation.face(face).adjacent_edges().into_iter();
            let sharing = edges.filter(|edge| corners(*edge).is_some_and(is_one_circle));
            let others: Vec<Face> = sharing.filter_map(|edge| Some(edge.rev().face().as_inner()?.fix())).collect();
            if !self.of_face(face) && others.iter().any(|other| self.of_face(*other)) {
                self.open.remove(&face);
                waiting.extend(others);
            }
        }
    }

    /// What has been loaded.
    pub fn loaded(&self) -> Loaded {
        self.loaded
    }

    /// Whether the triangle is final.
    pub(super) fn of_face(&self, face: Face) -> bool {
        !self.open.contains(&face)
    }

    /// The numbers of the open vertices, ascending, and where they are open.
    pub(super) fn open_vertices(&self, triangulation: &Triangles) -> BTreeMap<usize, Opening> {
        if self.loaded.is_everything() {
            return BTreeMap::new();
        }
        let of_faces = self.open.iter().flat_map(|face| triangulation.face(*face).vertices());
        let mut open: BTreeMap<_, _> = of_faces.map(|vertex| (vertex.index(), Opening::Anywhere)).collect();
        let vertex =
            |vertex: VertexHandle<'_, Point2<f64>>| (vertex.index(), [vertex.position().x, vertex.position().y]);
        // Clockwise, so that what lies beyond is to the left.
        let hull = triangulation.convex_hull().map(|edge| vertex(edge.from())).collect();
        for part in straight_parts(hull) {
            let (first, last) = (part[0], part[part.len() - 1]);
            open.insert(first.0, Opening::Anywhere);
            for (vertex, _) in &part[1..part.len() - 1] {
                open.entry(*vertex).or_insert(Opening::LeftOf([first.1, last.1]));
            }
        }
        open
    }

    /// The open ones of places on one line, and where they are open.
    pub(super) fn open_along(&self, line: &[(u32, [f64; 2])]) -> Vec<(u32, Opening)> {
        let (Some((_, first)), Some((_, last)), false) = (line.first(), line.last(), self.loaded.is_everything())
        else {
            return Vec::new();
        };
        let is_final = |pair: &[(u32, [f64; 2])]| self.loaded.proves(pair[0].1, pair[1].1, None, None);
        let opening = |at: usize| {
            let sides = [at.checked_sub(1).map(|before| &line[before..=at]), line.get(at..at + 2)];
            if sides.into_iter().all(|pair| pair.is_some_and(is_final)) {
                Opening::Beside([*first, *last])
            } else {
                Opening::Anywhere
            }
        };
        line.iter().enumerate().map(|(at, (stack, _))| (*stack, opening(at))).collect()
    }
}

#[cfg(test)]
mod tests {
    use crate::neighborhood::{Delaunay, Loaded};

    /// All that is on one circle is final together, though from some of its triangles rounding hides that.
    #[test]
    fn a_circle_is_final_as_a_whole() {
        const RIM: [[f64; 2]; 9] = [
            [65.0, 0.0],
            [63.0, 16.0],
            [60.0, 25.0],
            [56.0, 33.0],
            [52.0, 39.0],
            [39.0, 52.0],
            [33.0, 56.0],
            [25.0, 60.0],
            [16.0, 63.0],
        ];
        let places: Vec<[f64; 2]> = RIM.iter().flat_map(|&[x, y]| [[x, y], [-y, x], [-x, -y], [y, -x]]).collect();
        let neighbors = Delaunay::new(&places, |_| 0.0);
        let mut disagreements = 0;
        for step in 0..4000 {
            let high = 65.0 + f64::from(step) * 1e-13;
            let loaded = Loaded { direction: [1.0, 0.0], low: f64::NEG_INFINITY, high, largest: 0.0 };
            let finality = neighbors.finality(loaded);
            let mut verdicts = Vec::new();
            neighbors.for_each_cocircular_pair(|_| false, |_, _, edge| verdicts.push(edge.is_final(&finality)));
            assert_eq!(verdicts.len(), 36 * 35 / 2);
            let mut corners = places.windows(3).map(|places| [places[0], places[1], places[2]]);
            let first = corners.next().is_some_and(|corners| loaded.holds_circle(&corners));
            let is_final = verdicts[0];
            assert!(verdicts.iter().all(|verdict| *verdict == is_final), "{high}");
            disagreements += usize::from(corners.any(|corners| loaded.holds_circle(&corners) != first));
        }
        assert!(disagreements > 0, "rounding never hid anything");
    }
}
