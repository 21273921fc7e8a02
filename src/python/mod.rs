//! The Python module `streamseg._core`: checks, converts, lets go of the interpreter, calls the core, converts back.

mod arrays;
mod errors;
mod history;
mod segmentors;
mod spans;
mod stream;

use pyo3::prelude::*;

/// The compiled core of streamseg.
#[pymodule]
mod _core {
    #[pymodule_export]
    use super::history::PyReplay;
    #[pymodule_export]
    #[pymodule_export]
    use super::segmentors::{PyProximity, PyWindow};
    #[pymodule_export]
    use super::spans::default_spans;
    #[pymodule_export]
    use super::spans::{PySpanByCount, PySpanByScanLine, PySpanByTime, PySpanByWidth, PyWindowSize};
    #[pymodule_export]
    use super::stream::{PyPipeline, PySettled, PySettlement, PySpan};
}
