//! Spans: contiguous groups of points, of the stream or of space, in which a cloud comes in.
//!
//! A source delivers [`Chunk`]s of any size; [`spans_of`] cuts them into spans. By count, by time, by scan line and for
//! a source that is sorted along the direction the cut follows the stream ([`cutter`]); by width it follows space, and
//! a cloud that is not sorted along the direction is first laid into slabs, in bounded memory ([`slabs`]). If the points of
//! each slab have been counted beforehand ([`counting`]), slabs come while the stream is still being read ([`finalized`]).

mod archive;
mod counting;
mod cutter;
mod direction;
mod finalized;
mod slabs;
mod spool;
mod validity;

use std::ops::Range;
use std::sync::Arc;

use crate::error::{Result, at_least_one, positive};
use crate::lattice::Lattice;
pub use archive::Archive;
pub use counting::{Counting, SlabCounts};
pub use cutter::Cutter;
pub(crate) use direction::SlabIndex;
pub use direction::{Direction, Extent};
pub use finalized::Finalized;
pub use slabs::Slabs;
pub use validity::{Invalid, checked};

/// Points as a source delivers them.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Chunk {
    /// Lattice coordinates.
    pub points: Vec<[f64; 3]>,
    /// Attributes, one list each, one value per point: those of [`SpanBy::attributes`] first, then any others.
    pub attributes: Vec<Vec<f64>>,
}

impl Chunk {
    /// The same points in another order.
    pub(crate) fn in_order(&self, order: &[u32]) -> Self {
        let attributes = self.attributes.iter();
        Self {
            points: order.iter().map(|&i| self.points[i as usize]).collect(),
            attributes: attributes.map(|values| order.iter().map(|&i| values[i as usize]).collect()).collect(),
        }
    }

    /// Adds some points of another chunk with the same attributes.
    pub(crate) fn append(&mut self, other: &Chunk, range: Range<usize>) {
        self.points.extend_from_slice(&other.points[range.clone()]);
        if self.attributes.len() < other.attributes.len() {
            self.attributes.resize_with(other.attributes.len(), Vec::new);
        }
        for (values, others) in self.attributes.iter_mut().zip(&other.attributes) {
            values.extend_from_slice(&others[range.clone()]);
        }
    }
}

/// A contiguous group of points.
#[derive(Debug, Clone, PartialEq)]
pub struct Span {
    /// Number of the span, from 0, in the order of the stream.
    pub index: u64,
    /// Which points of the stream these are.
    pub point_ids: PointIds,
    /// Lattice coordinates, in the order of the point ids.
    pub points: Vec<[f64; 3]>,
    /// Attributes, as they came with the chunks.
    pub attributes: Vec<Vec<f64>>,
    /// The part of the map all of whose points this span holds, if it is one of space.
    pub extent: Option<Extent>,
}

/// The point ids of a span, ascending.
#[derive(Debug, Clone, PartialEq)]
pub enum PointIds {
    /// As many consecutive ids as the span has points, from this one on.
    From(i64),
    /// One id per point.
    Listed(Vec<i64>),
}

impl Span {
    /// How many points the span has.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Whether the span has no point.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// The id of the point at `position`.
    pub fn point_id(&self, position: usize) -> i64 {
        match &self.point_ids {
            PointIds::From(first) => first + position as i64,
            PointIds::Listed(ids) => ids[position],
        }
    }
}

/// How a cloud is cut into spans.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SpanBy {
    /// Half-open slabs of this width across the direction, anchored at absolute zero.
    Width {
        /// In units of the coordinates, above 0.
        width: f64,
        /// Along which the slabs follow each other.
        direction: Direction,
    },
    /// As many consecutive slabs of this width as hold no more than so many points, at least one. Of a live source one
    /// each: what is to come cannot be counted.
    Slabs {
        /// Width of a slab, in units of the coordinates, above 0.
        width: f64,
        /// Along which the slabs follow each other.
        direction: Direction,
        /// Most points of several slabs together.
        points: usize,
    },
    /// This many points each.
    Count {
        /// At least 1.
        points: usize,
    },
    /// A new span wherever a point's time is this far from the span's first.
    Time {
        /// Above 0.
        seconds: f64,
    },
    /// This many scan lines each; a line ends where the mirror turns or where the edge of the flight line ends.
    ScanLine {
        /// At least 1.
        lines: usize,
    },
    /// Each chunk of the source is one span.
    Given,
}

impl SpanBy {
    /// Refuses widths, counts and times that are not above zero.
    ///
    /// # Errors
    /// With the value given and the values allowed.
    pub fn validate(&self) -> Result<()> {
        match *self {
            SpanBy::Width { width, .. } | SpanBy::Slabs { width, .. } => positive("width", width).map(drop),
            SpanBy::Count { points } => at_least_one("points", points).map(drop),
            SpanBy::Time { seconds } => positive("seconds", seconds).map(drop),
            SpanBy::ScanLine { lines } => at_least_one("lines", lines).map(drop),
            SpanBy::Given => Ok(()),
        }
    }

    /// Whether a span holds all points of its part of the map, and not just what came in a row.
    pub fn is_in_space(&self) -> bool {
        matches!(self, SpanBy::Width { .. } | SpanBy::Slabs { .. })
    }

    /// The attributes that a chunk has to bring along, by their LAS names.
    pub fn attributes(&self) -> &'static [&'static str] {
        match self {
            SpanBy::Time { .. } => &["gps_time"],
            SpanBy::ScanLine { .. } => &["scan_direction_flag", "edge_of_flight_line"],
            SpanBy::Width { .. } | SpanBy::Slabs { .. } | SpanBy::Count { .. } | SpanBy::Given => &[],
        }
    }
}

/// Whether a source can be read to its end before the first span is needed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Source {
    /// A file or an array: it may be in any order.
    Stored,
    /// Still arriving, perhaps without end: spans are cut as points come.
    Live,
}

/// A source of spans that can be stopped.
pub trait SpanSource: Iterator<Item = Result<Span>> + Send {
    /// Asks the source for nothing more. Points of a stream that have come already are still cut into spans.
    fn stop(&mut self);

    /// Has all spans kept, so that they can be read again; to be asked before the first of them. None if they cannot.
    fn archive(&mut self) -> Option<Arc<dyn Archive>> {
        None
    }

    /// How many points waited for their slab to become final.
    fn waits(&self) -> Waits {
        Waits::default()
    }
}

/// Points that came before the span in which their slab became final.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Waits {
    /// How many did.
    pub points: u64,
    /// How many did at the same time.
    pub most: u64,
}

/// A stream of spans.
pub type Spans = Box<dyn SpanSource>;

/// Cuts the chunks of a source into spans.
///
/// # Errors
/// If `by` is not [valid](SpanBy::validate).
pub fn spans_of(
    chunks: impl Iterator<Item = Result<Chunk>> + Send + 'static,
    by: SpanBy,
    lattice: &Lattice,
    source: Source,
) -> Result<Spans> {
    by.validate()?;
    Ok(match (by, source) {
        (SpanBy::Width { width, direction }, Source::Stored) => {
            Box::new(Slabs::new(chunks, SlabIndex::new(width, direction, lattice), *lattice))
        }
        (SpanBy::Slabs { width, direction, points }, Source::Stored) => {
            Box::new(Slabs::new(chunks, SlabIndex::new(width, direction, lattice), *lattice).filled_up_to(points))
        }
        _ => Box::new(Cutter::new(chunks, by, lattice)),
    })
}

/// Cuts the chunks of a finite source into spans, and hands on their points in slabs that are final. The chunks have to be
/// those that were counted.
///
/// # Errors
/// If `by` is not [valid](SpanBy::validate).
pub fn finalized_spans_of(
    chunks: impl Iterator<Item = Result<Chunk>> + Send + 'static,
    by: SpanBy,
    lattice: &Lattice,
    counts: &SlabCounts,
) -> Result<Spans> {
    by.validate()?;
    Ok(Box::new(Finalized::new(Cutter::new(chunks, by, lattice), counts, lattice)))
}
