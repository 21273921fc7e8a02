//! Region growing by PCL's loop, step by step: first come, first served.
//!
//! 1. Seeds in ascending order of curvature. PCL leaves ties to its sort; here the smaller point id comes first.
//! 2. The first point without a segment begins one. In the order in which a region's points came, each looks at its
//!    neighbors: those without a segment whose normal is like the reference's join; of these, the smooth ones on the tangent
//!    plane will be looked from in turn.
//!
//! Departure: a normal without a value is like none, and a curvature without a value comes last and is never smooth; PCL's
//! comparisons let both pass.

use std::cmp::Ordering;
use std::collections::VecDeque;

use super::surface::Surface;
use super::{Neighbors, Segmented};
use crate::label::{Labels, NONE};
use crate::window::Window;

pub(super) fn segment(window: &Window, surface: &Surface, mut neighbors: Neighbors, smooth: bool) -> Segmented {
    let mut labels = vec![NONE; window.points().len()];
    let mut queue = VecDeque::new();
    for (label, first) in (0..).zip(seeds(window, surface)) {
        if labels[first as usize] != NONE {
            continue;
        }
        labels[first as usize] = label;
        queue.push_back(first);
        while let Some(point) = queue.pop_front() {
            let reference = if smooth { point } else { first };
            for &neighbor in neighbors.of(point).0 {
                if labels[neighbor as usize] == NONE && surface.is_alike(neighbor, reference) {
                    labels[neighbor as usize] = label;
                    if surface.is_smooth(neighbor) && surface.is_on_plane(neighbor, point) {
                        queue.push_back(neighbor);
                    }
                }
            }
        }
    }
    Labels::from_any(&labels).into()
}

/// The points that may begin a segment, the flattest first.
fn seeds(window: &Window, surface: &Surface) -> Vec<u32> {
    let mut seeds: Vec<u32> = (0..window.points().len() as u32).filter(|&point| window.is_seed(point)).collect();
    seeds.sort_unstable_by(|&p, &q| {
        let (of_p, of_q) = (surface.curvature(p), surface.curvature(q));
        let by_curvature = of_p.partial_cmp(&of_q).unwrap_or_else(|| missing_last(of_p, of_q));
        by_curvature.then_with(|| window.point_ids()[p as usize].cmp(&window.point_ids()[q as usize]))
    });
    seeds
}

fn missing_last(a: f64, b: f64) -> Ordering {
    a.is_nan().cmp(&b.is_nan())
}
