//! Who is near whom inside one window.
//!
//! A neighborhood knows positions and nothing of segments; what to make of a pair is the segmentor's business.

mod certificate;
mod curve;
mod delaunay;

pub use certificate::Loaded;
pub use delaunay::{Delaunay, Edge};
