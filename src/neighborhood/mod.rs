//! Who is near whom inside one window.
//!
//! A neighborhood knows positions and nothing of segments; what to make of a pair is the segmentor's business. There are
//! two: the [`Delaunay`] triangulation of the map, and the [`Grid`], which answers every [`Search`] by radius or number.

mod cells;
mod components;
mod curve;
mod delaunay;
mod finder;
mod grid;
mod loaded;
mod nearest;
mod neighborhoods;
mod search;
mod vicinity;

pub use delaunay::{Delaunay, Edge, Finality, Opening};
pub use finder::Finder;
pub use grid::{Grid, Neighbor};
pub use loaded::Loaded;
pub use neighborhoods::{Neighborhoods, support};
pub use search::Search;
