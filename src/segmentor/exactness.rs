//! When the streamed partition equals the static one: what a segmentor promises, and whether the spans keep to it.

use crate::lattice::Lattice;
use crate::span::{Direction, SlabIndex, SpanBy};
use crate::window::{Halo, WindowSize};

/// What a segmentor promises of its streamed result. Lengths are in units of the coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Exactness {
    /// Class A: equal if every pair of points within this reach shares a window.
    ByLocality {
        /// Greatest distance of two points that are looked at together.
        reach: f64,
    },
    /// Class B: equal if in addition everything within the halo of a window's own points is loaded with them.
    WithHalo {
        /// Greatest distance of two points that are looked at together.
        reach: f64,
        /// Greatest distance from which anything decides about a point; ∞ if there is no limit to it.
        halo: f64,
    },
    /// Class B: equal because every decision waits until it is proven; pairs within this reach have to share a window.
    Proven {
        /// Greatest distance of two points that are looked at together.
        reach: f64,
    },
    /// Class C: no promise; the agreement with the static result has to be measured.
    Measured {
        /// How far apart points that influence each other are at the most; 0 if that is unknown.
        reach: f64,
        /// How far around a window more is loaded, so that the borders do less harm; ∞ = one span.
        halo: f64,
    },
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

/// How large a cloud is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Layout {
    /// How many points it has.
    pub points: u64,
    /// How far it reaches along x, in units of the coordinates.
    pub extent: f64,
}

/// Spans are this many times as wide as the reach if nothing else is asked for: on clouds with some ten points per
/// reach that is a window of a few hundred thousand points, with a third of it overlap at no risk.
const REACHES_PER_SPAN: f64 = 20.0;

/// Points per span, if nothing else is asked for and the segmentor has no reach.
const POINTS_PER_SPAN: usize = 100_000;

impl Exactness {
    /// The spans for a stored cloud if nothing else is asked for.
    pub fn default_spans(self, layout: Option<Layout>) -> SpanBy {
        let by_width = |width| SpanBy::Width { width, direction: Direction::X };
        // Spans narrower than the halo, by whatever rounding, would be loaded over and over.
        let halo = if let Halo::Length(halo) = self.halo() { 1.01 * halo } else { 0.0 };
        match (self.reach(), layout) {
            (reach, _) if reach > 0.0 && (REACHES_PER_SPAN * reach).is_finite() => {
                by_width(halo.max(REACHES_PER_SPAN * reach))
            }
            (_, Some(Layout { points, extent })) if extent > 0.0 && points > POINTS_PER_SPAN as u64 => {
                by_width(extent * POINTS_PER_SPAN as f64 / points as f64)
            }
            (_, Some(Layout { extent, .. })) if extent > 0.0 => by_width(extent),
            _ => SpanBy::Count { points: POINTS_PER_SPAN },
        }
    }

    /// Whether there is a limit to how far away what decides about a point can be.
    pub fn is_bounded(self) -> bool {
        !matches!(self.halo(), Halo::SpanBeyond(_))
    }

    /// How far apart points that are looked at together are at the most; 0 if nothing is known of it, ∞ if there is no limit.
    pub fn reach(self) -> f64 {
        match self {
            Exactness::ByLocality { reach }
            | Exactness::WithHalo { reach, .. }
            | Exactness::Proven { reach }
            | Exactness::Measured { reach, .. } => reach,
        }
    }

    /// Whether more points can only join more: what a window joins is one in the whole cloud too.
    pub fn is_monotone(self) -> bool {
        matches!(self, Exactness::ByLocality { .. })
    }

    /// What has to be loaded around a window.
    pub fn halo(self) -> Halo {
        match self {
            Exactness::WithHalo { halo, .. } | Exactness::Measured { halo, .. } if halo == f64::INFINITY => {
                Halo::SpanBeyond(0.0)
            }
            Exactness::WithHalo { halo, .. } | Exactness::Measured { halo, .. } if halo > 0.0 => Halo::Length(halo),
            _ => Halo::None,
        }
    }

    /// The promise if what decides about a point comes from `more` farther away.
    #[must_use]
    pub fn with_halo(self, more: f64) -> Self {
        match self {
            _ if more == 0.0 => self,
            Exactness::ByLocality { reach } => Exactness::WithHalo { reach, halo: reach + more },
            Exactness::WithHalo { reach, halo } => Exactness::WithHalo { reach, halo: halo + more },
            Exactness::Proven { .. } => self.without_proof().with_halo(more),
            Exactness::Measured { reach, halo } => Exactness::Measured { reach, halo: halo + more },
        }
    }

    /// The promise if nothing is decided later than in its window.
    #[must_use]
    pub fn without_proof(self) -> Self {
        match self {
            Exactness::Proven { reach } => Exactness::Measured { reach, halo: reach },
            promise => promise,
        }
    }

    /// The promise if points that are looked at together can be farther apart by `more`.
    #[must_use]
    pub fn with_reach(self, more: f64) -> Self {
        match self {
            Exactness::ByLocality { reach } => Exactness::ByLocality { reach: reach + more },
            Exactness::WithHalo { reach, halo } => Exactness::WithHalo { reach: reach + more, halo },
            Exactness::Proven { reach } => Exactness::Proven { reach: reach + more },
            Exactness::Measured { reach, halo } => Exactness::Measured { reach: reach + more, halo },
        }
    }

    /// Assesses a run with these spans and windows.
    pub fn assess(self, by: SpanBy, size: WindowSize, lattice: &Lattice) -> Assessment {
        let shares = shares(self.reach(), by, size, lattice);
        let class = match self {
            Exactness::ByLocality { .. } => 'A',
            // Spans cut in stream order do not say which part of the map they hold, so nothing can be known to be final.
            Exactness::WithHalo { .. } | Exactness::Proven { .. } if by.is_in_space() => 'B',
            _ => 'C',
        };
        let has_limit = !matches!(self, Exactness::WithHalo { halo: f64::INFINITY, .. });
        let is_identical = class < 'C' && has_limit && shares == Shares::Always;
        let sentence = match (class, self) {
            _ if is_identical && class == 'A' => "equal to the static result: every pair in reach shares a window",
            (_, Exactness::Proven { .. }) if is_identical => {
                "equal to the static result: every pair in reach shares a window, and every edge is proven"
            }
            _ if is_identical => {
                "equal to the static result: every pair in reach shares a window, and all that decides about a point is loaded with it"
            }
            ('A' | 'B', _) if size.overlap() == 0 => {
                "different from the static result wherever a segment crosses the border of a window: windows share no span"
            }
            (_, Exactness::Measured { .. }) if size.overlap() == 0 => {
                "no promise of equality with the static result: windows share no span, so segments are cut where a window ends"
            }
            ('A', _) => {
                "equal to the static result only where every pair in reach shares a window, which these spans do not promise"
            }
            ('B', _) if has_limit => {
                "equal to the static result only where every pair in reach shares a window, which these spans do not promise"
            }
            ('B', _) => {
                "equal to the static result if no point is left undecided because its nearest neighbors lie beyond what was loaded, which is counted; give a search_radius to be sure"
            }
            (_, Exactness::Measured { .. }) => {
                "no promise of equality with the static result: compare with segment_static"
            }
            _ => {
                "no promise: spans cut in stream order prove nothing at the borders of windows; use spans by width, or compare with segment_static"
            }
        };
        let warning = match (&shares, size.overlap()) {
            // Segments are joined by what windows say of their halos.
            _ if class == 'B' && !has_limit => None,
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

impl Assessment {
    /// The same of a run that looks again at every point that a window could not decide.
    #[must_use]
    pub fn with_second_looks(self) -> Self {
        let sentence = "equal to the static result: a point that a window cannot decide is looked at again with its nearest neighbors, wherever they are";
        Self { is_identical: true, sentence: sentence.into(), ..self }
    }

    /// The assessment of a run whose spans are handed on when their part of the map is final, while the cloud comes in the
    /// order of its stream.
    #[must_use]
    pub fn finalized(mut self) -> Self {
        self.sentence += "; decisions wait until their region is final";
        self
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
    let (SpanBy::Width { width, direction } | SpanBy::Slabs { width, direction, .. }) = by else {
        return Shares::Unknown;
    };
    if reach == f64::INFINITY {
        return Shares::Unknown;
    }
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
    fn identity_needs_a_limit_to_what_decides() {
        let proven = assess(Exactness::Proven { reach: 0.3 }, 9.0, 1);
        assert_eq!((proven.class, proven.is_identical, proven.warning), ('B', true, None));
        assert!(!assess(Exactness::Proven { reach: 0.3 }, 0.2, 1).is_identical);
        let halo = assess(Exactness::WithHalo { reach: 0.3, halo: 5.0 }, 9.0, 1);
        assert_eq!((halo.class, halo.is_identical), ('B', true));
        let unlimited = assess(Exactness::WithHalo { reach: f64::INFINITY, halo: f64::INFINITY }, 9.0, 1);
        assert_eq!((unlimited.class, unlimited.is_identical, &unlimited.warning), ('B', false, &None));
        assert!(unlimited.with_second_looks().is_identical);
        assert_eq!(assess(Exactness::WithHalo { reach: f64::INFINITY, halo: f64::INFINITY }, 9.0, 0).warning, None);
        assert_eq!(assess(Exactness::Measured { reach: 0.0, halo: 0.0 }, 0.1, 1).class, 'C');
        let by_count = Exactness::ByLocality { reach: 0.3 }.assess(
            SpanBy::Count { points: 9 },
            WindowSize::default(),
            &Lattice::REAL,
        );
        assert!(!by_count.is_identical && by_count.warning.is_none());
    }
}
