//! Slow and obvious twins of what the library computes, on whole numbers.

pub mod delaunay;
pub mod growing;
pub mod partition;
pub mod radius;
pub mod weaver;
