//! Why a point has no segment.
//!
//! Windows may say different things of one point. A label beats any cause; of two causes the one counts with which the
//! point came further on its way to a label, whatever the order of the windows.

use std::ops::AddAssign;

use super::NONE;

/// Why a point has no segment; the further it came on its way to a label, the earlier here.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Cause {
    /// The segmentor gave it none, and says no more.
    BySegmentor,
    /// It has no normal, or is too rough to begin a region and like none of its smooth neighbors.
    InNoRegion,
    /// It lies in no plane.
    InNoPlane,
    /// It is neither core nor border.
    Noise,
    /// No segment that starts from a seed reached it, or none of its segment's points may be one.
    NoSeed,
    /// The filter left it out.
    Filtered,
    /// A stage of preprocessing removed it.
    Removed,
    /// It has no finite coordinates.
    Invalid,
    /// No window held all that decides about it.
    Undecided,
    /// Its segment has too few points; known in the end only.
    TooSmall,
    /// Its segment has too many points; known in the end only.
    TooLarge,
}

impl Cause {
    /// All of them, in order.
    pub const ALL: [Cause; 11] = [
        Cause::BySegmentor,
        Cause::InNoRegion,
        Cause::InNoPlane,
        Cause::Noise,
        Cause::NoSeed,
        Cause::Filtered,
        Cause::Removed,
        Cause::Invalid,
        Cause::Undecided,
        Cause::TooSmall,
        Cause::TooLarge,
    ];

    /// Its name, as in manifests and in Python.
    pub fn name(self) -> &'static str {
        match self {
            Cause::BySegmentor => "by_segmentor",
            Cause::InNoRegion => "in_no_region",
            Cause::InNoPlane => "in_no_plane",
            Cause::Noise => "noise",
            Cause::NoSeed => "no_seed",
            Cause::Filtered => "filtered",
            Cause::Removed => "removed",
            Cause::Invalid => "invalid",
            Cause::Undecided => "undecided",
            Cause::TooSmall => "too_small",
            Cause::TooLarge => "too_large",
        }
    }

    /// What stands for it among labels: [`NONE`] if the segmentor says no more, and below.
    pub const fn label(self) -> i32 {
        NONE as i32 - self as i32
    }

    /// The cause that stands among labels; none if it is a label.
    pub fn of_label(label: i32) -> Option<Self> {
        usize::try_from(NONE as i32 - label).ok().and_then(|place| Self::ALL.get(place)).copied()
    }
}

/// Counts of points, or of segments, that come to nothing, by cause.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ByCause([u64; Cause::ALL.len()]);

impl ByCause {
    /// Counts more of a cause.
    pub fn add(&mut self, cause: Cause, count: u64) {
        self.0[cause as usize] += count;
    }

    /// How many there are of a cause.
    pub fn of(&self, cause: Cause) -> u64 {
        self.0[cause as usize]
    }

    /// All counts by the names of their causes.
    pub fn named(&self) -> impl Iterator<Item = (&'static str, u64)> {
        Cause::ALL.into_iter().zip(self.0).map(|(cause, count)| (cause.name(), count))
    }

    /// How many there are in all.
    pub fn total(&self) -> u64 {
        self.0.iter().sum()
    }
}

impl AddAssign for ByCause {
    fn add_assign(&mut self, others: Self) {
        self.0.iter_mut().zip(others.0).for_each(|(count, other)| *count += other);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn causes_stand_below_all_labels() {
        assert_eq!(Cause::BySegmentor.label(), NONE as i32);
        for (place, &cause) in Cause::ALL.iter().enumerate() {
            assert_eq!(cause as usize, place);
            assert!(cause.label() < 0);
            assert_eq!(Cause::of_label(cause.label()), Some(cause));
        }
        assert_eq!([0, 7, i32::MAX, i32::MIN, -99].map(Cause::of_label), [None; 5]);
    }

    #[test]
    fn points_are_counted_by_cause() {
        let mut unlabelled = ByCause::default();
        unlabelled.add(Cause::Noise, 2);
        let mut both = unlabelled;
        both.add(Cause::Filtered, 5);
        both += unlabelled;
        assert_eq!((both.of(Cause::Noise), both.of(Cause::Filtered), both.total()), (4, 5, 9));
        let named: Vec<_> = both.named().filter(|(_, count)| *count > 0).collect();
        assert_eq!(named, [("noise", 4), ("filtered", 5)]);
    }
}
