//! Core errors as Python exceptions: each derives from `StreamsegError` and from the builtin people expect.

use pyo3::PyErr;
use pyo3::import_exception;

use crate::error::Error;

import_exception!(streamseg.errors, FileError);
import_exception!(streamseg.errors, InvalidInput);
import_exception!(streamseg.errors, InvalidParameter);
import_exception!(streamseg.errors, SegmentorError);
import_exception!(streamseg.errors, StreamInUse);
import_exception!(streamseg.errors, StreamsegError);

impl From<Error> for PyErr {
    fn from(error: Error) -> Self {
        let message = error.to_string();
        match error {
            Error::InvalidParameter { .. } => InvalidParameter::new_err(message),
            Error::NotFinite { .. }
            | Error::NotSorted { .. }
            | Error::Attribute { .. }
            | Error::DamagedHistory { .. } => InvalidInput::new_err(message),
            Error::Labels { .. } => SegmentorError::new_err(message),
            Error::Spool { .. } => FileError::new_err(message),
            Error::Panicked { .. } => StreamsegError::new_err(message),
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
