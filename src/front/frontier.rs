//! What a window leaves open at its borders.

use std::ops::Range;

use crate::neighborhood::Loaded;

/// A place on the map, where one or several points of a window are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// Where it is.
    pub at: [f64; 2],
    /// The first span that has a point there.
    pub span: u64,
}

/// Two labels of a window that are one if two places are neighbors in the whole cloud.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OpenEdge {
    /// The places. An empty circle through both is known, but none that lies inside what the window has loaded.
    pub ends: [Place; 2],
    /// The labels of two points there, within the distance of each other.
    pub labels: [i32; 2],
}

/// What a window could not decide because it does not hold all that it depends on.
#[derive(Debug, Clone, PartialEq)]
pub struct Frontier {
    /// The part of the map that the window has loaded.
    pub loaded: Loaded,
    /// The window's spans.
    pub spans: Range<u64>,
    /// The places that may get further neighbors.
    pub places: Vec<Place>,
    /// The edges that matter to the labels.
    pub edges: Vec<OpenEdge>,
}
