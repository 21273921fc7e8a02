//! What it takes that a stream which comes back to where it was finds each object once.

use super::exactness::{Assessment, Exactness};
use crate::error::{Error, Result};
use crate::lattice::Lattice;
use crate::span::{Source, SpanBy};
use crate::window::WindowSize;

/// What is done for a stream that may come back.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ComingBack {
    /// Nothing: spans of space hold all that ever comes to their place, and share what they have to.
    Nothing,
    /// Points that have gone out of scope are brought back to windows within reach of them.
    BringBack,
    /// Decisions wait until their part of the map is final, because a later point could undo them.
    Wait,
}

impl Exactness {
    /// What is to be done if a source may come back to where it was.
    ///
    /// # Errors
    /// If that needs to know how far the segmentor looks, and it does not say.
    pub fn coming_back(self, by: SpanBy, source: Source, size: WindowSize, lattice: &Lattice) -> Result<ComingBack> {
        let (reach, waits) = (self.reach_of_all(), !self.is_monotone() && source == Source::Stored);
        if by.is_in_space() && (!self.is_monotone() || self.assess(by, size, lattice).is_identical) {
            return Ok(ComingBack::Nothing);
        }
        // A stored cloud can be searched for what has no limit.
        if reach == 0.0 || reach == f64::INFINITY && !waits {
            return Err(unknown_reach());
        }
        Ok(if waits { ComingBack::Wait } else { ComingBack::BringBack })
    }

    /// How far around a window earlier points have to be brought back where a stream may come back to any place.
    ///
    /// # Errors
    /// If that is not known, or has no limit.
    pub fn revisit_reach(self) -> Result<f64> {
        let reach = self.reach_of_all();
        if reach > 0.0 && reach.is_finite() { Ok(reach) } else { Err(unknown_reach()) }
    }

    /// How far away anything can matter; 0 if nothing is known of it.
    fn reach_of_all(self) -> f64 {
        match self {
            Exactness::ByLocality { reach } | Exactness::Proven { reach } => reach,
            Exactness::WithHalo { reach, halo } | Exactness::Measured { reach, halo } => reach + halo,
        }
    }

    /// Assesses a run in which earlier points are brought back to whatever window comes near them.
    pub fn assess_bringing_back(self) -> Assessment {
        let (class, is_identical, sentence) = if self.is_monotone() {
            (
                'A',
                true,
                "equal to the static result in any order: every pair in reach shares a window, if need be with points brought back",
            )
        } else {
            (
                'C',
                false,
                "near to the static result: more may still come to any place of such a stream, so every decision is an early one",
            )
        };
        Assessment { class, is_identical, sentence: sentence.into(), warning: None }
    }
}

fn unknown_reach() -> Error {
    Error::parameter(
        "revisit",
        "true with a segmentor whose reach is not known",
        "with a distance or search_radius, which says how far around a window earlier points have to be brought back",
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::span::Direction;

    const BY_COUNT: SpanBy = SpanBy::Count { points: 9 };

    fn by_width(width: f64) -> [SpanBy; 2] {
        let direction = Direction::X;
        [SpanBy::Width { width, direction }, SpanBy::Slabs { width, direction, points: 9 }]
    }

    fn coming_back(exactness: Exactness, by: SpanBy, source: Source) -> Result<ComingBack> {
        exactness.coming_back(by, source, WindowSize::default(), &Lattice::REAL)
    }

    #[test]
    fn what_nothing_can_undo_is_brought_back() {
        let near = Exactness::ByLocality { reach: 0.3 };
        for source in [Source::Stored, Source::Live] {
            assert_eq!(coming_back(near, BY_COUNT, source).unwrap(), ComingBack::BringBack);
            // Narrow spans of space share too little; wide ones hold all there is.
            for (width, expected) in [(0.1, ComingBack::BringBack), (9.0, ComingBack::Nothing)] {
                for by in by_width(width) {
                    assert_eq!(coming_back(near, by, source).unwrap(), expected);
                }
            }
        }
        assert!(near.assess_bringing_back().is_identical);
    }

    #[test]
    fn what_can_be_undone_waits_where_it_can() {
        let halo = Exactness::WithHalo { reach: 0.3, halo: 0.6 };
        assert_eq!(coming_back(halo, BY_COUNT, Source::Stored).unwrap(), ComingBack::Wait);
        assert_eq!(coming_back(halo, BY_COUNT, Source::Live).unwrap(), ComingBack::BringBack);
        for by in [by_width(0.1), by_width(9.0)].concat() {
            assert_eq!(coming_back(halo, by, Source::Stored).unwrap(), ComingBack::Nothing);
        }
        let early = halo.assess_bringing_back();
        assert_eq!((early.class, early.is_identical), ('C', false));
        assert!(early.sentence.contains("early"));
        assert_eq!(halo.revisit_reach().map(|reach| (reach * 10.0).round()).unwrap(), 9.0);
    }

    #[test]
    fn what_has_no_reach_is_refused_where_that_matters() {
        let unknown = Exactness::Measured { reach: 0.0, halo: 0.0 };
        let unlimited = Exactness::WithHalo { reach: f64::INFINITY, halo: f64::INFINITY };
        for source in [Source::Stored, Source::Live] {
            assert!(coming_back(unknown, BY_COUNT, source).is_err());
            assert_eq!(coming_back(unknown, by_width(1.0)[0], source).unwrap(), ComingBack::Nothing);
        }
        assert!(coming_back(unlimited, BY_COUNT, Source::Live).is_err());
        assert_eq!(coming_back(unlimited, BY_COUNT, Source::Stored).unwrap(), ComingBack::Wait);
        assert!(unknown.revisit_reach().is_err() && unlimited.revisit_reach().is_err());
    }
}
