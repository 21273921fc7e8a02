//! What a survey finds out, as Python iterators: thinned clouds, and features window by window.

use std::sync::{Arc, Mutex, TryLockError};

use numpy::{IntoPyArray, PyArray1, PyArray2};
use pyo3::prelude::*;

use super::arrays::{LatticeOf, chunks_of, lattice_of, real_positions};
use super::calls::call_named;
use super::errors::{StreamInUse, StreamsegError, guarded};
use super::features::feature;
use super::home::Home;
use super::numbers::Whole;
use super::preprocessing::stages;
use super::searches::search;
use super::spans::span_by;
use crate::crew::Crew;
use crate::error::Error;
use crate::features::{Feature, Fit, compute};
use crate::lattice::Lattice;
use crate::neighborhood::Search;
use crate::preprocessing::{apply_all, total_halo};
use crate::span::{Source, Spans, spans_of};
use crate::survey::{OwnIds, Survey};
use crate::window::{Halo, Window};

/// Where the points of a survey come from, and what lattice they lie on.
pub(super) struct Cloud {
    pub(super) spans: Spans,
    pub(super) lattice: Lattice,
}

impl Cloud {
    /// The cloud of Python's chunks, cut into `spans`.
    pub(super) fn new(
        chunks: &Bound<'_, PyAny>,
        spans: Option<&Bound<'_, PyAny>>,
        stored: bool,
        lattice: LatticeOf,
        drop_invalid: bool,
    ) -> PyResult<Self> {
        let by = span_by(spans)?;
        let lattice = lattice_of(lattice)?;
        let source = if stored { Source::Stored } else { Source::Live };
        let names = by.attributes().iter().map(ToString::to_string).collect();
        let chunks = chunks_of(chunks, names, drop_invalid)?;
        Ok(Self { spans: spans_of(chunks, by, &lattice, source)?, lattice })
    }
}

/// The halo of so many units of the coordinates.
fn halo(length: f64) -> Halo {
    match length {
        0.0 => Halo::None,
        f64::INFINITY => Halo::SpanBeyond(0.0),
        length => Halo::Length(length),
    }
}

/// Lets Python interrupt a survey, which goes on in its own process only.
pub(super) fn signals(home: Home) -> Result<(), Error> {
    home.check()?;
    Python::attach(|py| Ok(call_named(py, "a signal's handler", || py.check_signals())?))
}

/// The points of a span that stand for the cloud's.
struct ThinnedSpan {
    index: u64,
    points: Vec<[f64; 3]>,
    point_ids: Vec<i64>,
    count: usize,
}

/// Thins a cloud, span by span.
#[pyclass(frozen, name = "Thinning", module = "streamseg._core")]
pub struct PyThinning(Surveyor<ThinnedSpan>);

#[pymethods]
impl PyThinning {
    #[new]
    #[pyo3(signature = (chunks, stages, spans, *, stored, lattice, threads, drop_invalid))]
    #[allow(clippy::too_many_arguments)] // one keyword each for Python
    fn new(
        chunks: &Bound<'_, PyAny>,
        stages: &Bound<'_, PyAny>,
        spans: Option<&Bound<'_, PyAny>>,
        stored: bool,
        lattice: LatticeOf,
        threads: usize,
        drop_invalid: bool,
    ) -> PyResult<Self> {
        let stages = self::stages(stages)?;
        let Cloud { spans, lattice } = Cloud::new(chunks, spans, stored, lattice, drop_invalid)?;
        let crew = if stages.iter().all(|stage| stage.is_concurrent()) { Crew::new(threads)? } else { Crew::of_one() };
        let halo = halo(total_halo(&stages));
        let thin = move |window: &Window| {
            let thinned = apply_all(&stages, window)?.window;
            let own = OwnIds::of(window);
            let mut kept: Vec<usize> =
                (0..thinned.points().len()).filter(|&i| own.contains(thinned.point_ids()[i])).collect();
            kept.sort_by_key(|&i| thinned.point_ids()[i]);
            Ok(ThinnedSpan {
                index: window.index(),
                points: kept.iter().map(|&i| thinned.lattice().real(&thinned.points()[i])).collect(),
                point_ids: kept.iter().map(|&i| thinned.point_ids()[i]).collect(),
                count: window.own().len(),
            })
        };
        let survey = Survey::new(spans, lattice, vec![], halo, crew, Arc::new(thin))?;
        Ok(Self(Surveyor::new(survey)))
    }

    fn __iter__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    fn __next__(&self, py: Python<'_>) -> PyResult<Option<PyThinnedSpan>> {
        let Some(ThinnedSpan { index, points, point_ids, count }) = self.0.next(py)? else { return Ok(None) };
        Ok(Some(PyThinnedSpan {
            index,
            points: real_positions(py, &points, &Lattice::REAL)?.unbind(),
            point_ids: point_ids.into_pyarray(py).unbind(),
            count,
        }))
    }
}

/// A survey that belongs to the process that it was made in.
struct Surveyor<R> {
    survey: Arc<Mutex<Survey<R>>>,
    home: Home,
}

impl<R: Send + 'static> Surveyor<R> {
    fn new(survey: Survey<R>) -> Self {
        let home = Home::of("the survey");
        Self { survey: Arc::new(Mutex::new(survey.with_look_up(move || signals(home)))), home }
    }

    /// The next of the survey, without the interpreter, which its source may need.
    fn next(&self, py: Python<'_>) -> PyResult<Option<R>> {
        self.home.check()?;
        guarded(py, || match self.survey.try_lock() {
            Ok(mut survey) => Ok(survey.next().transpose()?),
            Err(TryLockError::Poisoned(_)) => {
                Err(StreamsegError::new_err("the survey has come to a stop by a defect; nothing more comes out"))
            }
            Err(TryLockError::WouldBlock) => Err(StreamInUse::new_err(
                "the survey is at work already, in another thread or in its own source; take spans from one place",
            )),
        })
    }
}

impl<R> Drop for Surveyor<R> {
    fn drop(&mut self) {
        self.home.keep_elsewhere(&self.survey);
    }
}

/// A span of a cloud that has been thinned.
#[pyclass(frozen, name = "ThinnedSpan", module = "streamseg")]
pub struct PyThinnedSpan {
    /// Number of the span, from 0.
    #[pyo3(get)]
    index: u64,
    /// Real coordinates of the points that stay or stand for others, (m, 3) float64.
    #[pyo3(get)]
    points: Py<PyArray2<f64>>,
    /// Their point ids, (m,) int64, ascending.
    #[pyo3(get)]
    point_ids: Py<PyArray1<i64>>,
    /// How many points the span had.
    #[pyo3(get)]
    count: usize,
}

#[pymethods]
impl PyThinnedSpan {
    fn __len__(&self, py: Python<'_>) -> usize {
        use numpy::PyUntypedArrayMethods;
        self.point_ids.bind(py).len()
    }

    fn __repr__(&self, py: Python<'_>) -> String {
        format!("ThinnedSpan(index={}, points={})", self.index, self.__len__(py))
    }
}

/// Features of a window's own points.
struct Found {
    point_ids: Vec<i64>,
    columns: Vec<Vec<f64>>,
    undecided: usize,
}

/// Computes features, span by span.
#[pyclass(frozen, name = "FeatureSurvey", module = "streamseg._core")]
pub struct PyFeatureSurvey(Surveyor<Found>);

#[pymethods]
impl PyFeatureSurvey {
    #[new]
    #[pyo3(signature = (chunks, names, spans, *, k, search_radius, search_mode, normals, stored, lattice, threads))]
    #[allow(clippy::too_many_arguments)] // one keyword each for Python
    fn new(
        chunks: &Bound<'_, PyAny>,
        names: Vec<String>,
        spans: Option<&Bound<'_, PyAny>>,
        k: Option<Whole>,
        search_radius: Option<&Bound<'_, PyAny>>,
        search_mode: &str,
        normals: &str,
        stored: bool,
        lattice: LatticeOf,
        threads: usize,
    ) -> PyResult<Self> {
        let wanted = names.iter().map(|name| feature(name)).collect::<PyResult<Vec<Feature>>>()?;
        let k = k.map(|k| k.named("k")).transpose()?;
        let search = search(k, search_radius, search_mode)?;
        let fit: Fit = normals.parse()?;
        let Cloud { spans, lattice } = Cloud::new(chunks, spans, stored, lattice, false)?;
        let look = move |window: &Window| Ok(features_of(window, search, fit, &wanted));
        let survey = Survey::new(spans, lattice, vec![], halo(search.reach()), Crew::new(threads)?, Arc::new(look))?;
        Ok(Self(Surveyor::new(survey)))
    }

    fn __iter__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    fn __next__(&self, py: Python<'_>) -> PyResult<Option<PyFeatures>> {
        let Some(Found { point_ids, columns, undecided }) = self.0.next(py)? else { return Ok(None) };
        Ok(Some(PyFeatures {
            point_ids: point_ids.into_pyarray(py).unbind(),
            columns: columns.into_iter().map(|column| column.into_pyarray(py).unbind()).collect(),
            undecided,
        }))
    }
}

/// A value is given only if all that it depends on has been loaded.
fn features_of(window: &Window, search: Search, fit: Fit, wanted: &[Feature]) -> Found {
    let all = compute(window.points(), window.point_ids(), window.lattice(), search, fit, wanted);
    let own = OwnIds::of(window);
    let own: Vec<usize> = (0..window.points().len()).filter(|&i| own.contains(window.point_ids()[i])).collect();
    let is_final: Vec<bool> = own.iter().map(|&i| window.holds(&window.points()[i], all.support[i])).collect();
    let of_own = |column: &Vec<f64>| {
        own.iter().zip(&is_final).map(|(&i, &is_final)| if is_final { column[i] } else { f64::NAN }).collect()
    };
    Found {
        point_ids: own.iter().map(|&i| window.point_ids()[i]).collect(),
        columns: all.columns.iter().map(of_own).collect(),
        undecided: is_final.iter().filter(|is_final| !**is_final).count(),
    }
}

/// Features of the points of a span.
#[pyclass(frozen, name = "SpanFeatures", module = "streamseg._core")]
pub struct PyFeatures {
    /// The point ids, (n,) int64.
    #[pyo3(get)]
    point_ids: Py<PyArray1<i64>>,
    /// One (n,) float64 array per feature.
    #[pyo3(get)]
    columns: Vec<Py<PyArray1<f64>>>,
    /// How many points have no value because their neighbors were not all loaded.
    #[pyo3(get)]
    undecided: usize,
}
