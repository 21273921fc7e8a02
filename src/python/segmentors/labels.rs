//! The labels that a segmentor in Python gives: any array of whole numbers, read as it is. A label is a name and no more.

use numpy::{AllowTypeChange, Element, PyArrayDescrMethods, PyArrayLike1, PyUntypedArray, PyUntypedArrayMethods};
use pyo3::conversion::FromPyObjectOwned;
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
    let is_unsigned = dtype.kind() == b'u';
    let mut labels = if is_unsigned {
        values::<u64>(&array)?.into_iter().map(|label| label as i64).collect()
    } else {
        values::<i64>(&array)?
    };
    let is_refused = |label: i64| if is_unsigned { is_wrapped(label as u64, dtype.itemsize()) } else { label < NONE };
    let masked = masked(answer)?;
    let is_masked = |at: usize| masked.as_ref().is_some_and(|masked| masked[at]);
    if let Some(at) = (0..points).find(|&at| is_refused(labels[at]) && !is_masked(at)) {
        let label = labels[at];
        return Ok(Err(if is_unsigned {
            format!(
                "returned the label {} of type {dtype}, which is what -1 becomes there; return a signed type, such as int64, \
                 where -1 = none",
                label as u64
            )
        } else {
            format!("returned the label {label}, allowed: 0 and above, or -1 = none")
        }));
    }
    labels.iter_mut().enumerate().filter(|(at, _)| is_masked(*at)).for_each(|(_, label)| *label = NONE);
    Ok(Ok(Labels::from_any(&labels)))
}

/// Whether −1 becomes this number in an unsigned type of so many bytes, or on the way to it in one of 4 bytes. Of others,
/// those from 2⁶³ on are negative names, none of which is [`NONE`].
fn is_wrapped(label: u64, bytes: usize) -> bool {
    label == u64::MAX >> (64 - 8 * bytes.min(8)) || label == u64::from(u32::MAX)
}

fn values<T: Element + Copy + for<'a> FromPyObjectOwned<'a>>(array: &Bound<'_, PyAny>) -> PyResult<Vec<T>> {
    let values: PyArrayLike1<'_, T, AllowTypeChange> = array.extract()?;
    Ok(aligned(&values)?.as_array().iter().copied().collect())
}

/// Which labels are masked, if any can be.
fn masked(answer: &Bound<'_, PyAny>) -> PyResult<Option<Vec<bool>>> {
    let ma = answer.py().import(intern!(answer.py(), "numpy.ma"))?;
    if !answer.is_instance(&ma.getattr(intern!(answer.py(), "MaskedArray"))?)? {
        return Ok(None);
    }
    values(&ma.call_method1(intern!(answer.py(), "getmaskarray"), (answer,))?).map(Some)
}
