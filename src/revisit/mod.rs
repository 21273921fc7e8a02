//! Streams that come back: points that have gone out of scope are kept in a store on disk, and those within reach of a new
//! window are brought back to be looked at with it.
//!
//! Source: seed of the framework, whose section 4 leaves two things open, that a scanner may cross its own track and find "the
//! same segment … multiple times in the same location", and that spans must be fed in order.
//!
//! A window sees its own spans, and before them the *context*: all points of earlier spans that lie within reach of its
//! new spans. Segments of the context that share a label with a point of the window are told to the weaver
//! ([`Returned`]), and become one with it, however long ago they went out of scope.
//!
//! *Monotone* relations are those where more points can only join more. For any two related points, one came later, and the
//! first window that has that one among its own holds the other too: as its own, or in its context. So the segments are
//! the static ones, whatever the order of the spans.
//!
//! Memory is bounded for monotone relations: a context of more points than the window has itself comes in several parts, each
//! in a window of its own over the same spans. Which points are in which part depends on the points alone, not on what is
//! stored already. For others, which only a live stream brings here, the context has to come as a whole: all that has ever
//! come to where the window is.

mod context;
mod raster;
mod store;

use std::collections::VecDeque;
use std::sync::{Arc, OnceLock};

pub use context::Context;

use crate::error::Result;
use crate::label::SegmentId;
use crate::lattice::Lattice;
use crate::segmentor::{Exactness, Plane, Segmentor};
use crate::span::Span;
use crate::weaver::{EvictedSpan, Returned};
use crate::window::{Frame, Slider, Window};
use context::{Recent, Surroundings, by_block};
use raster::{Blocks, Raster};
use store::{Store, Stored};

/// So many points of a span are kept together, if the span is as dense as the first.
const POINTS_PER_BLOCK: usize = 64;

/// Windows may be small, but a context has room for so many points.
const LEAST_ROOM: usize = 1 << 16;

/// Brings back what lies around new windows.
pub struct Revisit {
    raster: Raster,
    /// Known from the first points on.
    blocks: Option<Blocks>,
    is_monotone: bool,
    store: Store,
    /// Spans of windows, in scope, oldest first.
    recent: VecDeque<Arc<Recent>>,
    /// The first span that has not been in a window.
    next_span: u64,
    /// What is still to be brought back for the last window.
    under_way: Option<(Surroundings, Frame)>,
    room: usize,
}

impl Revisit {
    /// For a segmentor that promises `exactness`, over points on `lattice`. If more points can only join more, they are
    /// brought back for new spans only, and in parts if they are many.
    ///
    /// # Errors
    /// If the segmentor does not say how far it looks, or there can be no store.
    pub fn new(exactness: Exactness, lattice: Lattice) -> Result<Self> {
        let reach = exactness.revisit_reach()?;
        Ok(Self {
            raster: Raster::new(reach, lattice),
            blocks: None,
            is_monotone: exactness.is_monotone(),
            store: Store::new()?,
            recent: VecDeque::new(),
            next_span: 0,
            under_way: None,
            room: LEAST_ROOM,
        })
    }

    /// Brings back so many points at once, or as many as the window has itself, whichever is more; and only then a part of
    /// them, if they may come in parts.
    #[must_use]
    pub fn with_room(self, points: usize) -> Self {
        Self { room: points, ..self }
    }

    /// The next window and what has been brought back for it; none if there is no window yet.
    ///
    /// # Errors
    /// If the store cannot be read.
    pub fn next_window(&mut self, slider: &mut Slider) -> Result<Option<(Window, Option<Context>)>> {
        if let Some((look, frame)) = self.under_way.take() {
            let context = self.bring_back(look, &frame)?;
            if !context.is_empty() {
                let frame = slider.again(&frame);
                return Ok(Some(preceded(slider, frame, context)));
            }
        }
        let Some(frame) = slider.next_frame() else { return Ok(None) };
        if !self.is_monotone && frame.spans.iter().any(|span| span.extent.is_some()) {
            // Spans of space come once, with all that lies around them.
            return Ok(Some((slider.gather(frame), None)));
        }
        let look = self.look_around(&frame);
        let context = self.bring_back(look, &frame)?;
        Ok(Some(preceded(slider, frame, context)))
    }

    /// A look around the new spans of a window.
    fn look_around(&mut self, frame: &Frame) -> Surroundings {
        let own = &frame.spans[frame.own.clone()];
        let new: Vec<&Arc<Span>> = own.iter().filter(|span| span.index >= self.next_span).collect();
        let first_own = own.first().map_or(0, |span| span.index);
        let first_recent = self.recent.front().map_or(first_own, |recent| recent.span.index.min(first_own));
        let points_of_new = new.iter().flat_map(|span| &span.points);
        let mut occupied = self.raster.occupied(points_of_new.clone());
        let blocks = *self
            .blocks
            .get_or_insert_with(|| Blocks::of_about(POINTS_PER_BLOCK, points_of_new.count(), occupied.len()));
        if !self.is_monotone {
            // What lies around decides about points that are looked at again too.
            occupied = self.raster.occupied(own.iter().flat_map(|span| &span.points));
        }
        let earlier = self.recent.iter().take_while(|recent| recent.span.index < first_own);
        let look = Surroundings::new(self.raster, blocks, &occupied, earlier, first_recent);
        self.next_span = own.last().map_or(self.next_span, |span| span.index + 1);
        self.recent
            .extend(new.into_iter().map(|span| Arc::new(Recent { span: Arc::clone(span), raw_ids: OnceLock::new() })));
        look
    }

    fn bring_back(&mut self, mut look: Surroundings, frame: &Frame) -> Result<Context> {
        let points: usize = frame.spans.iter().map(|span| span.len()).sum();
        let room = if self.is_monotone { points.max(self.room) } else { usize::MAX };
        let context = look.take(&self.store, room)?;
        if !look.is_done() {
            self.under_way = Some((look, frame.clone()));
        }
        Ok(context)
    }

    /// Keeps the planes of a window's segments, whose ids start from `first`, and leaves out those of the `returned` whose
    /// planes do not agree with them.
    ///
    /// # Errors
    /// If the store cannot be read or written.
    pub fn agreeing(
        &mut self,
        returned: &mut Vec<Returned>,
        segmentor: &dyn Segmentor,
        first: SegmentId,
        planes: &[Plane],
    ) -> Result<()> {
        let mut agreeing = Vec::with_capacity(returned.len());
        for pair in returned.drain(..) {
            let earlier = self.store.plane(pair.segment_id)?;
            let later = planes.get(pair.label as usize);
            if earlier.as_ref().zip(later).is_none_or(|(earlier, later)| segmentor.agree(earlier, later)) {
                agreeing.push(pair);
            }
        }
        *returned = agreeing;
        self.store.put_planes(first, planes)
    }

    /// Stores the oldest span, which goes out of scope.
    ///
    /// # Errors
    /// If the store cannot be written.
    pub fn evict(&mut self, evicted: &EvictedSpan) -> Result<()> {
        let (Some(recent), Some(blocks)) = (self.recent.pop_front(), self.blocks) else { return Ok(()) };
        let span = &recent.span;
        let mut by_block: Vec<_> = by_block(span, self.raster, blocks, |_| true).into_iter().collect();
        by_block.sort_unstable_by_key(|(block, _)| *block);
        for (block, positions) in by_block {
            let at = || positions.iter().map(|&position| position as usize);
            let stored = Stored {
                point_ids: at().map(|i| span.point_id(i)).collect(),
                raw_ids: at().map(|i| evicted.raw_ids[i]).collect(),
                points: at().map(|i| span.points[i]).collect(),
                attributes: span.attributes.iter().map(|values| at().map(|i| values[i]).collect()).collect(),
            };
            self.store.put(block, span.index, &stored)?;
        }
        if Arc::strong_count(&recent) > 1 {
            // A context still names points of it.
            recent.raw_ids.get_or_init(|| evicted.raw_ids.clone());
        }
        Ok(())
    }
}

/// The window of a frame behind what has been brought back for it.
fn preceded(slider: &Slider, frame: Frame, context: Context) -> (Window, Option<Context>) {
    if context.is_empty() {
        return (slider.gather(frame), None);
    }
    (slider.gather(frame.behind(Arc::clone(&context.span))), Some(context))
}
