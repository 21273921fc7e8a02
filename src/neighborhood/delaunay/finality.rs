//! Which triangles of a triangulation are triangles of the whole cloud's, whatever may come.
//!
//! A triangle is *final* if its circumcircle lies inside what has been loaded ([`Loaded`]). Triangles that share an empty
//! circle are final together: rounding may see it from one of them and not from another. A vertex is *open* if one of its
//! triangles is not final, or if it is on the hull, beyond which nothing is known: it may get further neighbors. All
//! others have the neighbors that they have for good.

use spade::{DelaunayTriangulation, Point2, Triangulation};

use super::cocircular::{Face, corners, is_one_circle};
use crate::neighborhood::Loaded;

type Triangles = DelaunayTriangulation<Point2<f64>>;

/// What of a neighborhood is final.
pub struct Finality {
    pub(super) loaded: Loaded,
    /// Whether each triangle is final; empty if all are, or there are none.
    triangles: Vec<bool>,
}

impl Finality {
    /// What is final of a line of places.
    pub(super) fn of_line(loaded: Loaded) -> Self {
        Self { loaded, triangles: Vec::new() }
    }

    pub(super) fn of_triangles(triangulation: &Triangles, loaded: Loaded) -> Self {
        if loaded.is_everything() {
            return Self { loaded, triangles: Vec::new() };
        }
        let mut triangles = vec![true; triangulation.num_all_faces()];
        let mut open = Vec::new();
        for face in triangulation.inner_faces() {
            if !loaded.holds_circle(&face.positions().map(|place| [place.x, place.y])) {
                triangles[face.index()] = false;
                open.push(face.fix());
            }
        }
        let mut finality = Self { loaded, triangles };
        for face in open {
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
            if !self.of_face(face.index()) && others.iter().any(|other| self.of_face(other.index())) {
                self.triangles[face.index()] = true;
                waiting.extend(others);
            }
        }
    }

    /// What has been loaded.
    pub fn loaded(&self) -> Loaded {
        self.loaded
    }

    /// Whether the triangle is final.
    pub(super) fn of_face(&self, face: usize) -> bool {
        self.triangles.get(face).is_none_or(|is_final| *is_final)
    }

    /// Calls `visit` with the number of each open vertex.
    pub(super) fn for_each_open_vertex(&self, triangulation: &Triangles, mut visit: impl FnMut(usize)) {
        if self.loaded.is_everything() {
            return;
        }
        let mut is_open = vec![false; triangulation.num_vertices()];
        for edge in triangulation.convex_hull() {
            is_open[edge.from().index()] = true;
        }
        for face in triangulation.inner_faces().filter(|face| !self.of_face(face.index())) {
            for vertex in face.vertices() {
                is_open[vertex.index()] = true;
            }
        }
        (0..is_open.len()).filter(|&vertex| is_open[vertex]).for_each(&mut visit);
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
            neighbors.for_each_edge(|_, _, edge| verdicts.push(edge.is_final(&finality)));
            assert_eq!(verdicts.len(), 36 * 35 / 2 + 3 * 36 - 3 - 36);
            let mut corners = places.windows(3).map(|places| [places[0], places[1], places[2]]);
            let first = corners.next().is_some_and(|corners| loaded.holds_circle(&corners));
            let is_final = verdicts[0];
            assert!(verdicts.iter().all(|verdict| *verdict == is_final), "{high}");
            disagreements += usize::from(corners.any(|corners| loaded.holds_circle(&corners) != first));
        }
        assert!(disagreements > 0, "rounding never hid anything");
    }
}
