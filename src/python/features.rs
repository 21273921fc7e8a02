//! Features of a whole cloud for Python.

use numpy::{IntoPyArray, PyArray1};
use pyo3::prelude::*;

use super::arrays::{LatticeOf, chunks_of, lattice_of};
use super::errors::{InvalidParameter, guarded};
use super::numbers::Whole;
use super::searches::search;
use crate::features::{Feature, Fit, compute};

/// Computes the named features of all points of `chunks`, whose items are `(points, ())`: one (n,) float64 array per name.
#[pyfunction]
#[pyo3(signature = (chunks, names, *, k, search_radius, search_mode, normals, lattice))]
#[allow(clippy::too_many_arguments)] // one keyword each for Python
pub(super) fn _features<'py>(
    py: Python<'py>,
    chunks: &Bound<'py, PyAny>,
    names: Vec<String>,
    k: Option<Whole>,
    search_radius: Option<&Bound<'py, PyAny>>,
    search_mode: &str,
    normals: &str,
    lattice: LatticeOf,
) -> PyResult<Vec<Bound<'py, PyArray1<f64>>>> {
    let wanted = names.iter().map(|name| feature(name)).collect::<PyResult<Vec<Feature>>>()?;
    let k = k.map(|k| k.named("k")).transpose()?;
    let search = search(k, search_radius, search_mode)?;
    let fit: Fit = normals.parse()?;
    let lattice = lattice_of(lattice)?;
    let mut points = Vec::new();
    for chunk in chunks_of(chunks, vec![], false)? {
        points.extend(chunk?.points);
    }
    let features = guarded(py, || {
        let point_ids: Vec<i64> = (0..points.len() as i64).collect();
        Ok(compute(&points, &point_ids, &lattice, search, fit, &wanted))
    })?;
    Ok(features.columns.into_iter().map(|column| column.into_pyarray(py)).collect())
}

pub(super) fn feature(name: &str) -> PyResult<Feature> {
    Feature::by_name(name).ok_or_else(|| {
        let known: Vec<&str> = Feature::ALL.iter().map(|feature| feature.name()).collect();
        InvalidParameter::new_err(format!("feature is '{name}', allowed: {}", known.join(", ")))
    })
}
