//! Segments point clouds as a stream: clouds that do not fit in memory, or have not finished arriving.
//!
//! The modules, in the order in which data flows:
//!
//! | module | what comes in → what goes out |
//! |---|---|
//! | [`span`] | a cloud, in chunks → spans |
//! | [`window`] | spans → windows that slide over them |
//! | [`neighborhood`] | the points of a window → who is near whom |
//! | [`features`] | who is near whom → what the surface is like around each point |
//! | [`expression`] | a text → a criterion over the attributes of points |
//! | [`survey`] | windows → whatever is to be known of their points, without segments |
//! | [`preprocessing`] | the points of a window → fewer points |
//! | [`recipe`] | a window, prepared and segmented: preprocessing, features, filters, segmentor |
//! | [`segmentor`] | a window → one label per point |
//! | [`plan`] | how many points lie where → spans and windows that keep to a budget of memory |
//! | [`front`] | what windows leave open → pairs of segments that are one after all |
//! | [`weaver`] | labels of overlapping windows → segment ids, the history of the segments |
//! | [`revisit`] | windows → windows that see earlier points around them |
//! | [`pipeline`] | all of it, as an iterator |
//! | [`settlement`] | spans with carried ids → the same spans with final ids, after the end |
//!
//!
//! [`scene`] makes up surveys to try all this on.
//!
//! ```
//! use std::sync::Arc;
//! use streamseg::crew::Crew;
//! use streamseg::lattice::{Lattice, Metric};
//! use streamseg::pipeline::Pipeline;
//! use streamseg::segmentor::Proximity;
//! use streamseg::span::{Chunk, Source, SpanBy, spans_of};
//! use streamseg::window::WindowSize;
//!
//! // Two rows of points, 10 apart, in chunks of 100.
//! let rows = (0..1000).map(|i| [f64::from(i / 2), f64::from(10 * (i % 2)), 0.0]);
//! let points: Vec<[f64; 3]> = rows.collect();
//! let chunks: Vec<_> = points.chunks(100).map(|c| Ok(Chunk { points: c.to_vec(), attributes: vec![] })).collect();
//!
//! let spans = spans_of(chunks.into_iter(), SpanBy::Count { points: 50 }, &Lattice::REAL, Source::Live)?;
//! let segmentor = Arc::new(Proximity::new(1.5, Metric::Xyz)?);
//! let pipeline = Pipeline::new(spans, Lattice::REAL, segmentor, WindowSize::default(), Crew::new(1)?);
//! for span in pipeline {
//!     let ids = span?.segmented.carried_ids;
//!     assert!(ids.iter().enumerate().all(|(i, &id)| id == 1 + i as i64 % 2));
//! }
//! # Ok::<(), streamseg::error::Error>(())
//! ```

pub mod attribute;
mod awaited;
pub mod certificate;
pub mod crew;
pub mod error;
pub mod expression;
pub mod features;
pub mod front;
pub mod label;
pub mod lattice;
pub mod look;
pub mod neighborhood;
pub mod pipeline;
pub mod plan;
pub mod preprocessing;
pub mod recipe;
pub mod revisit;
pub mod scene;
pub mod segmentor;
pub mod settlement;
pub mod sightings;
pub mod size;
pub mod span;
pub mod survey;
pub mod undecided;
pub mod union_find;
pub mod weaver;
pub mod window;

mod disk;
#[cfg(feature = "python")]
mod python;
mod sync;
