//! The 2-D Delaunay neighborhood of a window (Delaunay 1934), triangulated by spade.
//!
//! 1. Put the points in the order of a space-filling curve; points with equal xy (walls, several returns of a pulse,
//!    quantised data) become one *stack*, which every triangulator would silently thin out to one point.
//! 2. Triangulate one vertex per stack, inserting in curve order: on real clouds that is 1.2 to 1.5 times as fast as
//!    spade's bulk load.
//! 3. Hand out the triangulation's edges as pairs of stacks, and all pairs of places on one empty circle ([`cocircular`]):
//!    together the canonical Delaunay graph, in which two places are neighbors if some circle through both is empty.
//!
//! Stacks that all lie on one line have no triangulation, and spade takes quadratic time on them. Their Delaunay edges
//! are the pairs of consecutive stacks along the line. For the same reason the first three vertices of a triangulation
//! are chosen not to lie on one line.

mod cocircular;
mod finality;
mod opening;

use std::cmp::Ordering;
use std::ops::Range;

use robust::{Coord, incircle, orient2d};
use spade::handles::DirectedEdgeHandle;
use spade::{DelaunayTriangulation, Point2, Triangulation};

use super::curve::curve_order;
use super::loaded::Loaded;
use cocircular::{Face, groups};
pub use finality::Finality;
pub use opening::Opening;

/// Which points of a window share a place on the map, and which places are Delaunay neighbors.
pub struct Delaunay {
    order: Vec<u32>,
    /// Where each stack starts in `order`, and the end of the last.
    starts: Vec<u32>,
    edges: Edges,
}

enum Edges {
    /// Stacks along a line with their places, consecutive ones being neighbors.
    Line(Vec<(u32, [f64; 2])>),
    /// A triangulation, and the stack of each of its vertices.
    Triangles { triangulation: Box<DelaunayTriangulation<Point2<f64>>>, first: [u32; 3] },
}

impl Delaunay {
    /// The neighborhood of points whose horizontal positions are `horizontal` and whose heights order the stacks.
    /// Positions have to be finite, below 10⁶⁰, and zero where they are nearer to it than 2⁻¹⁴². Those that are given away
    /// are gone when the triangulation comes.
    pub fn new(horizontal: impl AsRef<[[f64; 2]]>, height: impl Fn(u32) -> f64) -> Self {
        let order = curve_order(horizontal.as_ref(), height);
        let position = |at: u32| horizontal.as_ref()[order[at as usize] as usize];
        let mut starts: Vec<u32> = Vec::with_capacity(order.len() + 1);
        for at in 0..order.len() as u32 {
            if at == 0 || position(at) != position(at - 1) {
                starts.push(at);
            }
        }
        let stacks: Vec<[f64; 2]> = starts.iter().map(|&at| position(at)).collect();
        starts.push(order.len() as u32);
        drop(horizontal);
        let edges = match corner(&stacks) {
            None => Edges::Line(along_line(&stacks)),
            Some(corner) => triangulate(&stacks, corner),
        };
        Self { order, starts, edges }
    }

    /// The numbers of all points, stack by stack.
    pub fn order(&self) -> &[u32] {
        &self.order
    }

    /// The stacks, as ranges of [`Self::order`], inside which points are in ascending order of height.
    pub fn stacks(&self) -> impl Iterator<Item = Range<usize>> {
        (0..self.starts.len() as u32 - 1).map(|stack| self.stack(stack))
    }

    fn stack(&self, stack: u32) -> Range<usize> {
        self.starts[stack as usize] as usize..self.starts[stack as usize + 1] as usize
    }

    /// Calls `visit` once for every pair of neighboring stacks in the triangulation.
    pub fn for_each_edge(&self, mut visit: impl FnMut(Range<usize>, Range<usize>, Edge<'_>)) {
        match &self.edges {
            Edges::Line(line) => {
                for pair in line.windows(2) {
                    let [(a, from), (b, to)] = [pair[0], pair[1]];
                    visit(self.stack(a), self.stack(b), Edge::OfLine(from, to));
                }
            }
            Edges::Triangles { triangulation, first } => {
                for edge in triangulation.undirected_edges() {
                    let [a, b] = edge.vertices().map(|vertex| self.stack(stack_of(vertex.index(), *first)));
                    visit(a, b, Edge::OfTriangles(edge.as_directed()));
                }
            }
        }
    }

    /// Calls `visit` for every pair of stacks on one empty circle with others, whose edges a triangulation may or may not
    /// have. Of groups in which `is_settled` holds for the stacks of any two neighboring triangles nothing is told.
    pub fn for_each_cocircular_pair(
        &self,
        mut is_settled: impl FnMut([Range<usize>; 4]) -> bool,
        mut visit: impl FnMut(Range<usize>, Range<usize>, Edge<'_>),
    ) {
        let Edges::Triangles { triangulation, first } = &self.edges else { return };
        let stack = |vertex: usize| self.stack(stack_of(vertex, *first));
        for group in groups(triangulation, |vertices| is_settled(vertices.map(stack))) {
            for (i, &a) in group.vertices.iter().enumerate() {
                for &b in &group.vertices[..i] {
                    visit(stack(a), stack(b), Edge::OfCircle(group.face));
                }
            }
        }
    }

    /// What of the neighborhood stays as it is, as far as everything in `loaded` has been loaded.
    pub fn finality(&self, loaded: Loaded) -> Finality {
        match &self.edges {
            Edges::Line(_) => Finality::of_line(loaded),
            Edges::Triangles { triangulation, .. } => Finality::of_triangles(triangulation, loaded),
        }
    }

    /// Calls `visit` for every stack that may get further neighbors from outside of what was loaded, telling from where.
    pub fn for_each_open_stack(&self, finality: &Finality, mut visit: impl FnMut(Range<usize>, Opening)) {
        match &self.edges {
            Edges::Line(line) => {
                for (stack, opening) in finality.open_along(line) {
                    visit(self.stack(stack), opening);
                }
            }
            Edges::Triangles { triangulation, first } => {
                for (vertex, opening) in finality.open_vertices(triangulation) {
                    visit(self.stack(stack_of(vertex, *first)), opening);
                }
            }
        }
    }

    /// The edge between two places; none if they are no neighbors, or there is nothing at one of them.
    pub fn edge_between(&self, p: [f64; 2], q: [f64; 2]) -> Option<Edge<'_>> {
        match &self.edges {
            Edges::Line(line) => {
                let at = |place: [f64; 2]| line.binary_search_by(|(_, other)| along_axes(other, &place)).ok();
                (at(p)?.abs_diff(at(q)?) == 1).then_some(Edge::OfLine(p, q))
            }
            Edges::Triangles { triangulation, .. } => {
                let [from, to] = [p, q].map(|[x, y]| triangulation.locate_vertex(Point2::new(x, y)));
                let (from, to) = (from?, to?);
                let edge = from.out_edges().find(|edge| edge.to() == to).map(Edge::OfTriangles);
                edge.or_else(|| {
                    let coord = |point: Point2<f64>| Coord { x: point.x, y: point.y };
                    let mut faces = from.out_edges().filter_map(|edge| edge.face().as_inner());
                    let circle = faces.find(|face| {
                        let [a, b, c] = face.positions().map(coord);
                        incircle(a, b, c, coord(to.position())) == 0.0
                    });
                    circle.map(|face| Edge::OfCircle(face.fix()))
                })
            }
        }
    }
}

/// What is known of an edge besides the stacks at its ends.
pub enum Edge<'a> {
    /// An edge between consecutive places of a line.
    OfLine([f64; 2], [f64; 2]),
    /// An edge between two of at least four places on the circumcircle of this triangle.
    OfCircle(Face),
    /// An edge between two triangles, or on the hull.
    OfTriangles(DirectedEdgeHandle<'a, Point2<f64>, (), (), ()>),
}

impl Edge<'_> {
    /// Whether the edge stays an edge whatever points come from outside of what was loaded.
    pub fn is_final(&self, finality: &Finality) -> bool {
        match self {
            Edge::OfLine(from, to) => finality.loaded.proves(*from, *to, None, None),
            Edge::OfCircle(face) => finality.of_face(*face),
            Edge::OfTriangles(edge) => {
                let of_side = |edge: &DirectedEdgeHandle<'_, Point2<f64>, (), (), ()>| {
                    edge.face().as_inner().is_some_and(|face| finality.of_face(face.fix()))
                };
                of_side(edge) || of_side(&edge.rev()) || {
                    let place = |point: Point2<f64>| [point.x, point.y];
                    let [from, to] = edge.positions().map(place);
                    let (left, right) = (edge.opposite_position(), edge.rev().opposite_position());
                    finality.loaded.proves(from, to, left.map(place), right.map(place))
                }
            }
        }
    }
}

/// The stack of a vertex. Vertices are numbered as they were inserted: three first ones, then all others in order.
fn stack_of(vertex: usize, first: [u32; 3]) -> u32 {
    match vertex as u32 {
        vertex if vertex < 3 => first[vertex as usize],
        vertex if vertex <= first[2] => vertex - 1,
        vertex => vertex,
    }
}

/// The first stack that does not lie on the line through the first two.
fn corner(stacks: &[[f64; 2]]) -> Option<u32> {
    let coord = |p: [f64; 2]| Coord { x: p[0], y: p[1] };
    let [first, second, ..] = stacks else { return None };
    let (a, b) = (coord(*first), coord(*second));
    stacks.iter().position(|&p| orient2d(a, b, coord(p)) != 0.0).map(|at| at as u32)
}

/// Stacks on one line, sorted along it.
fn along_line(stacks: &[[f64; 2]]) -> Vec<(u32, [f64; 2])> {
    let mut line: Vec<(u32, [f64; 2])> = (0..).zip(stacks.iter().copied()).collect();
    line.sort_unstable_by(|(_, p), (_, q)| along_axes(p, q));
    line
}

fn along_axes(p: &[f64; 2], q: &[f64; 2]) -> Ordering {
    p[0].total_cmp(&q[0]).then_with(|| p[1].total_cmp(&q[1]))
}

fn triangulate(stacks: &[[f64; 2]], corner: u32) -> Edges {
    let first = [0, 1, corner];
    // Euler: a triangulation of n vertices has fewer than 3 n edges and 2 n faces.
    let mut triangulation = DelaunayTriangulation::with_capacity(stacks.len(), 3 * stacks.len(), 2 * stacks.len());
    let others = (2..stacks.len() as u32).filter(|&stack| stack != corner);
    for stack in first.into_iter().chain(others) {
        let [x, y] = stacks[stack as usize];
        triangulation.insert(Point2::new(x, y)).expect("window points are finite and within spade's range");
    }
    Edges::Triangles { triangulation: Box::new(triangulation), first }
}
