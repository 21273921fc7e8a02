//! Calls of code that the caller brought: a source, a segmentor, a callback.

use pyo3::exceptions::{PyRuntimeError, PyStopAsyncIteration, PyStopIteration};
use pyo3::intern;
use pyo3::prelude::*;

use super::home::Home;

/// Calls `code`, whose exceptions pass through untouched, but for two cases.
///
/// An exception that ends loops must not end the one over the run: it becomes what `escaped` makes of its name, with the
/// exception as its cause, as in generators (PEP 479). And if another process comes back than has called, a fork of it, it is
/// told so at once.
pub(super) fn call<T>(
    py: Python<'_>,
    escaped: impl FnOnce(&str) -> PyErr,
    code: impl FnOnce() -> PyResult<T>,
) -> PyResult<T> {
    let home = Home::of("the run");
    match code() {
        Ok(answer) => home.check().map(|()| answer),
        Err(exception) => Err(match ending(py, &exception) {
            Some(name) => with_cause(py, escaped(name), exception),
            None => exception,
        }),
    }
}

/// As [`call`], where what is called has a name that users know.
pub(super) fn call_named<T>(py: Python<'_>, who: &str, code: impl FnOnce() -> PyResult<T>) -> PyResult<T> {
    call(py, |name| PyRuntimeError::new_err(format!("{who} raised {name}")), code)
}

/// The name of an exception that ends loops.
fn ending(py: Python<'_>, exception: &PyErr) -> Option<&'static str> {
    if exception.is_instance_of::<PyStopIteration>(py) {
        return Some("StopIteration");
    }
    exception.is_instance_of::<PyStopAsyncIteration>(py).then_some("StopAsyncIteration")
}

fn with_cause(py: Python<'_>, error: PyErr, cause: PyErr) -> PyErr {
    if let Some(traceback) = cause.traceback(py) {
        // Told like the cause itself: where in the caller's code it was.
        let _ = error.value(py).setattr(intern!(py, "__traceback__"), traceback);
    }
    error.set_cause(py, Some(cause));
    error
}
