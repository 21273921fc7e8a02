//! Numbers from Python. One that is none, or too large, is told by the name of its parameter.

use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;

use super::errors::{InvalidParameter, InvalidType};

/// The longest text of a number that is shown.
const LONGEST: usize = 40;

/// A whole number as it was given.
pub(super) struct Whole(PyResult<i64>, String);

/// A number as it was given.
pub(super) struct Real(PyResult<f64>, String);

impl Whole {
    /// A default.
    pub(super) fn of(value: usize) -> Self {
        Self(Ok(value as i64), String::new())
    }

    /// The number, if it is one.
    pub(super) fn named(self, name: &str) -> PyResult<i64> {
        self.0.map_err(|cause| wrong(&cause, name, &self.1, "a whole number below 2^63"))
    }

    /// The number, if it is one that can count something.
    pub(super) fn count(self, name: &'static str) -> PyResult<usize> {
        Ok(super::spans::count(name, self.named(name)?)?)
    }
}

impl Real {
    /// A default.
    pub(super) fn of(value: f64) -> Self {
        Self(Ok(value), String::new())
    }

    /// The number, if it is one.
    pub(super) fn named(self, name: &str) -> PyResult<f64> {
        self.0.map_err(|cause| wrong(&cause, name, &self.1, "a number below 1.8e308"))
    }
}

impl<'py> FromPyObject<'_, 'py> for Whole {
    type Error = PyErr;

    fn extract(given: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        Ok(Self(given.extract(), shown(&given)))
    }
}

impl<'py> FromPyObject<'_, 'py> for Real {
    type Error = PyErr;

    fn extract(given: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        Ok(Self(given.extract(), shown(&given)))
    }
}

fn wrong(cause: &PyErr, name: &str, given: &str, allowed: &str) -> PyErr {
    let message = format!("{name} is {given}, allowed: {allowed}");
    let is_type = Python::attach(|py| cause.is_instance_of::<PyTypeError>(py));
    if is_type { InvalidType::new_err(message) } else { InvalidParameter::new_err(message) }
}

/// What was given, as people typed it; Python itself refuses to write the longest numbers.
fn shown(given: &Bound<'_, PyAny>) -> String {
    let text = given.repr().map_or_else(|_| "a number of thousands of digits".into(), |text| text.to_string());
    if text.chars().count() <= LONGEST {
        return text;
    }
    text.chars().take(LONGEST).chain(std::iter::once('…')).collect()
}
