//! How a cloud is cut, as Python objects: spans by width, count, time or scan line, and the window.

use pyo3::IntoPyObjectExt;
use pyo3::prelude::*;

use super::errors::InvalidParameter;
use super::numbers::{Real, Whole};
use super::plan::PyPlan;
use super::segmentors::PyRecipe;
use crate::error::Result;
use crate::segmentor::Layout;
use crate::span::{Direction, SpanBy};
use crate::window::WindowSize;

fn valid(by: SpanBy) -> Result<SpanBy> {
    by.validate().map(|()| by)
}

/// Spans as half-open slabs of a width, anchored at absolute zero.
///
/// A file or an array may be in any order; it is laid into slabs first, on disk where it is large. A live source has to
/// be sorted along the direction.
///
/// Parameters
/// ----------
/// width : float
///     Width of a slab in units of the coordinates, above 0.
/// direction : {"x", "y"} or float, default "x"
///     Along which the slabs follow each other; a number is an azimuth in degrees, clockwise from the y axis.
///
/// Raises
/// ------
/// InvalidParameter
///     If the width is not above 0 or the direction is none of those.
///
/// Examples
/// --------
/// >>> SpanByWidth(50.0, direction="y")
/// SpanByWidth(50.0, direction='y')
#[pyclass(frozen, eq, name = "SpanByWidth", module = "streamseg")]
#[derive(Clone, PartialEq)]
pub struct PySpanByWidth {
    pub(super) by: SpanBy,
    /// Width of a slab in units of the coordinates.
    #[pyo3(get)]
    width: f64,
}

#[pymethods]
impl PySpanByWidth {
    #[new]
    #[pyo3(signature = (width, direction = None))]
    fn new(width: Real, direction: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        let width = width.named("width")?;
        Ok(Self::of(width, direction.map_or(Ok(Direction::X), parse_direction)?)?)
    }

    /// "x", "y" or an azimuth in degrees, clockwise from the y axis.
    #[getter]
    fn direction(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        direction_of(py, self.by)
    }

    fn __getnewargs__(&self, py: Python<'_>) -> PyResult<(f64, Py<PyAny>)> {
        Ok((self.width, self.direction(py)?))
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        Ok(format!("SpanByWidth({:?}, direction={})", self.width, self.direction(py)?.bind(py).repr()?))
    }
}

impl PySpanByWidth {
    pub(super) fn of(width: f64, direction: Direction) -> Result<Self> {
        Ok(Self { by: valid(SpanBy::Width { width, direction })?, width })
    }
}

/// The direction of spans of space, as users type it.
pub(super) fn direction_of(py: Python<'_>, by: SpanBy) -> PyResult<Py<PyAny>> {
    let (SpanBy::Width { direction, .. } | SpanBy::Slabs { direction, .. }) = by else { return Ok(py.None()) };
    match direction {
        Direction::X => "x".into_py_any(py),
        Direction::Y => "y".into_py_any(py),
        Direction::Azimuth(degrees) => degrees.into_py_any(py),
    }
}

fn parse_direction(direction: &Bound<'_, PyAny>) -> PyResult<Direction> {
    if let Ok(degrees) = direction.extract::<f64>() {
        return Ok(Direction::azimuth(degrees)?);
    }
    match direction.extract::<String>().as_deref() {
        Ok("x") => Ok(Direction::X),
        Ok("y") => Ok(Direction::Y),
        _ => {
            let given = direction.repr()?;
            Err(InvalidParameter::new_err(format!(
                "direction is {given}, allowed: 'x', 'y' or an azimuth in degrees (clockwise from the y axis)"
            )))
        }
    }
}

/// Spans of a number of points each, in stream order.
///
/// Parameters
/// ----------
/// points : int
///     Points per span, at least 1.
///
/// Raises
/// ------
/// InvalidParameter
///     If there are no points in a span.
///
/// Examples
/// --------
/// >>> SpanByCount(100_000)
/// SpanByCount(100000)
#[pyclass(frozen, eq, name = "SpanByCount", module = "streamseg")]
#[derive(Clone, PartialEq)]
pub struct PySpanByCount {
    pub(super) by: SpanBy,
    /// Points per span.
    #[pyo3(get)]
    points: i64,
}

#[pymethods]
impl PySpanByCount {
    #[new]
    fn new(points: Whole) -> PyResult<Self> {
        let points = points.named("points")?;
        let by = valid(SpanBy::Count { points: count("points", points)? })?;
        Ok(Self { by, points })
    }

    fn __getnewargs__(&self) -> (i64,) {
        (self.points,)
    }

    fn __repr__(&self) -> String {
        format!("SpanByCount({})", self.points)
    }
}

/// A count from Python, where numbers may be negative.
pub(super) fn count(name: &'static str, value: i64) -> Result<usize> {
    usize::try_from(value).map_err(|_| crate::error::Error::parameter(name, value, "a whole number of at least 1"))
}

/// Spans of a duration each, in stream order.
///
/// A new span starts where a point's `gps_time` is `seconds` or more away from that of the span's first point, also
/// backwards: a flight line may be older than the one before it.
///
/// Parameters
/// ----------
/// seconds : float
///     Duration of a span, above 0.
///
/// Raises
/// ------
/// InvalidParameter
///     If the duration is not above 0.
///
/// Examples
/// --------
/// >>> SpanByTime(0.5)
/// SpanByTime(0.5)
#[pyclass(frozen, eq, name = "SpanByTime", module = "streamseg")]
#[derive(Clone, PartialEq)]
pub struct PySpanByTime {
    pub(super) by: SpanBy,
    /// Duration of a span in seconds.
    #[pyo3(get)]
    seconds: f64,
}

#[pymethods]
impl PySpanByTime {
    #[new]
    fn new(seconds: Real) -> PyResult<Self> {
        let seconds = seconds.named("seconds")?;
        Ok(Self { by: valid(SpanBy::Time { seconds })?, seconds })
    }

    fn __getnewargs__(&self) -> (f64,) {
        (self.seconds,)
    }

    fn __repr__(&self) -> String {
        format!("SpanByTime({:?})", self.seconds)
    }
}

/// Spans of a number of scan lines each, in stream order.
///
/// A scan line ends where `scan_direction_flag` changes, or behind points with `edge_of_flight_line`.
///
/// Parameters
/// ----------
/// lines : int
///     Scan lines per span, at least 1.
///
/// Raises
/// ------
/// InvalidParameter
///     If there are no lines in a span.
///
/// Examples
/// --------
/// >>> SpanByScanLine(200)
/// SpanByScanLine(200)
#[pyclass(frozen, eq, name = "SpanByScanLine", module = "streamseg")]
#[derive(Clone, PartialEq)]
pub struct PySpanByScanLine {
    pub(super) by: SpanBy,
    /// Scan lines per span.
    #[pyo3(get)]
    lines: i64,
}

#[pymethods]
impl PySpanByScanLine {
    #[new]
    fn new(lines: Whole) -> PyResult<Self> {
        let lines = lines.named("lines")?;
        let by = valid(SpanBy::ScanLine { lines: count("lines", lines)? })?;
        Ok(Self { by, lines })
    }

    fn __getnewargs__(&self) -> (i64,) {
        (self.lines,)
    }

    fn __repr__(&self) -> String {
        format!("SpanByScanLine({})", self.lines)
    }
}

/// The spans of a stored cloud if nothing else is asked for: 20 times as wide as the segmentor's reach, at least
/// as wide as its halo; if that is not
/// known, wide enough for 100 000 points, where the cloud's number of points and extent along x are known.
#[pyfunction]
pub(super) fn default_spans(
    py: Python<'_>,
    recipe: &PyRecipe,
    points: Option<u64>,
    extent: Option<f64>,
) -> PyResult<Py<PyAny>> {
    let layout = points.zip(extent).map(|(points, extent)| Layout { points, extent });
    match recipe.segmentor.exactness().default_spans(layout) {
        by @ SpanBy::Width { width, .. } => Ok(Py::new(py, PySpanByWidth { by, width })?.into_any()),
        SpanBy::Count { points } => {
            let by = SpanBy::Count { points };
            Ok(Py::new(py, PySpanByCount { by, points: points as i64 })?.into_any())
        }
        SpanBy::Slabs { .. } | SpanBy::Time { .. } | SpanBy::ScanLine { .. } | SpanBy::Given => Ok(py.None()),
    }
}

/// What any of the span classes, or none for spans as given, means to the core.
pub(super) fn span_by(spans: Option<&Bound<'_, PyAny>>) -> PyResult<SpanBy> {
    let Some(spans) = spans else { return Ok(SpanBy::Given) };
    if let Ok(spans) = spans.cast::<PySpanByWidth>() {
        return Ok(spans.get().by);
    }
    if let Ok(spans) = spans.cast::<PySpanByCount>() {
        return Ok(spans.get().by);
    }
    if let Ok(spans) = spans.cast::<PySpanByTime>() {
        return Ok(spans.get().by);
    }
    if let Ok(spans) = spans.cast::<PySpanByScanLine>() {
        return Ok(spans.get().by);
    }
    if let Ok(plan) = spans.cast::<PyPlan>() {
        return Ok(plan.get().plan.spans());
    }
    let given = spans.repr()?;
    Err(InvalidParameter::new_err(format!(
        "spans is {given}, allowed: SpanByWidth, SpanByCount, SpanByTime or SpanByScanLine"
    )))
}

/// How many spans are segmented together, and how many of them two consecutive windows share.
///
/// Parameters
/// ----------
/// spans : int, default 3
///     Spans per window, at least 1.
/// overlap : int, default 1
///     Spans shared with the next window, fewer than `spans`.
///
/// Raises
/// ------
/// InvalidParameter
///     If there is no span in the window, or it would not move on.
///
/// Examples
/// --------
/// >>> Window(3, 1).advance
/// 2
#[pyclass(frozen, eq, name = "Window", module = "streamseg")]
#[derive(Clone, PartialEq)]
pub struct PyWindowSize(pub(super) WindowSize);

#[pymethods]
impl PyWindowSize {
    #[new]
    #[pyo3(signature = (spans = None, overlap = None))]
    fn new(spans: Option<Whole>, overlap: Option<Whole>) -> PyResult<Self> {
        let default = WindowSize::default();
        let spans = spans.map_or(Ok(default.spans()), |spans| spans.count("spans"))?;
        let overlap = overlap.map(|overlap| overlap.named("overlap")).transpose()?;
        let overlap = match overlap {
            Some(overlap) => usize::try_from(overlap)
                .map_err(|_| crate::error::Error::parameter("overlap", overlap, "a whole number of at least 0"))?,
            // A window of one span has none to share.
            None => default.overlap().min(spans.saturating_sub(1)),
        };
        Ok(Self(WindowSize::new(spans, overlap)?))
    }

    /// Spans per window.
    #[getter]
    fn spans(&self) -> usize {
        self.0.spans()
    }

    /// Spans shared with the next window.
    #[getter]
    fn overlap(&self) -> usize {
        self.0.overlap()
    }

    /// By how many spans the window moves on.
    #[getter]
    fn advance(&self) -> usize {
        self.0.advance()
    }

    fn __getnewargs__(&self) -> (usize, usize) {
        (self.0.spans(), self.0.overlap())
    }

    fn __repr__(&self) -> String {
        format!("Window(spans={}, overlap={})", self.0.spans(), self.0.overlap())
    }
}
