//! What is done to the points of a window before anything else: outliers removed, the cloud thinned.
//!
//! A [`Stage`] takes the points of a window and hands on fewer. Nothing is lost: every point knows which one stands for
//! it, and gets that one's label; a removed point gets none.

use crate::error::Result;
use crate::window::Window;

/// One step of preprocessing.
pub trait Stage: Send + Sync {
    /// Short name, as in messages and manifests.
    fn name(&self) -> &str;

    /// How far around a point, on the map and in units of the coordinates, anything decides what becomes of it; ∞ if
    /// there is no limit.
    fn halo(&self) -> f64;

    /// How far from a point the one that stands for it can be.
    fn displacement(&self) -> f64 {
        0.0
    }

    /// Whether several windows may be worked on at the same time.
    fn is_concurrent(&self) -> bool {
        true
    }

    /// Hands on the points of `window` that are final and stay.
    ///
    /// # Errors
    /// If the window cannot be worked on.
    fn apply(&self, window: &Window) -> Result<Preprocessed>;
}

/// What a stage hands on.
pub struct Preprocessed {
    /// The points that stay, or stand for others; its extent is where they are final.
    pub window: Window,
    /// For each point that came in the number of the one that stands for it; none if it was removed, or if this window
    /// does not hold all that decides about it.
    pub successors: Vec<Option<u32>>,
}
