//! The counting pass over a cloud that is read twice.

use pyo3::prelude::*;

use super::arrays::PyChunks;
use super::errors::guarded;
use super::spans::PySpanByWidth;
use super::stream::look_up;
use crate::lattice::Lattice;
use crate::pipeline::Progress;
use crate::span::{Counting, Invalid, SlabCounts, checked};

/// How many points each slab of a cloud has, along the direction in which the fewest wait.
#[pyclass(frozen, name = "SlabCounts", module = "streamseg._core")]
pub struct PySlabCounts(pub(super) SlabCounts);

#[pymethods]
impl PySlabCounts {
    /// Reads all `chunks`, whose items are `(points, ())`; `on_progress` is called at least once a chunk.
    #[new]
    #[pyo3(signature = (chunks, width, *, scale, offset, drop_invalid, on_progress))]
    fn new(
        py: Python<'_>,
        chunks: &Bound<'_, PyAny>,
        width: f64,
        scale: Option<[f64; 3]>,
        offset: Option<[f64; 3]>,
        drop_invalid: bool,
        on_progress: Option<Py<PyAny>>,
    ) -> PyResult<Self> {
        let lattice = match (scale, offset) {
            (Some(scale), Some(offset)) => Lattice::new(scale, offset)?,
            _ => Lattice::REAL,
        };
        let invalid = if drop_invalid { Invalid::Drop } else { Invalid::Reject };
        let chunks = checked(PyChunks::new(chunks, vec![])?, invalid);
        let counts = guarded(py, || {
            let mut counting = Counting::new(width, &lattice)?;
            for chunk in chunks {
                counting.add(&chunk?)?;
                look_up(&Progress::default(), on_progress.as_ref())?;
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
