//! Groups of places on one empty circle, of whose Delaunay edges a triangulator chooses some as it likes.
//!
//! Of four and more places on one circle with nothing inside, every pair has an empty circle, that one. A triangulation
//! holds some of these pairs, and which ones depends on the order of insertion. On a lattice that is common. The
//! canonical Delaunay graph holds them all, and so depends on the places alone. Two neighboring triangles have the same
//! circle if the far corner of one lies exactly on the circle of the other, by Shewchuk's exact predicate (1997).

use robust::{Coord, incircle};
use rustc_hash::FxHashSet;
use spade::handles::{DirectedEdgeHandle, FixedFaceHandle, InnerTag, VertexHandle};
use spade::{DelaunayTriangulation, Point2, Triangulation};

type Triangles = DelaunayTriangulation<Point2<f64>>;
pub(super) type Face = FixedFaceHandle<InnerTag>;
type Edge<'a> = DirectedEdgeHandle<'a, Point2<f64>, (), (), ()>;
type Vertex<'a> = VertexHandle<'a, Point2<f64>>;

/// Places on one empty circle.
pub(super) struct Group {
    /// Their numbers as vertices of the triangulation, ascending.
    pub(super) vertices: Vec<usize>,
    /// One of their triangles.
    pub(super) face: Face,
}

/// The groups of four and more places on one empty circle, but for those in which `is_settled` holds for the four vertices
/// of any two neighboring triangles.
pub(super) fn groups(triangulation: &Triangles, mut is_settled: impl FnMut([usize; 4]) -> bool) -> Vec<Group> {
    let mut known = FxHashSet::default();
    let mut groups = Vec::new();
    for edge in triangulation.undirected_edges() {
        let edge = edge.as_directed();
        let Some(corners) = corners(edge) else { continue };
        if is_settled(corners.map(|corner| corner.index())) || !is_one_circle(corners) {
            continue;
        }
        let faces = faces_of_circle(edge, &mut known);
        groups.extend(faces.first().map(|_| group(triangulation, &faces)));
    }
    groups
}

/// The triangles with the circle of the triangle to the left of an edge, none if they are known.
fn faces_of_circle(edge: Edge<'_>, known: &mut FxHashSet<usize>) -> Vec<Face> {
    let (mut faces, mut waiting) = (Vec::new(), vec![edge]);
    while let Some(edge) = waiting.pop() {
        let Some(face) = edge.face().as_inner().filter(|face| known.insert(face.index())) else { continue };
        faces.push(face.fix());
        let on_same_circle = |edge: &Edge<'_>| corners(*edge).is_some_and(is_one_circle);
        waiting.extend(face.adjacent_edges().into_iter().filter(on_same_circle).map(|edge| edge.rev()));
    }
    faces
}

fn group(triangulation: &Triangles, faces: &[Face]) -> Group {
    let corners = |face: &Face| triangulation.face(*face).vertices();
    let mut vertices: Vec<usize> = faces.iter().flat_map(corners).map(|vertex| vertex.index()).collect();
    vertices.sort_unstable();
    vertices.dedup();
    Group { vertices, face: faces[0] }
}

/// The ends of an edge and the far corners of the triangles to its left and right; none on the hull.
pub(super) fn corners(edge: Edge<'_>) -> Option<[Vertex<'_>; 4]> {
    let [from, to] = edge.vertices();
    Some([from, to, edge.opposite_vertex()?, edge.rev().opposite_vertex()?])
}

pub(super) fn is_one_circle(corners: [Vertex<'_>; 4]) -> bool {
    let [a, b, c, d] = corners.map(|corner| Coord { x: corner.position().x, y: corner.position().y });
    incircle(a, b, c, d) == 0.0
}
