//! Lays a cloud that is in any order into slabs, in bounded memory, and hands the slabs out along the direction.
//!
//! Nothing is known of the cloud before it has been read, so no slab is handed on before the last point has come: see
//! [`Finalized`](super::Finalized) for what a count beforehand makes possible. Slabs without points are passed over, so
//! a stray point far away costs nothing.
//!
//! When all points have come, any slab can be read at any time ([`Archive`](super::Archive)); without an archive it is dropped
//! when it has been handed on.

use std::sync::{Arc, OnceLock};

use super::spool::{Laid, Spool};
use super::{Archive, Chunk, SlabIndex, Span, SpanSource};
use crate::error::Result;
use crate::lattice::Lattice;

/// An iterator of spans by width over chunks in any order.
pub struct Slabs<C> {
    /// The source until it is spooled.
    chunks: Option<C>,
    spool: Spool,
    archived: Option<Archived>,
}

/// Slabs that are kept, and which of them is the next to be handed on.
struct Archived {
    laid: Arc<OnceLock<Laid>>,
    index: u64,
}

impl Archived {
    fn hand_on(&mut self) -> Option<Result<Span>> {
        self.index += 1;
        self.laid.extents().get(self.index as usize - 1).map(|_| self.laid.read(self.index - 1))
    }
}

impl<C: Iterator<Item = Result<Chunk>>> Slabs<C> {
    pub(crate) fn new(chunks: C, slab_of: SlabIndex, lattice: Lattice) -> Self {
        Self { chunks: Some(chunks), spool: Spool::new(slab_of, lattice), archived: None }
    }

    /// Hands out consecutive slabs together while they hold no more than so many points.
    pub(crate) fn filled_up_to(mut self, points: usize) -> Self {
        self.spool.most = points;
        self
    }

    fn spool_all(&mut self, chunks: C) -> Result<()> {
        for chunk in chunks {
            self.spool.lay(&chunk?, |_, _| ())?;
            self.spool.relieve()?;
        }
        self.spool.settle()?;
        if let Some(Archived { laid, .. }) = &self.archived {
            laid.get_or_init(|| self.spool.lay_out());
        }
        Ok(())
    }
}

impl<C: Iterator<Item = Result<Chunk>>> Iterator for Slabs<C> {
    type Item = Result<Span>;

    fn next(&mut self) -> Option<Self::Item> {
        if let Some(chunks) = self.chunks.take()
            && let Err(error) = self.spool_all(chunks)
        {
            self.spool.clear();
            return Some(Err(error));
        }
        match &mut self.archived {
            Some(archived) => archived.hand_on(),
            None => self.spool.hand_on(),
        }
    }
}

impl<C: Iterator<Item = Result<Chunk>> + Send> SpanSource for Slabs<C> {
    fn stop(&mut self) {
        self.chunks = None;
        self.spool.clear();
        if let Some(archived) = &mut self.archived {
            archived.index = archived.laid.extents().len() as u64;
        }
    }

    fn archive(&mut self) -> Option<Arc<dyn Archive>> {
        let laid: Arc<OnceLock<Laid>> = Arc::default();
        self.archived = Some(Archived { laid: Arc::clone(&laid), index: 0 });
        Some(Arc::new(laid))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::span::{Direction, PointIds};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn every_point_comes_out_once_in_its_slab_in_stream_order(
            xs in prop::collection::vec(prop_oneof![4 => -50.0f64..50.0, 1 => Just(f64::NAN)], 1..200),
            chunk_size in 1usize..50,
            memory in prop_oneof![Just(1usize), Just(500), Just(usize::MAX)],
            is_archived in any::<bool>(),
            most in prop_oneof![Just(0usize), 1usize..60],
        ) {
            let chunks = xs.chunks(chunk_size).map(|xs| Ok(Chunk {
                points: xs.iter().map(|&x| [x, 1.0, 2.0]).collect(),
                attributes: vec![xs.to_vec()],
            })).collect::<Vec<_>>();
            let slab_of = SlabIndex::new(7.0, Direction::X, &Lattice::REAL);
            let mut slabs = Slabs::new(chunks.into_iter(), slab_of, Lattice::REAL).filled_up_to(most);
            slabs.spool.memory = memory;
            let archive = if is_archived { slabs.archive() } else { None };
            let mut handed_on = Vec::new();

            let mut seen = vec![false; xs.len()];
            let mut last_slab = i64::MIN;
            let mut high = f64::NEG_INFINITY;
            for (i, span) in slabs.enumerate() {
                let span = span.unwrap();
                prop_assert_eq!(span.index, i as u64);
                let PointIds::Listed(ids) = &span.point_ids else { panic!("listed") };
                prop_assert!(ids.windows(2).all(|w| w[0] < w[1]));
                let extent = span.extent.unwrap();
                prop_assert_eq!(extent.low, high);
                high = extent.high;
                let mut slabs = std::collections::BTreeSet::new();
                prop_assert_eq!(span.attributes[0].len(), ids.len());
                for ((&id, point), value) in ids.iter().zip(&span.points).zip(&span.attributes[0]) {
                    prop_assert_eq!(value.to_bits(), xs[id as usize].to_bits());
                    prop_assert!(!std::mem::replace(&mut seen[id as usize], true));
                    prop_assert_eq!(point[0].to_bits(), xs[id as usize].to_bits());
                    if let Some(at) = slab_of.of(point).unwrap() {
                        prop_assert!(extent.low <= point[0] && point[0] < extent.high);
                        slabs.insert(at);
                    }
                }
                prop_assert!(slabs.len() <= 1 || ids.len() <= most);
                if let (Some(&first), Some(&last)) = (slabs.first(), slabs.last()) {
                    prop_assert!(first > last_slab);
                    last_slab = last;
                }
                handed_on.push(span);
            }
            // In any order and more than once.
            for span in handed_on.iter().chain(&handed_on).rev() {
                let Some(archive) = &archive else { break };
                let again = archive.read(span.index).unwrap();
                // NaN is not equal to itself, but it looks the same.
                prop_assert_eq!(format!("{again:?}"), format!("{span:?}"));
                prop_assert_eq!(archive.extents()[span.index as usize], span.extent.unwrap());
                prop_assert_eq!(archive.extents().len(), handed_on.len());
            }
            prop_assert!(seen.into_iter().all(|s| s));
            prop_assert_eq!(high, f64::INFINITY);
        }
    }
}
