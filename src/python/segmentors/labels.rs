//! The labels that a segmentor in Python gives: any array of whole numbers, read as it is. A label is a name and no more.

use numpy::{AllowTypeChange, PyArrayDescrMethods, PyArrayLike1, PyUntypedArray, PyUntypedArrayMethods};
use pyo3::intern;
use pyo3::prelude::*;

use crate::label::{Labels, NONE};
use crate::python::arrays::aligned;

/// One label for each of so many points; or else what is wrong with them. What is masked has none.
pub(super) fn labels_of(answer: &Bound<'_, PyAny>, points: usize) -> PyResult<Result<Labels, String>> {
    let py = answer.py();
    let numpy = py.import(intern!(py, "numpy"))?;
    let array = numpy.call_method1(intern!(py, "asarray"), (answer,))?;
    let untyped = array.cast::<PyUntypedArray>()?;
    if untyped.shape() != [points] {
        let shape = array.getattr("shape")?.repr()?.to_string();
        return Ok(Err(format!("returned labels of shape {shape}, expected ({points},): one label per point")));
    }
    let dtype = untyped.dtype();
    if !matches!(dtype.kind(), b'i' | b'u' | b'b') {
        return Ok(Err(format!("returned labels of type {dtype}, expected whole numbers; -1 = none")));
    }
    let mut labels = if dtype.kind() == b'u' {
        match unsigned(&array, dtype.itemsize())? {
            Ok(labels) => labels,
            Err(label) => {
                return Ok(Err(format!(
                    "returned the label {label} of type {dtype}, which is what -1 becomes there; return a signed type, such \
                     as int64, where -1 = none"
                )));
            }
        }
    } else {
        let labels: PyArrayLike1<'_, i64, AllowTypeChange> = array.extract()?;
        aligned(&labels)?.as_array().iter().copied().collect()
    };
    let ma = numpy.getattr(intern!(py, "ma"))?;
    if answer.is_instance(&ma.getattr(intern!(py, "MaskedArray"))?)? {
        let mask = ma.call_method1(intern!(py, "getmaskarray"), (answer,))?;
        let mask: PyArrayLike1<'_, bool, AllowTypeChange> = mask.extract()?;
        labels.iter_mut().zip(mask.as_array()).filter(|(_, masked)| **masked).for_each(|(label, _)| *label = NONE);
    }
    if dtype.kind() != b'u'
        && let Some(below) = labels.iter().find(|label| **label < NONE)
    {
        return Ok(Err(format!("returned the label {below}, allowed: 0 and above, or -1 = none")));
    }
    Ok(Ok(Labels::from_any(&labels)))
}

/// Labels of an unsigned type of so many bytes; those from 2⁶³ on become negative names, none of which is [`NONE`]. Or else
/// the first that −1 becomes in this type, or on the way to it in one of 4 bytes.
fn unsigned(array: &Bound<'_, PyAny>, bytes: usize) -> PyResult<Result<Vec<i64>, u64>> {
    let labels: PyArrayLike1<'_, u64, AllowTypeChange> = array.extract()?;
    let labels: Vec<u64> = aligned(&labels)?.as_array().iter().copied().collect();
    let largest = u64::MAX >> (64 - 8 * bytes.min(8));
    let wrapped = [largest, u64::from(u32::MAX)];
    Ok(match labels.iter().find(|label| wrapped.contains(label)) {
        Some(label) => Err(*label),
        None => Ok(labels.into_iter().map(|label| label as i64).collect()),
    })
}
