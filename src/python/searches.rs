//! Which points are neighbors, as people say it: `k`, `search_radius` and `search_mode`.

use pyo3::prelude::*;

use super::errors::InvalidParameter;
use crate::error::{Error, positive};
use crate::neighborhood::Search;

/// The search for what a user gave; with both `k` and `search_radius` the k nearest within the radius.
pub(super) fn search(k: Option<i64>, search_radius: Option<&Bound<'_, PyAny>>, search_mode: &str) -> PyResult<Search> {
    if !["2d", "2.5d", "3d"].contains(&search_mode) {
        return Err(InvalidParameter::new_err(format!(
            "search_mode is '{search_mode}', allowed: '2d', '2.5d' or '3d'"
        )));
    }
    match (k, search_radius) {
        (Some(k), within) => nearest(k, within, search_mode),
        (None, Some(radii)) => around(radii, search_mode),
        (None, None) => Err(InvalidParameter::new_err(
            "search_radius and k are both None, allowed: search_radius=<length>, k=<number of nearest points>, or both",
        )),
    }
}

fn nearest(k: i64, within: Option<&Bound<'_, PyAny>>, search_mode: &str) -> PyResult<Search> {
    let k = usize::try_from(k).map_err(|_| Error::parameter("k", k, "a whole number of at least 1"))?;
    let flat = match search_mode {
        "2d" => true,
        "3d" => false,
        _ => {
            let allowed = "'2d' or '3d' with k; a cylinder ('2.5d') has a search_radius and no k";
            return Err(InvalidParameter::new_err(format!("search_mode is '{search_mode}', allowed: {allowed}")));
        }
    };
    let within = within.map(radius).transpose()?;
    Ok(match Search::nearest(k, within)? {
        Search::Nearest { k, within, .. } => Search::Nearest { k, flat, within },
        other => other,
    })
}

fn around(radii: &Bound<'_, PyAny>, search_mode: &str) -> PyResult<Search> {
    Ok(match search_mode {
        "2d" => Search::disc(radius(radii)?)?,
        "3d" => Search::ball(radius(radii)?)?,
        _ => cylinder(radii)?,
    })
}

/// [r] = as far up and down as to the side, [r, h] = h up and down, [r, low, high].
fn cylinder(radii: &Bound<'_, PyAny>) -> PyResult<Search> {
    let (radius, low, high) = match lengths(radii).as_deref() {
        Some(&[radius]) => (radius, -radius, radius),
        Some(&[radius, height]) => (radius, -height, height),
        Some(&[radius, low, high]) => (radius, low, high),
        _ => return Err(wrong(radii, "a number, [radius], [radius, height] or [radius, lowest, highest]")?),
    };
    positive("search_radius", radius)?;
    if !(low <= 0.0 && 0.0 <= high) {
        return Err(wrong(
            radii,
            "[radius, height] with height >= 0, or [radius, lowest, highest] with lowest <= 0 <= highest",
        )?);
    }
    Ok(Search::cylinder(radius, low, high)?)
}

/// The one radius of a disc, a ball, or a limit for the nearest.
fn radius(radii: &Bound<'_, PyAny>) -> PyResult<f64> {
    match lengths(radii).as_deref() {
        Some(&[radius]) => Ok(positive("search_radius", radius)?),
        _ => Err(wrong(radii, "a finite number above 0; only search_mode='2.5d' takes more than one")?),
    }
}

/// One number, or several.
fn lengths(radii: &Bound<'_, PyAny>) -> Option<Vec<f64>> {
    radii.extract::<f64>().map(|radius| vec![radius]).or_else(|_| radii.extract()).ok()
}

fn wrong(radii: &Bound<'_, PyAny>, allowed: &str) -> PyResult<PyErr> {
    Ok(InvalidParameter::new_err(format!("search_radius is {}, allowed: {allowed}", radii.repr()?)))
}
