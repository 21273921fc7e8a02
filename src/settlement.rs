//! Keeps spans on disk until their carried ids can be made final.
//!
//! Ids are final only when the source has ended: the last window may join what the first ones left apart. So spans are
//! kept in a temporary file as they come out, then settled from the last to the first along the log of joins and
//! closings (see [`Settling`](crate::weaver::Settling)), and handed out again from the first to the last. What is left out
//! by its size, and who is numbered anew, is a [`Selection`].

use crate::disk::WordFile;
use crate::error::Result;
use crate::label::SegmentId;
use crate::weaver::{Aliases, Selection};

/// Spans waiting for their final ids, then an iterator over them.
#[derive(Default)]
pub struct Settlement {
    file: WordFile,
    kept: Vec<Kept>,
    /// So many of them, the first, do not have their final ids yet.
    unsettled: usize,
    end: u64,
    next: usize,
}

/// Where the ids of a span lie in the file: point ids, segment ids, coordinates if any.
struct Kept {
    index: u64,
    start: u64,
    points: usize,
    with_positions: bool,
    settles_at: u64,
}

/// A span whose ids are final.
#[derive(Debug, Clone, PartialEq)]
pub struct Settled {
    /// Which span.
    pub index: u64,
    /// The point ids, ascending.
    pub point_ids: Vec<i64>,
    /// The final segment id of each point; −1 also where its segment is left out.
    pub segment_ids: Vec<SegmentId>,
    /// Lattice coordinates, if they were kept.
    pub positions: Vec<[f64; 3]>,
}

impl Settlement {
    /// Keeps a span whose carried ids were handed out when the log stood at `settles_at`. Positions may be
    /// left out, for all points or for none.
    ///
    /// # Errors
    /// If the temporary file cannot be written.
    pub fn keep(
        &mut self,
        index: u64,
        point_ids: &[i64],
        segment_ids: &[SegmentId],
        positions: &[[f64; 3]],
        settles_at: u64,
    ) -> Result<()> {
        let (points, with_positions) = (point_ids.len(), !positions.is_empty());
        let kept = Kept { index, start: self.end, points, with_positions, settles_at };
        self.file.write_at(kept.start, point_ids)?;
        self.file.write_at(kept.ids_start(), segment_ids)?;
        self.file.write_at(kept.positions_start(), positions)?;
        self.end = kept.positions_start() + size_of_val(positions) as u64;
        self.kept.push(kept);
        self.unsettled = self.kept.len();
        Ok(())
    }

    /// Makes all ids final; the log has to be the one in which the spans' positions were taken, and from which was
    /// selected. Settled once, they stay: a final id may be a number by size, which means something else to the log.
    ///
    /// # Errors
    /// If a temporary file cannot be read or written.
    pub fn settle(&mut self, log: &mut Aliases, selection: &Selection) -> Result<()> {
        let mut settling = log.settling(selection);
        while let Some(kept) = self.unsettled.checked_sub(1).map(|last| &self.kept[last]) {
            settling.rewind(log, kept.settles_at, |_, _| ())?;
            let mut ids = self.file.read_at(kept.ids_start(), kept.points)?;
            settling.settle(&mut ids);
            self.file.write_at(kept.ids_start(), &ids)?;
            self.unsettled -= 1;
        }
        Ok(())
    }

    fn read(&mut self, span: usize) -> Result<Settled> {
        let kept = &self.kept[span];
        let positions = if kept.with_positions { kept.points } else { 0 };
        Ok(Settled {
            index: kept.index,
            point_ids: self.file.read_at(kept.start, kept.points)?,
            segment_ids: self.file.read_at(kept.ids_start(), kept.points)?,
            positions: self.file.read_at(kept.positions_start(), positions)?,
        })
    }
}

impl Kept {
    fn ids_start(&self) -> u64 {
        self.start + (self.points * size_of::<i64>()) as u64
    }

    fn positions_start(&self) -> u64 {
        self.ids_start() + (self.points * size_of::<SegmentId>()) as u64
    }
}

impl Iterator for Settlement {
    type Item = Result<Settled>;

    fn next(&mut self) -> Option<Self::Item> {
        let span = self.next;
        if span == self.kept.len() {
            return None;
        }
        self.next += 1;
        Some(self.read(span))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::size::{SizeLimits, Sort};
    use crate::weaver::Closed;

    /// Two segments that meet late, of two points and one, and another of one point.
    fn settled(limits: SizeLimits, sort: Sort) -> Vec<Settled> {
        let mut log = Aliases::default();
        let mut settlement = Settlement::default();
        log.mark_births(1);
        settlement.keep(0, &[0, 1], &[1, 2], &[[0.0; 3], [1.0; 3]], log.len()).unwrap();
        log.mark_births(3);
        log.join(4, 2);
        settlement.keep(1, &[2, 3], &[2, 3], &[], log.len()).unwrap();
        log.join(2, 1);
        log.close(&Closed { id: 3, points: 1, has_seed: true });
        log.close(&Closed { id: 1, points: 3, has_seed: true });
        let selection = Selection::new(&mut log, limits, sort).unwrap();
        // A caller who was interrupted on the way back asks twice.
        settlement.settle(&mut log, &selection).unwrap();
        settlement.settle(&mut log, &selection).unwrap();
        settlement.map(Result::unwrap).collect()
    }

    #[test]
    fn spans_come_back_in_order_with_final_ids() {
        let spans = settled(SizeLimits::default(), Sort::Native);
        assert_eq!(spans[0].segment_ids, [1, 1]);
        assert_eq!(spans[0].positions.len(), 2);
        assert_eq!((spans[1].index, &spans[1].point_ids[..], &spans[1].segment_ids[..]), (1, &[2, 3][..], &[1, 3][..]));
        assert_eq!(spans.len(), 2);
    }

    #[test]
    fn limits_and_order_are_those_of_whole_segments() {
        let ids =
            |limits, sort| settled(limits, sort).into_iter().flat_map(|span| span.segment_ids).collect::<Vec<_>>();
        assert_eq!(ids(SizeLimits::new(2, None).unwrap(), Sort::Native), [1, 1, 1, -1]);
        assert_eq!(ids(SizeLimits::new(1, Some(2)).unwrap(), Sort::Native), [-1, -1, -1, 3]);
        assert_eq!(ids(SizeLimits::default(), Sort::Ascending), [2, 2, 2, 1]);
        assert_eq!(ids(SizeLimits::new(1, Some(2)).unwrap(), Sort::Descending), [-1, -1, -1, 1]);
    }
}
