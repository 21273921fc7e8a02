//! The surface at the points of a window, and the tests of neighbors on it.

use super::{Curvature, Growth};
use crate::error::{Error, Result};
use crate::window::Window;

/// Normals and curvatures, and what makes two points alike.
pub(super) struct Surface<'a> {
    points: &'a [[f64; 3]],
    scale: [f64; 3],
    normals: Vec<[f64; 3]>,
    curvatures: Vec<f64>,
    least_cosine: f64,
    max_curvature: Option<f64>,
    residual: Option<f64>,
}

impl<'a> Surface<'a> {
    /// The surface that the window's columns tell of.
    pub(super) fn new(window: &'a Window, growth: &Growth) -> Result<Self> {
        let column = |name: &str| {
            let names = || window.columns().names().map(ToString::to_string).collect::<Vec<_>>();
            window.columns().get(name).ok_or_else(|| Error::unknown_attribute(name, &names()))
        };
        let (x, y, z) = (column("NormalX")?, column("NormalY")?, column("NormalZ")?);
        let curvatures = match growth.curvature {
            Curvature::SurfaceVariation => column("SurfaceVariation")?.to_vec(),
            Curvature::Principal => {
                let (max, min) = (column("MaxCurvature")?, column("MinCurvature")?);
                max.iter().zip(min).map(|(&max, &min)| greater(max.abs(), min.abs())).collect()
            }
        };
        Ok(Self {
            points: window.points(),
            scale: window.lattice().scale(),
            normals: x.iter().zip(y).zip(z).map(|((&x, &y), &z)| [x, y, z]).collect(),
            curvatures,
            least_cosine: growth.angle_deg.to_radians().cos(),
            max_curvature: growth.max_curvature,
            residual: growth.residual,
        })
    }

    pub(super) fn has_normal(&self, point: u32) -> bool {
        self.normals[point as usize].iter().all(|c| !c.is_nan())
    }

    pub(super) fn curvature(&self, point: u32) -> f64 {
        self.curvatures[point as usize]
    }

    /// Whether regions grow on from the point. A curvature without a value is none that a region could grow on from.
    pub(super) fn is_smooth(&self, point: u32) -> bool {
        self.max_curvature.is_none_or(|max| self.curvature(point) <= max)
    }

    /// Whether the normals of two points are alike, whichever way they point. A normal without a value is like none.
    pub(super) fn is_alike(&self, p: u32, q: u32) -> bool {
        dot(self.normals[p as usize], self.normals[q as usize]).abs() >= self.least_cosine
    }

    /// Whether `other` lies on the tangent plane at `point`.
    pub(super) fn is_on_plane(&self, other: u32, point: u32) -> bool {
        let Some(residual) = self.residual else { return true };
        let (p, q) = (self.points[point as usize], self.points[other as usize]);
        let apart = std::array::from_fn(|k| (p[k] - q[k]) * self.scale[k]);
        dot(self.normals[point as usize], apart).abs() <= residual
    }
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// The greater of two numbers; NaN if one is missing.
fn greater(a: f64, b: f64) -> f64 {
    if a > b || a.is_nan() { a } else { b }
}
