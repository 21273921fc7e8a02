//! Slow and obvious twins of what the library computes, on whole numbers.
// Each test binary uses what it needs of it.
#![allow(dead_code)]

pub mod circles;
pub mod delaunay;
pub mod growing;
pub mod partition;
pub mod radius;
pub mod weaver;
