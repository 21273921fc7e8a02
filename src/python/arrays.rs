//! NumPy arrays to chunks and back, with the wording of everything that can be wrong with them.

use numpy::{
    AllowTypeChange, Element, IntoPyArray, PyArray, PyArray2, PyArrayLike1, PyArrayLikeDyn, PyArrayMethods,
    PyReadonlyArray, PyUntypedArrayMethods, ndarray::Dimension,
};
use pyo3::intern;
use pyo3::prelude::*;

use super::calls::call_named;
use super::errors::InvalidInput;
use crate::error::{Error, Result};
use crate::lattice::Lattice;
use crate::span::{Chunk, Invalid, checked};

/// Scale and offset of a lattice as Python gives them; none for real coordinates.
pub(super) type LatticeOf = Option<([f64; 3], [f64; 3])>;

pub(super) fn lattice_of(lattice: LatticeOf) -> Result<Lattice> {
    lattice.map_or(Ok(Lattice::REAL), |(scale, offset)| Lattice::new(scale, offset))
}

/// The chunks that a Python iterable yields, with the attributes `names`; points that are not valid are refused, or else
/// dropped.
pub(super) fn chunks_of(
    chunks: &Bound<'_, PyAny>,
    names: Vec<String>,
    drop_invalid: bool,
) -> PyResult<impl Iterator<Item = Result<Chunk>> + Send + use<>> {
    let invalid = if drop_invalid { Invalid::Drop } else { Invalid::Reject };
    Ok(checked(PyChunks::new(chunks, names)?, invalid))
}

/// Positions from anything NumPy can make an (n, 3) float64 array of.
pub(super) fn positions(points: &Bound<'_, PyAny>) -> PyResult<Vec<[f64; 3]>> {
    let array: PyArrayLikeDyn<'_, f64, AllowTypeChange> = points.extract().map_err(|cause| {
        let given = points.get_type().name().map_or_else(|_| "object".into(), |name| name.to_string());
        InvalidInput::new_err(format!(
            "points is a {given} that is no array of numbers ({cause}), expected shape (n, 3)"
        ))
    })?;
    // An empty list is an empty cloud.
    if array.len() == 0 {
        return Ok(Vec::new());
    }
    if array.ndim() != 2 || array.shape()[1] != 3 {
        let shape: Vec<String> = array.shape().iter().map(ToString::to_string).collect();
        let comma = if shape.len() == 1 { "," } else { "" };
        let shape = shape.join(", ");
        return Err(InvalidInput::new_err(format!("points has shape ({shape}{comma}), expected (n, 3): x, y and z")));
    }
    let array = aligned(&array)?;
    if array.is_c_contiguous()
        && let Ok(values) = array.as_slice()
    {
        return Ok(bytemuck::cast_slice(values).to_vec());
    }
    let view = array.as_array();
    Ok(view.rows().into_iter().map(|row| [row[0], row[1], row[2]]).collect())
}

/// The same array, or a copy whose values lie where those of its type may: a field of a packed record starts at any byte, and
/// its stride need not be a number of values.
pub(super) fn aligned<'py, T: Element, D: Dimension>(
    array: &Bound<'py, PyArray<T, D>>,
) -> PyResult<PyReadonlyArray<'py, T, D>> {
    let py = array.py();
    let is_aligned: bool = array.getattr(intern!(py, "flags"))?.getattr(intern!(py, "aligned"))?.extract()?;
    let array = if is_aligned { array.clone() } else { array.call_method0(intern!(py, "copy"))?.cast_into()? };
    Ok(array.try_readonly()?)
}

/// The values of attributes, one array per name.
fn attributes(values: &Bound<'_, PyAny>, names: &[String], points: usize) -> PyResult<Vec<Vec<f64>>> {
    names
        .iter()
        .zip(values.try_iter()?)
        .map(|(name, value)| {
            let value: PyArrayLike1<'_, f64, AllowTypeChange> = value?.extract().map_err(|cause| {
                InvalidInput::new_err(format!("{name} is no array of numbers ({cause}), expected shape (n,)"))
            })?;
            let value: Vec<f64> = aligned(&value)?.as_array().iter().copied().collect();
            if value.len() == points {
                Ok(value)
            } else {
                let given = value.len();
                Err(InvalidInput::new_err(format!("{name} has {given} values, expected {points}: one per point")))
            }
        })
        .collect()
}

/// The chunks of a Python iterator of `(points, attributes)`, one array in `attributes` per name.
pub(super) struct PyChunks {
    chunks: Py<PyAny>,
    names: Vec<String>,
}

impl PyChunks {
    pub(super) fn new(chunks: &Bound<'_, PyAny>, names: Vec<String>) -> PyResult<Self> {
        Ok(Self { chunks: chunks.try_iter()?.into_any().unbind(), names })
    }

    fn chunk(&self, item: &Bound<'_, PyAny>) -> PyResult<Chunk> {
        let (points, values): (Bound<'_, PyAny>, Bound<'_, PyAny>) = item.extract()?;
        let points = positions(&points)?;
        let attributes = attributes(&values, &self.names, points.len())?;
        Ok(Chunk { points, attributes })
    }
}

impl Iterator for PyChunks {
    type Item = Result<Chunk>;

    fn next(&mut self) -> Option<Self::Item> {
        Python::attach(|py| {
            let chunks = self.chunks.bind(py);
            let item =
                call_named(py, "the source", || chunks.try_iter().and_then(|mut chunks| chunks.next().transpose()));
            match item {
                Ok(None) => None,
                Ok(Some(item)) => {
                    Some(call_named(py, "an array of the source", || self.chunk(&item)).map_err(Error::from))
                }
                Err(exception) => Some(Err(exception.into())),
            }
        })
    }
}

/// An (n, 3) array of real coordinates.
pub(super) fn real_positions<'py>(
    py: Python<'py>,
    points: &[[f64; 3]],
    lattice: &Lattice,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let real: Vec<[f64; 3]> = points.iter().map(|point| lattice.real(point)).collect();
    rows(py, real)
}

/// An (n, N) array.
pub(super) fn rows<T: Element, const N: usize>(py: Python<'_>, rows: Vec<[T; N]>) -> PyResult<Bound<'_, PyArray2<T>>> {
    let shape = [rows.len(), N];
    rows.into_flattened().into_pyarray(py).reshape(shape)
}

/// Makes an array unwritable, so that what is shared stays what it is.
pub(super) fn read_only(array: &Bound<'_, PyAny>) -> PyResult<()> {
    array.getattr(intern!(array.py(), "flags"))?.setattr(intern!(array.py(), "writeable"), false)
}
