//! Groups of places on one empty circle, of whose Delaunay edges a triangulator chooses some as it likes.
//!
//! Of four and more places on one circle with nothing inside, every pair has an empty circle, that one. A triangulation
//! holds some of these pairs, and which ones depends on the order of insertion. On a lattice that is common. The
//! canonical Delaunay graph holds them all, and so depends on the places alone. Two neighboring triangles have the same
//! circle if the far corner of one lies exactly on the circle of the other, by Shewchuk's exact predicate (1997).

use robust::{Coord, incircle};
use spade::handles::{DirectedEdgeHandle, FixedFaceHandle, InnerTag};
use spade::{DelaunayTriangulation, Point2, Triangulation};

use crate::union_find::UnionFind;

type Face = FixedFaceHandle<InnerTag>;

/// Places on one empty circle.
pub(super) struct Group {
    /// Their numbers as vertices of the triangulation, ascending.
    pub(super) vertices: Vec<usize>,
    /// Three of the places.
    pub(super) corners: [[f64; 2]; 3],
}

/// All groups of four and more places on one empty circle.
pub(super) fn groups(triangulation: &DelaunayTriangulation<Point2<f64>>) -> Vec<Group> {
    let edges = triangulation.undirected_edges();
    let pairs: Vec<[Face; 2]> = edges.filter_map(|edge| same_circle(edge.as_directed())).collect();
    if pairs.is_empty() {
        return Vec::new();
    }
    let mut circles = UnionFind::new(triangulation.num_all_faces());
    for [a, b] in &pairs {
        circles.union(a.index() as u32, b.index() as u32);
    }
    let circles = circles.into_representatives();
    let mut faces: Vec<Face> = pairs.into_iter().flatten().collect();
    faces.sort_unstable_by_key(|face| (circles[face.index()], face.index()));
    faces.dedup();
    let on_same_circle = |a: &Face, b: &Face| circles[a.index()] == circles[b.index()];
    faces.chunk_by(on_same_circle).map(|faces| group(triangulation, faces)).collect()
}

fn group(triangulation: &DelaunayTriangulation<Point2<f64>>, faces: &[Face]) -> Group {
    let corners = |face: &Face| triangulation.face(*face).vertices();
    let mut vertices: Vec<usize> = faces.iter().flat_map(corners).map(|vertex| vertex.index()).collect();
    vertices.sort_unstable();
    vertices.dedup();
    Group { vertices, corners: corners(&faces[0]).map(|vertex| [vertex.position().x, vertex.position().y]) }
}

/// The triangles on either side of an edge, if they have the same circle.
fn same_circle(edge: DirectedEdgeHandle<'_, Point2<f64>, (), (), ()>) -> Option<[Face; 2]> {
    let (left, right) = (edge.face().as_inner()?, edge.rev().face().as_inner()?);
    let coord = |p: Point2<f64>| Coord { x: p.x, y: p.y };
    let [a, b, c] = left.vertices().map(|vertex| coord(vertex.position()));
    let opposite = coord(edge.rev().opposite_position()?);
    (incircle(a, b, c, opposite) == 0.0).then(|| [left.fix(), right.fix()])
}
