//! Core errors as Python exceptions: each derives from `StreamsegError` and from the builtin people expect.

use std::panic::{AssertUnwindSafe, catch_unwind};

use pyo3::import_exception;
use pyo3::{PyErr, PyResult, Python};

use crate::error::Error;

import_exception!(streamseg.errors, FileError);
import_exception!(streamseg.errors, InvalidInput);
import_exception!(streamseg.errors, InvalidParameter);
import_exception!(streamseg.errors, InvalidType);
import_exception!(streamseg.errors, SegmentorError);
import_exception!(streamseg.errors, StreamInUse);
import_exception!(streamseg.errors, StreamsegError);

impl From<Error> for PyErr {
    fn from(error: Error) -> Self {
        let message = error.to_string();
        match error {
            Error::InvalidParameter { .. } | Error::NoNeighborhood { .. } | Error::Expression { .. } => {
                InvalidParameter::new_err(message)
            }
            Error::NotFinite { .. }
            | Error::NotSorted { .. }
            | Error::Changed { .. }
            | Error::Attribute { .. }
            | Error::UnknownAttribute { .. }
            | Error::AmbiguousAttribute { .. }
            | Error::DamagedHistory { .. } => InvalidInput::new_err(message),
            Error::Labels { .. } => SegmentorError::new_err(message),
            Error::Spool { .. } => FileError::new_err(message),
            Error::Panicked { .. } | Error::OutOfScope { .. } => StreamsegError::new_err(message),
            // An exception from Python code passes through with its traceback.
            Error::Foreign(foreign) => match foreign.downcast::<PyErr>() {
                Ok(exception) => *exception,
                Err(_) => StreamsegError::new_err(message),
            },
        }
    }
}

impl From<PyErr> for Error {
    fn from(exception: PyErr) -> Self {
        Error::Foreign(Box::new(exception))
    }
}

/// Calls the core without the interpreter; a panic, which would be a defect of ours, becomes an exception like any other.
pub(super) fn guarded<T: Send>(py: Python<'_>, call: impl FnOnce() -> PyResult<T> + Send) -> PyResult<T> {
    py.detach(|| catch_unwind(AssertUnwindSafe(call))).unwrap_or_else(|_| {
        Err(StreamsegError::new_err("the core came to a stop by a defect of its own; please report it"))
    })
}
