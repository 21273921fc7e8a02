//! Which segments are kept in the end, and under which id.
//!
//! The log tells of every whole when it is closed: its final id, how many points it has, whether one of them may be a
//! seed. That is all it takes to leave out wholes of other sizes, and those without a seed. To number the others by size,
//! all of them have to be known together: sixteen bytes of memory for each segment that is kept. Without an order the
//! memory does not grow with the stream.

use super::{Aliases, Closed};
use crate::error::Result;
use crate::label::{ByCause, Cause, NONE, SegmentId};
use crate::size::{SizeLimits, Sort};

/// What final ids become; by default nothing is left out and nothing numbered anew.
#[derive(Debug, Clone, Default)]
pub struct Selection {
    limits: Option<SizeLimits>,
    /// Final ids and their numbers by size, if there is an order; by id.
    numbers: Option<Vec<[SegmentId; 2]>>,
    kept_segments: u64,
    left_out_segments: ByCause,
    left_out_points: ByCause,
}

impl Selection {
    /// Selects among the wholes that the log tells of; to be called after the end of the stream.
    ///
    /// # Errors
    /// If the temporary file of the log cannot be read.
    pub fn new(log: &mut Aliases, limits: SizeLimits, sort: Sort) -> Result<Self> {
        Self::among(log, Some(limits), sort)
    }

    /// Keeps all wholes that the log tells of, seeds or not, and counts them.
    ///
    /// # Errors
    /// If the temporary file of the log cannot be read.
    pub fn everything(log: &mut Aliases) -> Result<Self> {
        Self::among(log, None, Sort::Native)
    }

    fn among(log: &mut Aliases, limits: Option<SizeLimits>, sort: Sort) -> Result<Self> {
        let mut selection = Self { limits, ..Self::default() };
        let mut kept: Vec<(u64, SegmentId)> = Vec::new();
        log.for_each_closed(|whole| {
            if let Some(cause) = selection.refusal(whole) {
                selection.left_out_segments.add(cause, u64::from(whole.points > 0));
                selection.left_out_points.add(cause, whole.points);
            } else {
                selection.kept_segments += u64::from(whole.points > 0);
                if sort != Sort::Native {
                    kept.push((whole.points, whole.id));
                }
            }
        })?;
        if sort != Sort::Native {
            selection.numbers = Some(numbers(kept, sort));
        }
        Ok(selection)
    }

    /// Why a whole is left out; none if it is kept. Whether it has a seed is asked first, as a segmentor would.
    fn refusal(&self, whole: &Closed) -> Option<Cause> {
        let limits = self.limits?;
        if !whole.has_seed {
            return Some(Cause::NoSeed);
        }
        let size = if whole.points < limits.min() { Cause::TooSmall } else { Cause::TooLarge };
        (!limits.contains(whole.points)).then_some(size)
    }

    /// What the id of a closed whole becomes; [`NONE`] if it is left out.
    pub fn id_of(&self, whole: &Closed) -> SegmentId {
        match &self.numbers {
            _ if self.refusal(whole).is_some() => NONE,
            None => whole.id,
            Some(numbers) => {
                numbers.binary_search_by_key(&whole.id, |[id, _]| *id).map_or(NONE, |place| numbers[place][1])
            }
        }
    }

    /// How many segments are kept.
    pub fn kept_segments(&self) -> u64 {
        self.kept_segments
    }

    /// How many segments are left out, and why.
    pub fn left_out_segments(&self) -> &ByCause {
        &self.left_out_segments
    }

    /// How many points they hold.
    pub fn left_out_points(&self) -> &ByCause {
        &self.left_out_points
    }
}

/// Numbers from 1 by size, then by id; sorted by id.
fn numbers(mut kept: Vec<(u64, SegmentId)>, sort: Sort) -> Vec<[SegmentId; 2]> {
    kept.sort_unstable_by(|(size, id), (other_size, other_id)| {
        let by_size = if sort == Sort::Descending { other_size.cmp(size) } else { size.cmp(other_size) };
        by_size.then(id.cmp(other_id))
    });
    let mut numbers: Vec<[SegmentId; 2]> = kept.iter().zip(1..).map(|(&(_, id), number)| [id, number]).collect();
    numbers.sort_unstable();
    numbers
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;

    /// Wholes of 5, 2, 9, 5 and no points; the third has no seed.
    fn log() -> Aliases {
        let mut log = Aliases::default();
        log.mark_births(1);
        for (id, points, has_seed) in [(4, 5, true), (1, 5, true), (2, 2, true), (3, 9, false), (5, 0, true)] {
            log.close(&Closed { id, points, has_seed });
        }
        log
    }

    fn selected(limits: SizeLimits, sort: Sort) -> Result<([i64; 6], [u64; 3])> {
        let mut log = log();
        let selection = Selection::new(&mut log, limits, sort)?;
        let mut ids = [1, 2, 3, 4, 5, NONE];
        log.resolve(&mut ids, &selection)?;
        let left_out = [selection.left_out_segments(), selection.left_out_points()].map(ByCause::total);
        Ok((ids, [selection.kept_segments(), left_out[0], left_out[1]]))
    }

    #[test]
    fn what_is_outside_the_limits_or_has_no_seed_is_left_out() {
        let limits = |min, max| SizeLimits::new(min, max).unwrap();
        assert_eq!(selected(limits(1, None), Sort::Native).unwrap(), ([1, 2, -1, 4, -1, -1], [3, 1, 9]));
        assert_eq!(selected(limits(3, None), Sort::Native).unwrap(), ([1, -1, -1, 4, -1, -1], [2, 2, 11]));
        assert_eq!(selected(limits(1, Some(4)), Sort::Native).unwrap(), ([-1, 2, -1, -1, -1, -1], [1, 3, 19]));
    }

    #[test]
    fn what_is_left_out_has_one_cause() {
        let limits = SizeLimits::new(3, Some(4)).unwrap();
        let selection = Selection::new(&mut log(), limits, Sort::Native).unwrap();
        for (cause, segments, points) in [(Cause::NoSeed, 1, 9), (Cause::TooSmall, 1, 2), (Cause::TooLarge, 2, 10)] {
            assert_eq!(selection.left_out_segments().of(cause), segments);
            assert_eq!(selection.left_out_points().of(cause), points);
        }
        let everything = Selection::everything(&mut log()).unwrap();
        assert_eq!((everything.kept_segments(), everything.left_out_points().total()), (4, 0));
    }

    #[test]
    fn kept_segments_are_numbered_by_size_then_id() {
        let all = SizeLimits::default();
        assert_eq!(selected(all, Sort::Ascending).unwrap().0, [2, 1, -1, 3, -1, -1]);
        assert_eq!(selected(all, Sort::Descending).unwrap().0, [1, 3, -1, 2, -1, -1]);
    }

    #[test]
    fn by_default_every_id_stays() {
        let mut ids = [1, 2, 3, 4, 5, NONE, 77];
        log().resolve(&mut ids, &Selection::default()).unwrap();
        assert_eq!(ids, [1, 2, 3, 4, 5, NONE, 77]);
    }
}
