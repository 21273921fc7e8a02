//! The pipeline as a Python iterator of spans.

use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError, TryLockError, Weak};
use std::time::Duration;

use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1};
use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;
use pyo3::types::PyTuple;

use super::arrays::{LatticeOf, aligned, chunks_of, lattice_of, read_only, real_positions, rows};
use super::calls::call_named;
use super::errors::{StreamInUse, StreamsegError, guarded};
use super::finalization::PySlabCounts;
use super::home::Home;
use super::numbers::Whole;
use super::plan::PyPlan;
use super::segmentors::PyRecipe;
use super::selection::{Named, Selected, SizeOptions, named, selected};
use super::spans::{PyWindowSize, span_by};
use crate::certificate::Certificate;
use crate::crew::Crew;
use crate::error::Error;
use crate::lattice::Lattice;
use crate::pipeline::{Allowance, Outgoing, Pipeline, Progress, Stopper, WovenWindow};
use crate::revisit::Revisit;
use crate::settlement::{Settled, Settlement};
use crate::span::{Chunk, Source, Span, finalized_spans_of, spans_of};
use crate::weaver::Selection;

/// Streams chunks through spans, windows, segmentor and weaver.
#[pyclass(frozen, name = "Pipeline", module = "streamseg._core")]
pub struct PyPipeline {
    pipeline: Arc<Mutex<Pipeline>>,
    home: Home,
    stopper: Stopper,
    /// The turn that somebody has.
    turn: Mutex<Weak<()>>,
    /// The span given last, until it is acknowledged: an interrupt on its way to the taker must not lose it.
    given: Mutex<Option<Py<PySpan>>>,
    lattice: Lattice,
    sizes: SizeOptions,
    /// The exactness class of the run: "A", "B" or "C".
    #[pyo3(get)]
    exactness: char,
    /// Whether streamed and static are sure to be the same partition.
    #[pyo3(get)]
    is_identical: bool,
    /// Whether spans are cut in the order of the stream, so that none holds all points of its part of the map.
    #[pyo3(get)]
    is_in_stream_order: bool,
    /// One sentence on how the result relates to the static one.
    #[pyo3(get)]
    promise: String,
    /// One sentence, if the spans break the segmentor's condition.
    #[pyo3(get)]
    warning: Option<String>,
    /// The segmentor's name.
    #[pyo3(get)]
    segmentor: String,
}

#[pymethods]
impl PyPipeline {
    #[new]
    #[pyo3(signature = (
        chunks, recipe, spans, window, *, stored, lattice, threads, drop_invalid, on_progress,
        counts = None, brings_back = false, min_segment_size = Whole::of(1), max_segment_size = None, sort = "native",
    ))]
    #[allow(clippy::too_many_arguments)] // one keyword each for Python
    fn new(
        chunks: &Bound<'_, PyAny>,
        recipe: &PyRecipe,
        spans: Option<&Bound<'_, PyAny>>,
        window: &PyWindowSize,
        stored: bool,
        lattice: LatticeOf,
        threads: usize,
        drop_invalid: bool,
        on_progress: Option<Py<PyAny>>,
        counts: Option<&PySlabCounts>,
        brings_back: bool,
        min_segment_size: Whole,
        max_segment_size: Option<Whole>,
        sort: &str,
    ) -> PyResult<Self> {
        let max = max_segment_size.map(|max| max.named("max_segment_size")).transpose()?;
        let sizes = SizeOptions::new(min_segment_size.named("min_segment_size")?, max, sort)?;
        let segmentor = Arc::clone(&recipe.segmentor);
        let plan = spans.and_then(|spans| spans.cast::<PyPlan>().ok());
        let by = span_by(spans)?;
        let lattice = lattice_of(lattice)?;
        let source = if stored { Source::Stored } else { Source::Live };
        let names: Vec<String> = by.attributes().iter().map(ToString::to_string).chain(segmentor.reads()).collect();
        let (home, stopper) = (Home::of("the stream"), Stopper::default());
        let chunks = heeding_interrupts(chunks_of(chunks, names.clone(), drop_invalid)?, stopper.clone());
        let exactness = segmentor.exactness();
        let is_in_stream_order = counts.is_none() && !by.is_in_space();
        let mut assessment = match counts {
            Some(PySlabCounts(counts)) => exactness.assess(counts.by(), window.0, &lattice).finalized(),
            None if brings_back => exactness.assess_bringing_back(),
            None => exactness.assess(by, window.0, &lattice),
        };
        let spans = match counts {
            // Not stopped between two chunks: its slabs would be as if it had changed since they were counted.
            Some(PySlabCounts(counts)) => finalized_spans_of(chunks, by, &lattice, counts)?,
            None => spans_of(stopper.until_asked(chunks), by, &lattice, source)?,
        };
        let crew = Crew::new(threads)?;
        let name = segmentor.name().to_string();
        let mut pipeline = Pipeline::new(spans, lattice, segmentor, window.0, crew)
            .with_attributes(names)
            .with_stopper(stopper.clone())
            .with_look_up(move |progress| look_up(home, progress, on_progress.as_ref()));
        if pipeline.looks_again() {
            assessment = assessment.with_second_looks();
        }
        if let Some(plan) = plan {
            let (bytes, per_point) = plan.get().plan.at_work();
            pipeline = pipeline.with_allowance(Allowance::new(bytes, per_point));
        }
        if brings_back {
            pipeline = pipeline.with_revisit(Revisit::new(exactness, lattice)?);
        }
        Ok(Self {
            pipeline: Arc::new(Mutex::new(pipeline)),
            home,
            stopper,
            turn: Mutex::default(),
            given: Mutex::new(None),
            lattice,
            sizes,
            exactness: assessment.class,
            is_identical: assessment.is_identical,
            is_in_stream_order,
            promise: assessment.sentence,
            warning: assessment.warning,
            segmentor: name,
        })
    }

    fn __iter__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    /// The turn to take spans, which one can have at a time; given back when it is left, or nobody has it any more.
    fn turn(&self) -> PyResult<PyTurn> {
        self.home.check()?;
        let mut turn = self.turn.lock().unwrap_or_else(PoisonError::into_inner);
        if turn.strong_count() > 0 {
            return Err(in_use());
        }
        let taken = Arc::new(());
        *turn = Arc::downgrade(&taken);
        Ok(PyTurn(Mutex::new(Some(taken))))
    }

    /// The next span; the same again until it is acknowledged. For whoever has the turn.
    fn __next__(&self, py: Python<'_>) -> PyResult<Option<Py<PySpan>>> {
        self.home.check()?;
        if let Some(span) = self.given().as_ref() {
            return Ok(Some(span.clone_ref(py)));
        }
        let Some(outgoing) = guarded(py, || Ok(self.own()?.next().transpose()?))? else {
            return Ok(None);
        };
        let span = Py::new(py, PySpan::new(py, outgoing, self.lattice)?)?;
        *self.given() = Some(span.clone_ref(py));
        Ok(Some(span))
    }

    /// Tells that the last span has arrived.
    fn acknowledge(&self) {
        *self.given() = None;
    }

    /// Whether nothing more will come: no span and no failure.
    fn is_ended(&self, py: Python<'_>) -> PyResult<bool> {
        let ended = py.detach(|| self.lock().map(|pipeline| pipeline.is_ended()))?;
        Ok(ended && self.given().is_none())
    }

    /// Whether the run has ended, and all that the source had was segmented.
    fn is_whole(&self, py: Python<'_>) -> PyResult<bool> {
        py.detach(|| self.lock().map(|pipeline| pipeline.is_whole()))
    }

    /// Asks the source for no further span; those that have come are still segmented and come out, as far as that takes
    /// no more than so many seconds. From any thread at any time.
    #[pyo3(signature = (patience = None))]
    fn stop(&self, patience: Option<f64>) {
        if self.home.is_here() {
            self.stopper.stop(patience.and_then(|seconds| Duration::try_from_secs_f64(seconds).ok()));
        }
    }

    /// Whether this is the process that it was made in, and not one forked from that.
    fn is_at_home(&self) -> bool {
        self.home.is_here()
    }

    /// The fewest points of a segment that final results keep.
    #[getter]
    fn min_segment_size(&self) -> u64 {
        self.sizes.limits.min()
    }

    /// The most points of a segment that final results keep.
    #[getter]
    fn max_segment_size(&self) -> Option<u64> {
        self.sizes.limits.max()
    }

    /// How final results are numbered: "native", "ascending" or "descending".
    #[getter]
    fn sort(&self) -> &'static str {
        self.sizes.sort.name()
    }

    /// Turns raw or carried ids, (n,) int64, into final ids; after the end. With limits, what they leave out becomes −1.
    fn resolve<'py>(
        &self,
        py: Python<'py>,
        ids: PyReadonlyArray1<'py, i64>,
        limits: bool,
    ) -> PyResult<Bound<'py, PyArray1<i64>>> {
        let mut ids: Vec<i64> = aligned(&ids)?.as_array().iter().copied().collect();
        guarded(py, || {
            let mut pipeline = self.lock()?;
            let log = pipeline.aliases();
            let selection = if limits { self.sizes.select(log)? } else { Selection::default() };
            Ok(log.resolve(&mut ids, &selection)?)
        })?;
        Ok(ids.into_pyarray(py))
    }

    /// Makes the ids of a settlement final; after the end. Returns how many segments are kept; how many are left out, by
    /// cause; and how many points those have.
    fn settle(&self, py: Python<'_>, settlement: &PySettlement) -> PyResult<Selected> {
        guarded(py, || {
            let mut pipeline = self.lock()?;
            let selection = self.sizes.select(pipeline.aliases())?;
            settlement.lock()?.settle(pipeline.aliases(), &selection)?;
            Ok(selected(&selection))
        })
    }

    /// How far the run is: the fields of `streamseg.Progress`.
    fn progress(&self, py: Python<'_>) -> PyResult<ProgressTuple> {
        py.detach(|| self.lock().map(|pipeline| tuple(&pipeline.progress())))
    }

    /// What the run could prove so far: the fields of `streamseg.Certificate`.
    fn certificate(&self, py: Python<'_>) -> PyResult<CertificateTuple> {
        py.detach(|| self.lock().map(|pipeline| certificate_tuple(&pipeline.certificate())))
    }

    /// Entries of the point-segment and of the segment-segment table, counted one by one.
    fn live_entries(&self, py: Python<'_>) -> PyResult<(usize, usize)> {
        py.detach(|| self.lock().map(|pipeline| (pipeline.weaver().live_points(), pipeline.weaver().live_segments())))
    }
}

impl PyPipeline {
    /// Never held across a call into Python.
    fn given(&self) -> MutexGuard<'_, Option<Py<PySpan>>> {
        self.given.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A short look, unless the stream is at work. To be called without the interpreter, which the pipeline may need while it
    /// holds the lock.
    fn lock(&self) -> PyResult<MutexGuard<'_, Pipeline>> {
        self.home.check()?;
        for _ in 0..PATIENCE_WITH_LOOKS {
            match self.pipeline.try_lock() {
                Ok(pipeline) => return Ok(pipeline),
                Err(TryLockError::Poisoned(_)) => return Err(defect()),
                // Another thread may have a short look, too.
                Err(TryLockError::WouldBlock) => std::thread::sleep(Duration::from_millis(1)),
            }
        }
        Err(in_use())
    }

    /// For whoever has the turn: all others have short looks at most. To be called without the interpreter.
    fn own(&self) -> PyResult<MutexGuard<'_, Pipeline>> {
        self.pipeline.lock().map_err(|_| defect())
    }
}

impl Drop for PyPipeline {
    fn drop(&mut self) {
        self.home.keep_elsewhere(&self.pipeline);
    }
}

/// For how long windows under way are waited for after an interrupt has struck inside the source: as long as if it had
/// struck elsewhere.
const PATIENCE_AFTER_INTERRUPT: Duration = Duration::from_secs(1);

/// The chunks of a source; an interrupt that strikes inside it is no failure of the source, after which all that has come
/// would still be segmented.
fn heeding_interrupts(
    chunks: impl Iterator<Item = Result<Chunk, Error>> + Send,
    stopper: Stopper,
) -> impl Iterator<Item = Result<Chunk, Error>> + Send {
    chunks.inspect(move |chunk| {
        if chunk.as_ref().is_err_and(is_interrupt) {
            stopper.stop(Some(PATIENCE_AFTER_INTERRUPT));
        }
    })
}

fn is_interrupt(error: &Error) -> bool {
    let Error::Foreign(foreign) = error else { return false };
    let Some(exception) = foreign.downcast_ref::<PyErr>() else { return false };
    Python::attach(|py| exception.is_instance_of::<PyKeyboardInterrupt>(py))
}

/// For how many milliseconds a short look waits for another.
const PATIENCE_WITH_LOOKS: usize = 20;

fn in_use() -> PyErr {
    StreamInUse::new_err(
        "the stream is at work already, in another thread or in its own source; take spans from one place",
    )
}

fn defect() -> PyErr {
    StreamsegError::new_err("the stream has come to a stop by a defect; nothing more comes out")
}

/// The turn to take spans: for a `with` block. An interrupt between any two steps leaves no turn behind.
#[pyclass(frozen, name = "Turn", module = "streamseg._core")]
pub struct PyTurn(Mutex<Option<Arc<()>>>);

#[pymethods]
impl PyTurn {
    fn __enter__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    #[pyo3(signature = (*_args))]
    fn __exit__(&self, _args: &Bound<'_, PyTuple>) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = None;
    }
}

/// Points out, windows woven, segments in scope, raw segment ids given, segments as far as is known, seconds of weaving.
type ProgressTuple = (u64, u64, usize, i64, i64, f64);

fn tuple(progress: &Progress) -> ProgressTuple {
    (
        progress.points,
        progress.windows,
        progress.live_segments,
        progress.segment_ids,
        progress.segments,
        progress.weaving.as_secs_f64(),
    )
}

/// Edges decided and undecided, points decided and undecided, points returned, points that waited, early decisions, the
/// most points that waited at the same time.
type CertificateTuple = (u64, u64, u64, u64, u64, u64, u64, u64);

fn certificate_tuple(certificate: &Certificate) -> CertificateTuple {
    (
        certificate.decided_edges,
        certificate.undecided_edges,
        certificate.decided_points,
        certificate.undecided_points,
        certificate.returned_points,
        certificate.waited_points,
        certificate.early_decisions,
        certificate.most_waiting,
    )
}

pub(super) fn look_up(home: Home, progress: &Progress, on_progress: Option<&Py<PyAny>>) -> Result<(), Error> {
    home.check()?;
    Python::attach(|py| -> PyResult<()> {
        call_named(py, "a signal's handler", || py.check_signals())?;
        let Some(on_progress) = on_progress else { return Ok(()) };
        call_named(py, "on_progress", || on_progress.call1(py, (tuple(progress),)).map(drop))
    })
    .map_err(Error::from)
}

/// A span that went out of scope.
#[pyclass(frozen, name = "Span", module = "streamseg")]
pub struct PySpan {
    span: Arc<Span>,
    lattice: Lattice,
    points: OnceLock<Py<PyArray2<f64>>>,
    /// Number of the span, from 0.
    #[pyo3(get)]
    index: u64,
    /// The point ids, (n,) int64, ascending.
    #[pyo3(get)]
    point_ids: Py<PyArray1<i64>>,
    /// The raw segment id of each point, (n,) int64.
    #[pyo3(get)]
    raw_ids: Py<PyArray1<i64>>,
    /// The carried segment id of each point, (n,) int64.
    #[pyo3(get)]
    carried_ids: Py<PyArray1<i64>>,
    /// Late joins since the last span, (m, 2) int64: an id that was handed out, and the smaller one it has become.
    #[pyo3(get)]
    aliases: Py<PyArray2<i64>>,
    /// The segments that went with the span, (m, 4) int64: segment, next segment, window, shared points.
    #[pyo3(get)]
    segments: Py<PyArray2<i64>>,
    /// How many of the last rows are late joins of segments that had gone before.
    #[pyo3(get)]
    late_joins: usize,
    /// The segments without a seed of the windows woven since the last span, (m,) int64.
    #[pyo3(get)]
    seedless: Py<PyArray1<i64>>,
    /// The windows woven since the last span, (m, 12) int64: the columns of the history's table.
    #[pyo3(get)]
    windows: Py<PyArray2<i64>>,
    /// How many points have no segment, by cause.
    #[pyo3(get)]
    unlabelled: Named,
    settles_at: u64,
}

fn window_row(woven: &WovenWindow) -> [i64; 12] {
    let [index, first_span] = [woven.index, woven.first_span].map(|n| n as i64);
    let [spans, points, segments] = [woven.spans, woven.points, woven.segments].map(|n| n as i64);
    let tally = woven.tally;
    let [decided_edges, waiting_edges] = [tally.decided_edges, tally.waiting_edges].map(|n| n as i64);
    let [decided_points, waiting_points] = [tally.decided_points, tally.waiting_points].map(|n| n as i64);
    let [returned_points, early_decisions] = [tally.returned_points, tally.early_decisions].map(|n| n as i64);
    [
        index,
        first_span,
        spans,
        points,
        woven.first_segment_id,
        segments,
        decided_edges,
        waiting_edges,
        decided_points,
        waiting_points,
        returned_points,
        early_decisions,
    ]
}

impl PySpan {
    fn new(py: Python<'_>, Outgoing { span, segmented, windows }: Outgoing, lattice: Lattice) -> PyResult<Self> {
        let point_ids: Vec<i64> = (0..span.len()).map(|position| span.point_id(position)).collect();
        let segments = segmented.segments.iter();
        let segments = segments.map(|s| [s.segment_id, s.next_segment_id, s.window, s.shared_points as i64]).collect();
        Ok(Self {
            span,
            lattice,
            points: OnceLock::new(),
            index: segmented.index,
            point_ids: point_ids.into_pyarray(py).unbind(),
            raw_ids: segmented.raw_ids.into_pyarray(py).unbind(),
            carried_ids: segmented.carried_ids.into_pyarray(py).unbind(),
            aliases: rows(py, segmented.aliases)?.unbind(),
            segments: rows(py, segments)?.unbind(),
            late_joins: segmented.late_joins,
            seedless: segmented.seedless.into_pyarray(py).unbind(),
            unlabelled: named(&segmented.unlabelled),
            windows: rows(py, windows.iter().map(window_row).collect())?.unbind(),
            settles_at: segmented.settles_at,
        })
    }
}

#[pymethods]
impl PySpan {
    /// Real coordinates, (n, 3) float64, not writable.
    #[getter]
    fn points(&self, py: Python<'_>) -> PyResult<Py<PyArray2<f64>>> {
        if let Some(points) = self.points.get() {
            return Ok(points.clone_ref(py));
        }
        let points = real_positions(py, &self.span.points, &self.lattice)?;
        read_only(points.as_any())?;
        Ok(self.points.get_or_init(|| points.unbind()).clone_ref(py))
    }

    fn __len__(&self) -> usize {
        self.span.len()
    }

    fn __repr__(&self) -> String {
        format!("Span(index={}, points={})", self.index, self.span.len())
    }
}

/// Keeps spans on disk until their ids are final, then gives them back in order.
#[pyclass(frozen, name = "Settlement", module = "streamseg._core")]
pub struct PySettlement {
    settlement: Mutex<Settlement>,
    home: Home,
    with_points: bool,
    lattice: Lattice,
}

#[pymethods]
impl PySettlement {
    #[new]
    #[pyo3(signature = (*, lattice = None, with_points = true))]
    fn new(lattice: LatticeOf, with_points: bool) -> PyResult<Self> {
        let lattice = lattice_of(lattice)?;
        Ok(Self { settlement: Mutex::default(), home: Home::of("the stream"), with_points, lattice })
    }

    /// Keeps a span of a pipeline.
    fn keep(&self, py: Python<'_>, span: &PySpan) -> PyResult<()> {
        let (point_ids, carried) = (span.point_ids.bind(py).readonly(), span.carried_ids.bind(py).readonly());
        let (point_ids, carried) = (point_ids.as_slice()?, carried.as_slice()?);
        let positions: &[[f64; 3]] = if self.with_points { &span.span.points } else { &[] };
        Ok(self.lock()?.keep(span.index, point_ids, carried, positions, span.settles_at)?)
    }

    /// Keeps ids that a replay carried.
    fn keep_ids(
        &self,
        index: u64,
        point_ids: PyReadonlyArray1<'_, i64>,
        carried_ids: PyReadonlyArray1<'_, i64>,
        settles_at: u64,
    ) -> PyResult<()> {
        Ok(self.lock()?.keep(index, point_ids.as_slice()?, carried_ids.as_slice()?, &[], settles_at)?)
    }

    fn __iter__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    fn __next__(&self, py: Python<'_>) -> PyResult<Option<PySettled>> {
        match guarded(py, || Ok(self.lock()?.next().transpose()?))? {
            Some(settled) => PySettled::new(py, settled, &self.lattice).map(Some),
            None => Ok(None),
        }
    }
}

impl PySettlement {
    pub(super) fn lock(&self) -> PyResult<MutexGuard<'_, Settlement>> {
        self.home.check()?;
        Ok(self.settlement.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// A span whose ids are final.
#[pyclass(frozen, name = "SettledSpan", module = "streamseg")]
pub struct PySettled {
    /// Number of the span, from 0.
    #[pyo3(get)]
    index: u64,
    /// Real coordinates, (n, 3) float64; empty where they were not kept.
    #[pyo3(get)]
    points: Py<PyArray2<f64>>,
    /// The point ids, (n,) int64, ascending.
    #[pyo3(get)]
    point_ids: Py<PyArray1<i64>>,
    /// The final segment id of each point, (n,) int64.
    #[pyo3(get)]
    segment_ids: Py<PyArray1<i64>>,
}

impl PySettled {
    fn new(py: Python<'_>, settled: Settled, lattice: &Lattice) -> PyResult<Self> {
        Ok(Self {
            index: settled.index,
            points: real_positions(py, &settled.positions, lattice)?.unbind(),
            point_ids: settled.point_ids.into_pyarray(py).unbind(),
            segment_ids: settled.segment_ids.into_pyarray(py).unbind(),
        })
    }
}
