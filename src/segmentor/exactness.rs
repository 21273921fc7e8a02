//! When the streamed partition equals the static one: what a segmentor promises, and whether the spans keep to it.

use crate::lattice::Lattice;
use crate::span::{Direction, SlabIndex, SpanBy};
use crate::window::WindowSize;

/// What a segmentor promises of its streamed result.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Exactness {
    /// Class A: equal if every pair of points within this reach shares a window.
    ByLocality {
        /// In units of the coordinates.
        reach: f64,
    },
    /// Class B: equal as far as every decision could be proven in a window; pairs within this reach have to share one.
    WithHalo {
        /// In units of the coordinates.
        reach: f64,
    },
    /// Class C: no promise; the agreement with the static result has to be measured.
    Measured,
}

/// What a run's result can be relied on for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Assessment {
    /// The class: 'A', 'B' or 'C'.
    pub class: char,
    /// Whether streamed and static are sure to be the same partition.
    pub is_identical: bool,
    /// One sentence for people.
    pub sentence: String,
    /// One sentence, if the spans break the segmentor's condition.
    pub warning: Option<String>,
}

/// Spans are this many times as wide as the reach if nothing else is asked for: on clouds with some ten points per
/// reach that is a window of a few hundred thousand points, with a third of it overlap at no risk.
const REACHES_PER_SPAN: f64 = 20.0;

/// Points per span, if nothing else is asked for and the segmentor has no reach.
const POINTS_PER_SPAN: usize = 100_000;

impl Exactness {
    /// The spans for a stored cloud if nothing else is asked for.
    pub fn default_spans(self) -> SpanBy {
        match self {
            Exactness::ByLocality { reach } | Exactness::WithHalo { reach } => {
                SpanBy::Width { width: REACHES_PER_SPAN * reach, direction: Direction::X }
            }
            Exactness::Measured => SpanBy::Count { points: POINTS_PER_SPAN },
        }
    }

    /// Assesses a run with these spans and windows.
    pub fn assess(self, by: SpanBy, size: WindowSize, lattice: &Lattice) -> Assessment {
        let (mut class, reach) = match self {
            Exactness::ByLocality { reach } => ('A', Some(reach)),
            Exactness::WithHalo { reach } => ('B', Some(reach)),
            Exactness::Measured => ('C', None),
        };
        let shares = reach.map_or(Shares::Unknown, |reach| shares(reach, by, size, lattice));
        if class == 'B' && shares == Shares::Unknown {
            // Spans cut in stream order do not say which part of the map they hold, so no edge can be proven.
            class = 'C';
        }
        let is_identical = class == 'A' && shares == Shares::Always;
        let sentence = match (class, &shares) {
            ('A', Shares::Always) => "equal to the static result: every pair in reach shares a window",
            ('A', _) => {
                "equal to the static result only where every pair in reach shares a window, which these spans do not promise"
            }
            ('C', Shares::Unknown) if reach.is_some() => {
                "no promise: spans cut in stream order prove no edge at the borders of windows; use spans by width, or compare with segment_static"
            }
            ('B', _) => "near to the static result: at the borders of windows only proven edges join",
            _ => "no promise of equality with the static result: compare with segment_static",
        };
        let warning = match (&shares, size.overlap()) {
            (_, 0) => Some(
                "windows share no span, so segments are cut where a window ends; use an overlap of at least 1".into(),
            ),
            (Shares::NotAlways { overlap, reach }, _) if overlap >= reach => Some(format!(
                "windows overlap by no more than the distance {reach}, and the rounding of coordinates may part a pair at exactly the distance: the result may differ from the static one; use slightly wider spans"
            )),
            (Shares::NotAlways { overlap, reach }, _) => Some(format!(
                "windows overlap by {overlap}, less than the distance {reach}: the result may differ from the static one; use wider spans or more overlap"
            )),
            _ => None,
        };
        Assessment { class, is_identical, sentence: sentence.into(), warning }
    }
}

#[derive(Debug, PartialEq)]
enum Shares {
    Always,
    NotAlways { overlap: f64, reach: f64 },
    Unknown,
}

/// Whether every pair of points within `reach` shares a window.
fn shares(reach: f64, by: SpanBy, size: WindowSize, lattice: &Lattice) -> Shares {
    let SpanBy::Width { width, direction } = by else { return Shares::Unknown };
    let overlap = width * size.overlap() as f64;
    // Where rounding may put a point into the next slab, the overlap has to be a little wider than the reach.
    let needed = if SlabIndex::new(width, direction, lattice).is_exact() { reach } else { reach * (1.0 + 1e-6) };
    // 0.1 · 3 has to count as 0.3.
    if overlap * (1.0 + 1e-12) >= needed { Shares::Always } else { Shares::NotAlways { overlap, reach } }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn assess(exactness: Exactness, width: f64, overlap: usize) -> Assessment {
        let lattice = Lattice::new([0.01; 3], [0.0; 3]).unwrap();
        let by = SpanBy::Width { width, direction: Direction::X };
        exactness.assess(by, WindowSize::new(4, overlap).unwrap(), &lattice)
    }

    #[test]
    fn the_overlap_has_to_hold_the_reach() {
        let near = Exactness::ByLocality { reach: 0.3 };
        assert!(assess(near, 0.3, 1).is_identical);
        assert!(assess(near, 0.1, 3).is_identical);
        let narrow = assess(near, 0.2, 1);
        assert!(!narrow.is_identical);
        assert!(narrow.warning.unwrap().starts_with("windows overlap by 0.2, less than the distance 0.3"));
        let real = SpanBy::Width { width: 0.3, direction: Direction::X };
        let equal = near.assess(real, WindowSize::default(), &Lattice::REAL);
        assert!(!equal.is_identical && equal.warning.unwrap().contains("slightly wider spans"));
        assert!(assess(near, 9.0, 0).warning.unwrap().contains("share no span"));
    }

    #[test]
    fn only_class_a_promises_identity() {
        let halo = assess(Exactness::WithHalo { reach: 0.3 }, 9.0, 1);
        assert_eq!((halo.class, halo.is_identical, halo.warning), ('B', false, None));
        assert_eq!(assess(Exactness::Measured, 0.1, 1).class, 'C');
        let by_count = Exactness::ByLocality { reach: 0.3 }.assess(
            SpanBy::Count { points: 9 },
            WindowSize::default(),
            &Lattice::REAL,
        );
        assert!(!by_count.is_identical && by_count.warning.is_none());
    }
}
