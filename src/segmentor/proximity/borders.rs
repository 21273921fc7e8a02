//! What a window leaves open at the borders of what it has loaded.

use crate::front::{Frontier, OpenEdge, Place};
use crate::label::Labels;
use crate::neighborhood::{Delaunay, Finality, Loaded};
use crate::span::Extent;
use crate::window::Window;

/// What the window has loaded, if its spans are ones of space.
pub(super) fn loaded(window: &Window) -> Option<Loaded> {
    let lattice = window.lattice();
    let [x, y, _] = lattice.offset().map(|offset| offset.abs() / lattice.horizontal_unit());
    let Extent { direction, low, high, .. } = window.extent()?;
    Some(Loaded { direction, low, high, largest: x + y })
}

/// The frontier of a window in which the pairs `open`, numbered in the order of the neighborhood, are undecided.
pub(super) fn frontier(
    window: &Window,
    neighbors: &Delaunay,
    finality: &Finality,
    mut open: Vec<[u32; 2]>,
    labels: &Labels,
) -> Frontier {
    let number = |at: u32| neighbors.order()[at as usize];
    let place = |at: u32| {
        let point = number(at);
        Place { at: window.lattice().horizontal(&window.points()[point as usize]), span: window.span_of(point) }
    };
    let label = |at: u32| labels.of_points()[number(at) as usize];
    open.sort_unstable();
    open.dedup();
    let edges = open.into_iter().map(|pair| OpenEdge { ends: pair.map(place), labels: pair.map(label) });
    let mut places = Vec::new();
    neighbors.for_each_open_stack(finality, |stack, _| places.push(place(stack.start as u32)));
    let (first, count) = (window.own_spans().first().map_or(0, |span| span.index), window.own_spans().len() as u64);
    Frontier {
        loaded: finality.loaded(),
        spans: first..first + count,
        places,
        // What has become one in another way needs no decision.
        edges: edges.filter(|edge| edge.labels[0] != edge.labels[1]).collect(),
    }
}
