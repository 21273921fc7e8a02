//! The Python module `streamseg._core`: checks, converts, lets go of the interpreter, calls the core, converts back.

// Python hands its arguments over, and its docstrings are not Markdown.
#![allow(clippy::needless_pass_by_value, clippy::doc_markdown)]

mod arrays;
mod calls;
mod errors;
mod features;
mod finalization;
mod history;
mod home;
mod numbers;
mod plan;
mod preprocessing;
mod scenes;
mod searches;
mod segmentors;
mod selection;
mod spans;
mod stream;
mod survey;

use pyo3::prelude::*;

/// The compiled core of streamseg.
#[pymodule]
mod _core {
    /// The version of the package.
    #[pymodule_export]
    #[allow(non_upper_case_globals)] // the name that Python people look for
    const __version__: &str = env!("CARGO_PKG_VERSION");

    /// The stub that it was built with, by which the package tells whether it is up to date.
    #[pymodule_export]
    #[allow(non_upper_case_globals)] // as above
    const _stub: &str = include_str!("../../python/streamseg/_core.pyi");

    #[pymodule_export]
    use super::features::_features;
    #[pymodule_export]
    use super::finalization::PySlabCounts;
    #[pymodule_export]
    use super::history::PyReplay;
    #[pymodule_export]
    use super::plan::{_plan, PyPlan};
    #[pymodule_export]
    use super::preprocessing::{_halo_of, _measure, PyRadiusOutlierRemoval, PyStatisticalOutlierRemoval, PyVoxelGrid};
    #[pymodule_export]
    use super::scenes::PyScene;
    #[pymodule_export]
    use super::segmentors::{PyConditionalClustering, PyDbscan, PyPlaneExtraction, PyProximity, PyRegionGrowing};
    #[pymodule_export]
    use super::segmentors::{PyRecipe, PySegmentor, PyWindow, meant_attribute};
    #[pymodule_export]
    use super::spans::default_spans;
    #[pymodule_export]
    use super::spans::{PySpanByCount, PySpanByScanLine, PySpanByTime, PySpanByWidth, PyWindowSize};
    #[pymodule_export]
    use super::stream::{PyPipeline, PySettled, PySettlement, PySpan, PyTurn};
    #[pymodule_export]
    use super::survey::{PyFeatureSurvey, PyFeatures, PyThinnedSpan, PyThinning};
}
