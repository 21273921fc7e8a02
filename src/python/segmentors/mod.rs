//! Segmentors as Python objects: the built-in ones, one class each, and the adapter for what users bring.

mod base;
mod conditional_clustering;
mod dbscan;
mod foreign;
mod labels;
mod plane_extraction;
mod proximity;
mod region_growing;

use std::sync::Arc;

use pyo3::prelude::*;

pub use base::PySegmentor;
pub use conditional_clustering::PyConditionalClustering;
pub use dbscan::PyDbscan;
pub use foreign::PyWindow;
pub use plane_extraction::PyPlaneExtraction;
pub use proximity::PyProximity;
pub use region_growing::PyRegionGrowing;

use super::arrays::{LatticeOf, lattice_of};
use super::spans::{PyWindowSize, span_by};
use crate::attribute::meant;
use crate::error::Result;
use crate::preprocessing::Stage;
use crate::recipe::{Ingredients, Recipe};
use crate::segmentor::{ComingBack, Segmentor};
use crate::span::Source;
use base::Options;

/// A segmentor with all that is done before it, for a cloud whose attributes are known.
#[pyclass(frozen, name = "Recipe", module = "streamseg._core")]
pub struct PyRecipe {
    pub(super) segmentor: Arc<dyn Segmentor>,
    /// The attributes of the cloud that are read.
    #[pyo3(get)]
    reads: Vec<String>,
    /// The features that are computed, because the cloud does not have them.
    #[pyo3(get)]
    computes: Vec<&'static str>,
}

#[pymethods]
impl PyRecipe {
    /// `available` are the attributes of the cloud; if it `has_more`, any other may be there too.
    #[new]
    #[pyo3(signature = (segmentor, stages, available, has_more))]
    fn new(
        segmentor: &Bound<'_, PyAny>,
        stages: &Bound<'_, PyAny>,
        available: Vec<String>,
        has_more: bool,
    ) -> PyResult<Self> {
        let (core, options) = match segmentor.cast::<PySegmentor>() {
            Ok(built_in) => (Arc::clone(&built_in.get().core), built_in.get().options.clone()),
            Err(_) => (Arc::new(foreign::Foreign::new(segmentor)?) as Arc<dyn Segmentor>, Options::none()),
        };
        let stages = super::preprocessing::stages(stages)?;
        let (segmentor, computes) = prepared(core, options, stages, &available, has_more)?;
        let reads = segmentor.reads();
        Ok(Self { segmentor, reads, computes })
    }

    /// What is done so that a stream which comes back to where it was finds each object once: "nothing", "bring back" or
    /// "wait".
    #[pyo3(signature = (spans, window, *, stored, lattice))]
    fn coming_back(
        &self,
        spans: Option<&Bound<'_, PyAny>>,
        window: &PyWindowSize,
        stored: bool,
        lattice: LatticeOf,
    ) -> PyResult<&'static str> {
        let source = if stored { Source::Stored } else { Source::Live };
        let exactness = self.segmentor.exactness();
        Ok(match exactness.coming_back(span_by(spans)?, source, window.0, &lattice_of(lattice)?)? {
            ComingBack::Nothing => "nothing",
            ComingBack::BringBack => "bring back",
            ComingBack::Wait => "wait",
        })
    }

    /// Whether there is a limit to how far away what decides about a point can be.
    #[getter]
    fn is_bounded(&self) -> bool {
        self.segmentor.exactness().is_bounded()
    }
}

/// The one of `names` that is meant by `name`, whatever its case, underscores and blanks: the most alike.
#[pyfunction]
pub fn meant_attribute(name: &str, names: Vec<String>) -> PyResult<Option<String>> {
    Ok(meant(name, names.iter().map(String::as_str))?.map(ToString::to_string))
}

/// The segmentor itself if there is nothing to prepare; and the names of the features that are computed.
fn prepared(
    segmentor: Arc<dyn Segmentor>,
    options: Options,
    stages: Vec<Arc<dyn Stage>>,
    available: &[String],
    has_more: bool,
) -> Result<(Arc<dyn Segmentor>, Vec<&'static str>)> {
    let Options { filter, seed_filter, fit, .. } = options;
    if stages.is_empty() && filter.is_none() && seed_filter.is_none() && segmentor.attributes().is_empty() {
        return Ok((segmentor, vec![]));
    }
    let ingredients = Ingredients { stages, filter, seed_filter, fit, segmentor };
    let recipe = Recipe::new(ingredients, available, has_more)?;
    let computes = recipe.computes().iter().map(|feature| feature.name()).collect();
    Ok((Arc::new(recipe), computes))
}
