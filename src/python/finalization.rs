//! The counting pass over a cloud that is read twice.

use pyo3::prelude::*;

use super::arrays::{LatticeOf, chunks_of, lattice_of};
use super::errors::guarded;
use super::home::Home;
use super::spans::PySpanByWidth;
use super::stream::look_up;
use crate::pipeline::Progress;
use crate::span::{Counting, SlabCounts};

/// How many points each slab of a cloud has, along the direction in which the fewest wait.
#[pyclass(frozen, name = "SlabCounts", module = "streamseg._core")]
pub struct PySlabCounts(pub(super) SlabCounts);

#[pymethods]
impl PySlabCounts {
    /// Reads all `chunks`, whose items are `(points, ())`; `on_progress` is called at least once a chunk.
    #[new]
    #[pyo3(signature = (chunks, width, *, lattice, drop_invalid, on_progress))]
    fn new(
        py: Python<'_>,
        chunks: &Bound<'_, PyAny>,
        width: f64,
        lattice: LatticeOf,
        drop_invalid: bool,
        on_progress: Option<Py<PyAny>>,
    ) -> PyResult<Self> {
        let (home, lattice) = (Home::of("the run"), lattice_of(lattice)?);
        let chunks = chunks_of(chunks, vec![], drop_invalid)?;
        let counts = guarded(py, || {
            let mut counting = Counting::new(width, &lattice)?;
            for chunk in chunks {
                counting.add(&chunk?)?;
                look_up(home, &Progress::default(), on_progress.as_ref())?;
            }
            Ok(counting.finish())
        })?;
        Ok(Self(counts))
    }

    /// The slabs.
    #[getter]
    fn spans(&self) -> PyResult<PySpanByWidth> {
        Ok(PySpanByWidth::of(self.0.width(), self.0.direction())?)
    }

    /// How many points were counted.
    #[getter]
    fn points(&self) -> u64 {
        self.0.points()
    }

    /// How many points wait at the most, if they come one by one.
    #[getter]
    fn most_waiting(&self) -> u64 {
        self.0.most_waiting()
    }
}
