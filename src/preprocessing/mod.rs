//! What is done to the points of a window before anything else: outliers removed, the cloud thinned.
//!
//! A [`Stage`] takes the points of a window and hands on fewer. Nothing is lost: every point knows which one stands for
//! it, and gets that one's label; a removed point gets none.

mod farthest;
mod measure;
mod moments;
mod neighbor_distance;
mod radius_outliers;
mod statistical_outliers;
mod voxel_grid;

use std::sync::Arc;

use crate::error::Result;
use crate::window::Window;
pub use farthest::Reach;
pub use measure::measure;
pub use moments::{Moments, Statistics};
pub use radius_outliers::RadiusOutlierRemoval;
pub use statistical_outliers::{
    Dialect, GlobalOutlierRemoval, MOST_NEIGHBORS, RunningOutlierRemoval, StatisticalOutlierRemoval,
};
pub use voxel_grid::{Representative, VoxelGrid};

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
    /// For each point that came in the number of the one that stands for it; none if it was removed, or is undecided.
    pub successors: Vec<Option<u32>>,
    /// The points that came in and about which this window does not hold all that decides, ascending.
    pub undecided: Vec<u32>,
}

/// Applies `stages` one after the other.
///
/// # Errors
/// If a stage cannot work on the window.
pub fn apply_all(stages: &[Arc<dyn Stage>], window: &Window) -> Result<Preprocessed> {
    let Some((first, others)) = stages.split_first() else {
        let successors = (0..window.points().len() as u32).map(Some).collect();
        return Ok(Preprocessed { window: window.clone(), successors, undecided: vec![] });
    };
    let Preprocessed { mut window, mut successors, mut undecided } = first.apply(window)?;
    for stage in others {
        let next = stage.apply(&window)?;
        if !next.undecided.is_empty() {
            let is_open = |of: &Option<u32>| of.is_some_and(|of| next.undecided.binary_search(&of).is_ok());
            undecided.extend((0..).zip(&successors).filter(|(_, of)| is_open(of)).map(|(point, _)| point));
        }
        for successor in &mut successors {
            *successor = successor.and_then(|of| next.successors[of as usize]);
        }
        window = next.window;
    }
    undecided.sort_unstable();
    Ok(Preprocessed { window, successors, undecided })
}

/// How far around a point `stages` together depend on what is there.
pub fn total_halo(stages: &[Arc<dyn Stage>]) -> f64 {
    stages.iter().map(|stage| stage.halo()).sum()
}

/// The points of `window` that were decided to stay.
fn keep_where(window: &Window, stays: impl Iterator<Item = Option<bool>>, halo: f64) -> Preprocessed {
    let mut successors = vec![None; window.points().len()];
    let (mut kept, mut undecided) = (Vec::new(), Vec::new());
    for (point, stays) in (0..).zip(stays) {
        match stays {
            Some(true) => {
                successors[point as usize] = Some(kept.len() as u32);
                kept.push(point);
            }
            Some(false) => (),
            None => undecided.push(point),
        }
    }
    let mut window = window.restricted(&kept);
    window.shrink(halo);
    Preprocessed { window, successors, undecided }
}

#[cfg(test)]
mod tests;
