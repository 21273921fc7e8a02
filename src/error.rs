//! What can go wrong, each with the value given and the value allowed.
//!
//! One enum for the whole core. The binding turns every variant into an exception that derives from `StreamsegError`
//! and from the builtin that Python people expect.

use std::io;

/// A failure of a run or of its set-up.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A parameter is outside what is allowed.
    #[error("{name} is {given}, allowed: {allowed}")]
    InvalidParameter {
        /// The parameter's name as users type it.
        name: &'static str,
        /// What was given.
        given: String,
        /// What would have been accepted.
        allowed: &'static str,
    },
    /// A coordinate is NaN, infinite, or too large to compute with.
    #[error(
        "point {point_id} has the coordinates ({}, {}, {}), which are not finite numbers below 1e60; remove such points or drop them with drop_invalid (--drop-invalid)",
        plain(position[0]), plain(position[1]), plain(position[2])
    )]
    NotFinite {
        /// The first such point of the stream.
        point_id: i64,
        /// Its coordinates.
        position: [f64; 3],
    },
    /// Something needs an attribute that the cloud does not have.
    #[error("'{name}' is no attribute of the cloud and no feature that can be computed; there are: {available}")]
    UnknownAttribute {
        /// The attribute asked for.
        name: String,
        /// Those there are.
        available: String,
    },
    /// Two attributes of the cloud are equally like the name that something needs.
    #[error("'{name}' can be '{first}' or '{second}', which the cloud both has; write the name exactly as it is there")]
    AmbiguousAttribute {
        /// The attribute asked for.
        name: String,
        /// One that it can be.
        first: String,
        /// Another.
        second: String,
    },
    /// A feature would have to be computed, but nothing says from which neighbors.
    #[error(
        "{name} is no attribute of the cloud, and {segmentor} has no neighborhood to compute it from; give the cloud with that attribute, or use a segmentor with search_radius or k"
    )]
    NoNeighborhood {
        /// The feature.
        name: &'static str,
        /// The segmentor's name.
        segmentor: String,
    },
    /// An attribute that spans are cut by is not a number.
    #[error("{name} of point {point_id} is {value}, expected a finite number; spans cannot be cut by it")]
    Attribute {
        /// The attribute's name.
        name: &'static str,
        /// The first such point.
        point_id: i64,
        /// Its value.
        value: f64,
    },
    /// A history tells of a segment that cannot be.
    #[error(
        "the history is damaged, or its parts are out of order: it tells of segment {segment_id} where that cannot be"
    )]
    DamagedHistory {
        /// The segment's id.
        segment_id: i64,
    },
    /// A segment is to be joined that is not known any more.
    #[error(
        "segment {segment_id} has gone out of scope, and was not kept to be joined later; this is a defect, please report it"
    )]
    OutOfScope {
        /// The segment's id.
        segment_id: i64,
    },
    /// A live source went backwards along the direction of its spans.
    #[error(
        "point {point_id} goes back along the direction of the spans, from slab {from} to slab {to}; a live source has to be sorted along it: use spans by count or time, or give the cloud as a file or an array"
    )]
    NotSorted {
        /// The first point that goes back.
        point_id: i64,
        /// The slab under way.
        from: i64,
        /// The slab the point lies in.
        to: i64,
    },
    /// A source that is read twice brought other points at the second time.
    #[error(
        "the source has changed since its points were counted: {difference}; it has to stay as it is while it is read twice"
    )]
    Changed {
        /// What is not as it was.
        difference: String,
    },
    /// A criterion, filter or calculator cannot be understood or used.
    #[error("{kind}, column {column}: {problem}\n{picture}")]
    Expression {
        /// "criterion", "filter" or "calculator".
        kind: String,
        /// Where in the text, in characters from 1.
        column: usize,
        /// What is wrong, what is allowed.
        problem: String,
        /// The text with a caret below the place.
        picture: String,
    },
    /// A segmentor returned something that are not labels of its window.
    #[error("segmentor '{segmentor}' {problem}")]
    Labels {
        /// The segmentor's name.
        segmentor: String,
        /// What is wrong with its answer.
        problem: String,
    },
    /// A segmentor came to a stop that is a defect of its own.
    #[error("segmentor '{segmentor}' failed in window {window}: {message}; this is a defect, please report it")]
    Panicked {
        /// The segmentor's name.
        segmentor: String,
        /// The window it was working on.
        window: u64,
        /// What it said.
        message: String,
    },
    /// The spool on disk could not be written or read.
    #[error("the spool in {folder} could not be {doing}: {cause}; free some space or set TMPDIR to another folder")]
    Spool {
        /// Where the spool lies.
        folder: String,
        /// "written" or "read".
        doing: &'static str,
        /// The system's answer.
        cause: io::Error,
    },
    /// The source or a caller's segmentor failed; its own error passes through untouched.
    #[error(transparent)]
    Foreign(#[from] Box<dyn std::error::Error + Send + Sync>),
}

impl Error {
    pub(crate) fn parameter(name: &'static str, given: impl std::fmt::Display, allowed: &'static str) -> Self {
        Error::InvalidParameter { name, given: given.to_string(), allowed }
    }

    pub(crate) fn unknown_attribute(name: &str, available: &[String]) -> Self {
        Error::UnknownAttribute { name: name.into(), available: available.join(", ") }
    }

    pub(crate) fn spool(doing: &'static str, cause: io::Error) -> Self {
        Error::Spool { folder: std::env::temp_dir().display().to_string(), doing, cause }
    }
}

/// What the core's fallible functions return.
pub type Result<T> = std::result::Result<T, Error>;

/// A number as people write it: without hundreds of zeros.
pub(crate) fn plain(value: f64) -> String {
    let size = value.abs();
    if size.is_finite() && size > 0.0 && !(1e-6..1e16).contains(&size) {
        format!("{value:e}")
    } else {
        value.to_string()
    }
}

/// Accepts a length, duration or the like that has to be a finite number above zero.
pub(crate) fn positive(name: &'static str, value: f64) -> Result<f64> {
    if value.is_finite() && value > 0.0 {
        Ok(value)
    } else {
        Err(Error::parameter(name, plain(value), "a finite number above 0"))
    }
}

/// Accepts a count that has to be at least one.
pub(crate) fn at_least_one(name: &'static str, value: usize) -> Result<usize> {
    if value >= 1 { Ok(value) } else { Err(Error::parameter(name, value, "a whole number of at least 1")) }
}
