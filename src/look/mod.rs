//! What a window says of its own points, and of those beyond that belong to the same segments.
//!
//! A segmentor labels all points that a window has loaded, and what it says of the halo is no less sure: it joins points
//! only if nothing that has not been loaded could keep them apart. So where neighbors can be farther apart than windows
//! overlap, a label that holds both a window's own point and a point beyond is a join of two segments, though the two may
//! never be own points of the same window ([`Sight`]).
//!
//! Where that was not enough to decide all of the window's own points, it is looked [again].

mod again;
mod nearest;
mod said;

pub use again::LookAgain;
pub use said::Said;

use crate::error::Result;
use crate::label::{Cause, Labels, NONE};
use crate::segmentor::{Exactness, Segmented, Segmentor, segment};
use crate::window::Window;

/// What one look at a window has shown.
#[derive(Debug)]
pub struct Look {
    /// What is said of the window's own points.
    pub segmented: Segmented,
    /// The points beyond that share a label with own points.
    pub sights: Vec<Sight>,
    /// What is said of the points that were brought back.
    pub of_context: Vec<i32>,
}

/// A point that is not among a window's own, but has a label that own points have.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sight {
    /// The label.
    pub label: i32,
    /// The point's span.
    pub span: u64,
    /// Its position there.
    pub position: u32,
}

/// Looks at a window, of whose points so many, the first, were `brought_back`.
///
/// # Errors
/// If the segmentor fails, or does not return one label for each point.
pub fn look(segmentor: &dyn Segmentor, window: &Window, brought_back: usize) -> Result<Look> {
    let mut segmented = segment(segmentor, window)?;
    if let Some(valid) = window.valid() {
        segmented = segmented.spread(valid, window.len(), Cause::Invalid);
    }
    let (own, mut sights, mut of_context) = (window.own(), Vec::new(), Vec::new());
    if own.len() < window.len() {
        if sees_beyond(segmentor.exactness()) {
            sights = self::sights(&segmented.labels, window, brought_back);
        }
        (segmented, of_context) = segmented.keep(own.clone(), 0..brought_back);
    }
    if let Some(undecided) = &segmented.undecided {
        segmented.tally.waiting_points = undecided.len() as u64;
        segmented.tally.decided_points = (own.len() - undecided.len()) as u64;
    }
    Ok(Look { segmented, sights, of_context })
}

/// Whether what decides about a point has no limit, so that neighbors may share no window.
pub(crate) fn sees_beyond(exactness: Exactness) -> bool {
    matches!(exactness, Exactness::WithHalo { halo: f64::INFINITY, .. })
}

/// The points of the halo that share a label with own points; their labels are numbered as those of the own points will be.
fn sights(labels: &Labels, window: &Window, brought_back: usize) -> Vec<Sight> {
    let mut number = vec![NONE as i32; labels.count()];
    let (labels, mut next) = (labels.of_points(), 0);
    for &label in labels[window.own()].iter().filter(|label| **label >= 0) {
        if number[label as usize] < 0 {
            number[label as usize] = next;
            next += 1;
        }
    }
    let mut sights = Vec::new();
    let mut first = 0;
    for span in window.spans() {
        if first >= brought_back && !window.own().contains(&first) {
            let labels = &labels[first..first + span.len()];
            let seen = (0..).zip(labels).filter(|(_, label)| **label >= 0 && number[**label as usize] >= 0);
            let sight =
                |(position, &label): (u32, &i32)| Sight { label: number[label as usize], span: span.index, position };
            sights.extend(seen.map(sight));
        }
        first += span.len();
    }
    sights
}
