//! Plans as Python objects: what a cloud's census and a budget of memory lead to.

use pyo3::prelude::*;
use pyo3::types::PyBool;

use super::arrays::{LatticeOf, chunks_of, lattice_of};
use super::errors::{InvalidParameter, guarded};
use super::numbers::Whole;
use super::segmentors::PyRecipe;
use super::spans::{PyWindowSize, direction_of};
use crate::plan::{Budget, Census, Plan};

/// Spans and windows that keep to a budget of memory. Made by `plan`; can be given as `spans`.
#[pyclass(frozen, name = "Plan", module = "streamseg")]
pub struct PyPlan {
    pub(super) plan: Plan,
}

#[pymethods]
impl PyPlan {
    /// Width of a slab in units of the coordinates; a span is one slab or more.
    #[getter]
    fn width(&self) -> f64 {
        self.plan.width()
    }

    /// Most points that the slabs of a span of several have together.
    #[getter]
    fn points_per_span(&self) -> usize {
        self.plan.points_per_span()
    }

    /// "x" or "y": along which the slabs follow each other.
    #[getter]
    fn direction(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        direction_of(py, self.plan.spans())
    }

    /// Points that a window of more spans than it needs may load.
    #[getter]
    fn points_per_window(&self) -> usize {
        self.plan.room()
    }

    /// How many windows may be segmented at the same time; more threads than that have nothing to do.
    #[getter]
    fn at_a_time(&self) -> usize {
        self.plan.at_a_time()
    }

    /// How many windows there will be.
    #[getter]
    fn windows(&self) -> usize {
        self.plan.windows().len()
    }

    /// Points, halo included, of the window that loads most.
    #[getter]
    fn most_points(&self) -> u64 {
        self.plan.most_points()
    }

    /// One sentence, if even the smallest windows do not keep to the budget, or what comes before and after them.
    #[getter]
    fn warning(&self) -> Option<String> {
        self.plan.warning()
    }

    /// The least number of spans of a window, and how many of them two windows share.
    #[getter]
    fn window(&self) -> PyWindowSize {
        PyWindowSize(self.plan.size())
    }

    /// The bytes that a run is expected to take at most on so many threads.
    fn peak(&self, threads: Whole) -> PyResult<u64> {
        Ok(self.plan.peak(threads.count("threads")?))
    }

    /// What was chosen and why, line by line: a label and what there is to say.
    fn explain(&self, threads: Whole) -> PyResult<Vec<(&'static str, String)>> {
        Ok(self.plan.explain(threads.count("threads")?))
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let direction = self.direction(py)?;
        Ok(format!(
            "Plan(width={:?}, direction={}, points_per_span={}, points_per_window={}, at_a_time={})",
            self.plan.width(),
            direction.bind(py).repr()?,
            self.plan.points_per_span(),
            self.plan.room(),
            self.plan.at_a_time()
        ))
    }
}

/// Reads a stored cloud once and makes a plan for segmenting it by a recipe; without a budget for the usual one.
#[pyfunction]
#[pyo3(signature = (chunks, recipe, max_memory, *, lattice, with_history, drop_invalid))]
#[allow(clippy::too_many_arguments)] // one keyword each for Python
pub(super) fn _plan(
    py: Python<'_>,
    chunks: &Bound<'_, PyAny>,
    recipe: &PyRecipe,
    max_memory: Option<&Bound<'_, PyAny>>,
    lattice: LatticeOf,
    with_history: bool,
    drop_invalid: bool,
) -> PyResult<PyPlan> {
    let budget = max_memory.map_or_else(|| Ok(Budget::default()), budget)?;
    let lattice = lattice_of(lattice)?;
    let chunks = chunks_of(chunks, vec![], drop_invalid)?;
    let segmentor = &*recipe.segmentor;
    let plan = guarded(py, || {
        let mut census = Census::new(segmentor.exactness().reach(), &lattice);
        for chunk in chunks {
            census.add(&chunk?)?;
        }
        Ok(Plan::new(&census, segmentor, budget, with_history)?)
    })?;
    Ok(PyPlan { plan })
}

/// A budget as people write it: a number of bytes, or a text with a unit.
fn budget(given: &Bound<'_, PyAny>) -> PyResult<Budget> {
    if !given.is_instance_of::<PyBool>()
        && let Ok(bytes) = given.extract::<f64>()
        && bytes.fract() == 0.0
        && bytes >= 0.0
    {
        // 512e6 is a number of bytes too; too many for any machine are no limit.
        return Ok(Budget::new(bytes as u64)?);
    }
    match given.extract::<String>() {
        Ok(text) => Ok(text.parse()?),
        Err(_) => Err(InvalidParameter::new_err(format!(
            "max_memory is {}, allowed: a number of bytes above 0, or one with a unit: '512MB', '2GB', '1.5 GiB'",
            given.repr()?
        ))),
    }
}
