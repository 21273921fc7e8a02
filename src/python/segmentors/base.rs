//! What all built-in segmentors are to Python people: values, told apart by what they were made with.

use std::collections::hash_map::DefaultHasher;
use std::hash::{Hash, Hasher};
use std::str::FromStr;
use std::sync::Arc;

use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use pyo3::{IntoPyObjectExt, exceptions::PyTypeError};

use crate::expression::Filter;
use crate::features::Fit;
use crate::python::errors::InvalidParameter;
use crate::python::numbers::Whole;
use crate::segmentor::Segmentor;
use crate::size::{SizeLimits, Sort};

/// The base of all segmentors that come with streamseg, with the options that they all have.
///
/// Parameters
/// ----------
/// min_segment_size : int
///     Segments with fewer points come out as -1 in final results; carried and raw ids keep them.
/// max_segment_size : int, optional
///     Segments with more points come out as -1 in final results.
/// filter : str, optional
///     Expression that says which points take part; the others come out as -1.
/// seed_filter : str, optional
///     Expression that says which points may be the first of a segment; segments without such a point come out as -1.
/// sort : {"native", "ascending", "descending"}, default "native"
///     Whether final segments are numbered anew by size.
/// normals : {"least_squares", "robust"}, default "least_squares"
///     How planes are fitted where features are computed.
#[pyclass(frozen, subclass, name = "Segmentor", module = "streamseg")]
pub struct PySegmentor {
    pub(in super::super) core: Arc<dyn Segmentor>,
    pub(in super::super) options: Options,
    /// What it was made with, by name, in the order of the constructor: always shown.
    arguments: Py<PyDict>,
    /// The options that differ from what they are anyway.
    given: Py<PyDict>,
}

/// What every segmentor can be told beside its own parameters.
#[derive(Clone)]
pub struct Options {
    pub(in super::super) limits: SizeLimits,
    pub(in super::super) sort: Sort,
    pub(in super::super) filter: Option<Filter>,
    pub(in super::super) seed_filter: Option<Filter>,
    pub(in super::super) fit: Fit,
}

/// The options' names, in the order in which they are shown.
const OPTIONS: [&str; 6] = ["min_segment_size", "max_segment_size", "filter", "seed_filter", "sort", "normals"];

impl Options {
    /// No option at all.
    pub(super) fn none() -> Self {
        let (limits, sort) = (SizeLimits::default(), Sort::default());
        Self { limits, sort, filter: None, seed_filter: None, fit: Fit::default() }
    }

    /// Reads keyword arguments of a constructor.
    fn read(given: &Bound<'_, PyDict>, class: &str, smallest: usize) -> PyResult<Self> {
        for name in given.keys() {
            let name = name.to_string();
            if !OPTIONS.contains(&name.as_str()) {
                return Err(PyTypeError::new_err(format!("{class}() has no keyword argument '{name}'")));
            }
        }
        let size = |name| given.get_item(name)?.map(|size| count(name, &size)).transpose();
        let text = |name: &str| -> PyResult<Option<String>> {
            given.get_item(name)?.filter(|text| !text.is_none()).map(|text| text.extract()).transpose()
        };
        let min = size("min_segment_size")?.flatten().unwrap_or(smallest);
        Ok(Self {
            limits: SizeLimits::new(min, size("max_segment_size")?.flatten())?,
            sort: text("sort")?.map_or(Ok(Sort::default()), |sort| Sort::from_str(&sort))?,
            filter: text("filter")?.map(|filter| Filter::parse(&filter)).transpose()?,
            seed_filter: text("seed_filter")?.map(|filter| Filter::parse(&filter)).transpose()?,
            fit: text("normals")?.map_or(Ok(Fit::default()), |fit| Fit::from_str(&fit))?,
        })
    }

    /// All of them by name, in the order in which they are shown.
    fn values(&self, py: Python<'_>) -> PyResult<[(&'static str, Py<PyAny>); 6]> {
        let text = |filter: &Option<Filter>| value(py, filter.as_ref().map(Filter::text));
        Ok([
            ("min_segment_size", value(py, self.limits.min())?),
            ("max_segment_size", value(py, self.limits.max())?),
            ("filter", text(&self.filter)?),
            ("seed_filter", text(&self.seed_filter)?),
            ("sort", value(py, self.sort.name())?),
            ("normals", value(py, self.fit.name())?),
        ])
    }
}

/// A count from Python, where numbers may be negative; none for None.
fn count(name: &'static str, value: &Bound<'_, PyAny>) -> PyResult<Option<usize>> {
    if value.is_none() {
        return Ok(None);
    }
    Ok(Some(value.extract::<Whole>()?.count(name)?))
}

impl PySegmentor {
    /// The base of a segmentor of `class`: `arguments` are its own parameters, `given` the options, `smallest` the
    /// least size of a segment unless the options say otherwise.
    pub(in super::super) fn new(
        core: impl Segmentor + 'static,
        class: &'static str,
        arguments: Bound<'_, PyDict>,
        given: Option<&Bound<'_, PyDict>>,
        smallest: usize,
    ) -> PyResult<Self> {
        let py = arguments.py();
        let usual = Options::read(&PyDict::new(py), class, smallest)?;
        let options = given.map_or_else(|| Ok(usual.clone()), |given| Options::read(given, class, smallest))?;
        let given = PyDict::new(py);
        for ((name, value), (_, usual)) in options.values(py)?.into_iter().zip(usual.values(py)?) {
            if !value.bind(py).eq(usual)? {
                given.set_item(name, value)?;
            }
        }
        Ok(Self { core: Arc::new(core), options, arguments: arguments.unbind(), given: given.unbind() })
    }

    fn everything<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let all = self.arguments.bind(py).copy()?;
        all.update(self.given.bind(py).as_mapping())?;
        Ok(all)
    }
}

#[pymethods]
impl PySegmentor {
    /// Fewest points of a segment that is kept in final results.
    #[getter]
    fn min_segment_size(&self) -> u64 {
        self.options.limits.min()
    }

    /// Most points of a segment that is kept in final results; None = any number.
    #[getter]
    fn max_segment_size(&self) -> Option<u64> {
        self.options.limits.max()
    }

    /// Expression that says which points take part.
    #[getter]
    fn filter(&self) -> Option<&str> {
        self.options.filter.as_ref().map(Filter::text)
    }

    /// Expression that says which points may be the first of a segment.
    #[getter]
    fn seed_filter(&self) -> Option<&str> {
        self.options.seed_filter.as_ref().map(Filter::text)
    }

    /// Whether final segments are numbered anew by size: "native", "ascending" or "descending".
    #[getter]
    fn sort(&self) -> &'static str {
        self.options.sort.name()
    }

    /// How planes are fitted where features are computed: "least_squares" or "robust".
    #[getter]
    fn normals(&self) -> &'static str {
        self.options.fit.name()
    }

    fn __repr__(slf: &Bound<'_, Self>) -> PyResult<String> {
        let (py, class) = (slf.py(), slf.get_type().name()?);
        let mut shown = Vec::new();
        for (name, value) in slf.get().everything(py)? {
            let value = value.repr()?;
            // The first says what it is all about, so it goes without its name.
            shown.push(if shown.is_empty() { value.to_string() } else { format!("{name}={value}") });
        }
        Ok(format!("{class}({})", shown.join(", ")))
    }

    fn __eq__(slf: &Bound<'_, Self>, other: &Bound<'_, PyAny>) -> PyResult<bool> {
        let Ok(same) = other.cast::<Self>() else { return Ok(false) };
        let py = slf.py();
        Ok(slf.get_type().is(other.get_type()) && slf.get().everything(py)?.eq(same.get().everything(py)?)?)
    }

    fn __hash__(slf: &Bound<'_, Self>) -> PyResult<u64> {
        let mut hasher = DefaultHasher::new();
        Self::__repr__(slf)?.hash(&mut hasher);
        Ok(hasher.finish())
    }

    fn __getnewargs_ex__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyTuple>, Bound<'py, PyDict>)> {
        Ok((PyTuple::empty(py), self.everything(py)?))
    }
}

/// Parameters by name, in order.
pub(in super::super) fn arguments<'py, const N: usize>(
    py: Python<'py>,
    values: [(&str, Py<PyAny>); N],
) -> PyResult<Bound<'py, PyDict>> {
    let arguments = PyDict::new(py);
    for (name, value) in values {
        arguments.set_item(name, value)?;
    }
    Ok(arguments)
}

/// A parameter as Python has it.
pub(in super::super) fn value<'py>(py: Python<'py>, value: impl IntoPyObjectExt<'py>) -> PyResult<Py<PyAny>> {
    value.into_py_any(py)
}

/// A search as it was given: `search_radius` as a number or a tuple of numbers.
pub(in super::super) fn radius(py: Python<'_>, given: Option<&Bound<'_, PyAny>>) -> PyResult<Py<PyAny>> {
    let Some(given) = given else { return Ok(py.None()) };
    if let Ok(number) = given.extract::<f64>() {
        return number.into_py_any(py);
    }
    let Ok(numbers) = given.extract::<Vec<f64>>() else {
        let given = given.repr()?;
        return Err(InvalidParameter::new_err(format!("search_radius is {given}, allowed: a length, or up to three")));
    };
    PyTuple::new(py, numbers)?.into_py_any(py)
}
