//! What a window gets to see beside its own spans: points of earlier spans that lie within reach of it.

use std::collections::BTreeMap;
use std::sync::{Arc, OnceLock};

use rustc_hash::{FxHashMap, FxHashSet};

use super::raster::{Blocks, Cell, Raster, surroundings};
use super::store::{Store, Stored};
use crate::error::Result;
use crate::label::{NONE, SegmentId};
use crate::span::{PointIds, Span};
use crate::weaver::Returned;

/// A span that is no window's own any more, or will soon be none's, and is not in the store yet.
pub(super) struct Recent {
    pub span: Arc<Span>,
    /// Its raw segment ids, once it is out of the weaver's scope.
    pub raw_ids: OnceLock<Vec<SegmentId>>,
}

/// Some points of one recent span in one block.
struct Near {
    recent: Arc<Recent>,
    positions: Vec<u32>,
}

/// Where the points around a window are, taken up bit by bit.
pub(super) struct Surroundings {
    raster: Raster,
    around: FxHashSet<Cell>,
    /// The blocks that may hold such points, in order, from the one under way.
    blocks: std::vec::IntoIter<Cell>,
    block: Option<Cell>,
    /// The first span of the block under way that has not been taken up.
    next_span: u64,
    /// Spans from this one on were not in the store when the window began.
    first_recent: u64,
    near: BTreeMap<(Cell, u64), Near>,
}

impl Surroundings {
    /// A look around the cells `occupied`, at all that is stored of spans before `first_recent`, and at the spans `recent`.
    pub fn new<'a>(
        raster: Raster,
        size: Blocks,
        occupied: &FxHashSet<Cell>,
        recent: impl Iterator<Item = &'a Arc<Recent>>,
        first_recent: u64,
    ) -> Self {
        let around = surroundings(occupied);
        let blocks: FxHashSet<Cell> = around.iter().map(|&cell| size.of(cell)).collect();
        let mut blocks: Vec<Cell> = blocks.into_iter().collect();
        blocks.sort_unstable();
        let mut near = BTreeMap::new();
        for recent in recent {
            for (block, positions) in by_block(&recent.span, raster, size, |cell| around.contains(&cell)) {
                near.insert((block, recent.span.index), Near { recent: Arc::clone(recent), positions });
            }
        }
        let mut blocks = blocks.into_iter();
        let block = blocks.next();
        Self { raster, around, blocks, block, next_span: 0, first_recent, near }
    }

    /// Takes up the next points, until there are `most` or a few more. Which these are does not depend on what is stored
    /// already: block by block it is one span after the other.
    pub fn take(&mut self, store: &Store, most: usize) -> Result<Context> {
        let mut taken = Taken::default();
        while let Some(block) = self.block.filter(|_| taken.origins.len() < most) {
            let mut nearness = Nearness { raster: &self.raster, around: &self.around, last: None };
            let rest = store.each(block, self.next_span, self.first_recent, |stored| {
                taken.add_stored(&stored, &mut nearness);
                taken.origins.len() < most
            })?;
            self.next_span = rest.unwrap_or(self.next_span.max(self.first_recent));
            let has_room = rest.is_none() && taken.origins.len() < most;
            if has_room && !self.take_recent(block, most, &mut taken) {
                self.block = self.blocks.next();
                self.next_span = 0;
            }
        }
        Ok(taken.into_context())
    }

    /// Takes up the next points of recent spans in a block; whether there may be more.
    fn take_recent(&mut self, block: Cell, most: usize, taken: &mut Taken) -> bool {
        while let Some(&key) = self.near.range((block, self.next_span)..=(block, u64::MAX)).next().map(|(key, _)| key) {
            if let Some(near) = self.near.remove(&key) {
                taken.add_recent(&near);
            }
            self.next_span = key.1 + 1;
            if taken.origins.len() >= most {
                return true;
            }
        }
        false
    }

    /// Whether there is nothing more to be taken up.
    pub fn is_done(&self) -> bool {
        self.block.is_none()
    }
}

/// The valid points of a span in those cells that `is_wanted` names, block by block.
pub(super) fn by_block(
    span: &Span,
    raster: Raster,
    size: Blocks,
    is_wanted: impl Fn(Cell) -> bool,
) -> FxHashMap<Cell, Vec<u32>> {
    let mut blocks: FxHashMap<Cell, Vec<u32>> = FxHashMap::default();
    let mut last = None;
    for (position, point) in (0u32..).zip(&span.points) {
        let Some(cell) = raster.cell_of(point) else { continue };
        let is_wanted = match last {
            Some((known, answer)) if known == cell => answer,
            _ => is_wanted(cell),
        };
        last = Some((cell, is_wanted));
        if is_wanted {
            blocks.entry(size.of(cell)).or_default().push(position);
        }
    }
    blocks
}

/// Whether a point lies in the surroundings; those that follow each other mostly share a cell.
struct Nearness<'a> {
    raster: &'a Raster,
    around: &'a FxHashSet<Cell>,
    last: Option<(Cell, bool)>,
}

impl Nearness<'_> {
    fn holds(&mut self, point: &[f64; 3]) -> bool {
        let Some(cell) = self.raster.cell_of(point) else { return false };
        match self.last {
            Some((known, answer)) if known == cell => answer,
            _ => self.last.insert((cell, self.around.contains(&cell))).1,
        }
    }
}

/// Where the segment of a point is to be found.
#[derive(Clone, Copy)]
enum Origin {
    Known(SegmentId),
    Recent { which: u32, position: u32 },
}

#[derive(Default)]
struct Taken {
    points: Stored,
    origins: Vec<Origin>,
    recent: Vec<Arc<Recent>>,
}

impl Taken {
    fn add_stored(&mut self, stored: &Stored, nearness: &mut Nearness<'_>) {
        let kept: Vec<usize> = (0..stored.points.len()).filter(|&i| nearness.holds(&stored.points[i])).collect();
        self.origins.extend(kept.iter().map(|&i| Origin::Known(stored.raw_ids[i])));
        self.points.point_ids.extend(kept.iter().map(|&i| stored.point_ids[i]));
        self.points.points.extend(kept.iter().map(|&i| stored.points[i]));
        self.add_attributes(&stored.attributes, || kept.iter().copied());
    }

    fn add_recent(&mut self, Near { recent, positions }: &Near) {
        let which = self.recent.len() as u32;
        self.recent.push(Arc::clone(recent));
        let at = || positions.iter().map(|&position| position as usize);
        self.origins.extend(positions.iter().map(|&position| Origin::Recent { which, position }));
        self.points.point_ids.extend(at().map(|i| recent.span.point_id(i)));
        self.points.points.extend(at().map(|i| recent.span.points[i]));
        self.add_attributes(&recent.span.attributes, at);
    }

    fn add_attributes<I: Iterator<Item = usize>>(&mut self, attributes: &[Vec<f64>], kept: impl Fn() -> I) {
        self.points.attributes.resize_with(attributes.len().max(self.points.attributes.len()), Vec::new);
        for (values, others) in self.points.attributes.iter_mut().zip(attributes) {
            values.extend(kept().map(|i| others[i]));
        }
    }

    /// Puts the points into the order of the stream, as in any span.
    fn into_context(self) -> Context {
        let Self { points: Stored { point_ids, points, attributes, .. }, origins, recent } = self;
        let mut order: Vec<u32> = (0..point_ids.len() as u32).collect();
        order.sort_unstable_by_key(|&i| point_ids[i as usize]);
        let span = Span {
            index: u64::MAX,
            point_ids: PointIds::Listed(in_order(&point_ids, &order)),
            points: in_order(&points, &order),
            attributes: attributes.iter().map(|values| in_order(values, &order)).collect(),
            extent: None,
        };
        Context { span: Arc::new(span), origins: in_order(&origins, &order), recent }
    }
}

fn in_order<T: Copy>(values: &[T], order: &[u32]) -> Vec<T> {
    order.iter().map(|&i| values[i as usize]).collect()
}

/// Points of earlier spans around a window.
pub struct Context {
    /// The points, as if they were a span.
    pub span: Arc<Span>,
    origins: Vec<Origin>,
    recent: Vec<Arc<Recent>>,
}

impl Context {
    /// How many points there are.
    pub fn len(&self) -> usize {
        self.origins.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.origins.is_empty()
    }

    /// The earlier segments that share points with the window's labels; `labels` has one for each point of the context, and
    /// `raw_id` answers for points in the weaver's scope.
    pub fn returned(&self, labels: &[i32], raw_id: impl Fn(u64, usize) -> Option<SegmentId>) -> Vec<Returned> {
        let mut counts: BTreeMap<(SegmentId, i32), u64> = BTreeMap::new();
        for (&origin, &label) in self.origins.iter().zip(labels).filter(|(_, label)| **label >= 0) {
            let segment_id = self.segment_of(origin, &raw_id);
            if segment_id != NONE {
                *counts.entry((segment_id, label)).or_default() += 1;
            }
        }
        let returned = |((segment_id, label), points)| Returned { segment_id, label, points };
        counts.into_iter().map(returned).collect()
    }

    fn segment_of(&self, origin: Origin, raw_id: impl Fn(u64, usize) -> Option<SegmentId>) -> SegmentId {
        match origin {
            Origin::Known(segment_id) => segment_id,
            Origin::Recent { which, position } => {
                let Recent { span, raw_ids } = &*self.recent[which as usize];
                match raw_ids.get() {
                    Some(raw_ids) => raw_ids[position as usize],
                    None => raw_id(span.index, position as usize).unwrap_or(NONE),
                }
            }
        }
    }
}
