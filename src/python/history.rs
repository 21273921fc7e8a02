//! The replay of a history as a Python object.

use std::sync::Mutex;

use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;

use super::errors::guarded;
use super::home::Home;
use super::selection::{Selected, SizeOptions, selected};
use super::stream::PySettlement;
use crate::weaver::{Replay, Selection};

/// Replays the parts of a history, in order, into a settlement.
#[pyclass(frozen, name = "Replay", module = "streamseg._core")]
pub struct PyReplay(Mutex<Replay>, Home);

#[pymethods]
impl PyReplay {
    #[new]
    #[pyo3(signature = (last_segment_id, late_joins = false))]
    fn new(last_segment_id: i64, late_joins: bool) -> Self {
        let replay = Replay::new(last_segment_id);
        let replay = if late_joins { replay.with_late_joins() } else { replay };
        Self(Mutex::new(replay), Home::of("the history under way"))
    }

    /// Takes in one part: rows of the segment-segment table, segments without a seed, and raw ids of points; returns
    /// carried ids and where the log stands.
    fn part<'py>(
        &self,
        py: Python<'py>,
        segment_ids: PyReadonlyArray1<'py, i64>,
        next_segment_ids: PyReadonlyArray1<'py, i64>,
        seedless: PyReadonlyArray1<'py, i64>,
        raw_ids: PyReadonlyArray1<'py, i64>,
    ) -> PyResult<(Bound<'py, PyArray1<i64>>, u64)> {
        self.1.check()?;
        let (segments, next) = (segment_ids.as_array(), next_segment_ids.as_array());
        let rows: Vec<[i64; 2]> = segments.iter().zip(next).map(|(&id, &next)| [id, next]).collect();
        let seedless: Vec<i64> = seedless.as_array().iter().copied().collect();
        let mut ids: Vec<i64> = raw_ids.as_array().iter().copied().collect();
        let position = guarded(py, || Ok(self.lock().part(&rows, &seedless, &mut ids)?))?;
        Ok((ids.into_pyarray(py), position))
    }

    /// Ends the replay and makes the ids of a settlement final: all of them, or within limits, which are the fewest and
    /// the most points of a segment and how to number them. Returns the same as that of a pipeline.
    #[pyo3(signature = (settlement, limits = None))]
    fn settle(
        &self,
        py: Python<'_>,
        settlement: &PySettlement,
        limits: Option<(i64, Option<i64>, String)>,
    ) -> PyResult<Selected> {
        self.1.check()?;
        let sizes = limits.map(|(min, max, sort)| SizeOptions::new(min, max, &sort)).transpose()?;
        guarded(py, || {
            let mut replay = self.lock();
            replay.finish();
            let log = replay.aliases();
            let selection = match sizes {
                Some(sizes) => sizes.select(log)?,
                None => Selection::everything(log)?,
            };
            settlement.lock()?.settle(log, &selection)?;
            Ok(selected(&selection))
        })
    }
}

impl PyReplay {
    fn lock(&self) -> std::sync::MutexGuard<'_, Replay> {
        // Poisoned by a panic that has been told already: the replay is of no use, but nothing is unsound.
        self.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }
}
