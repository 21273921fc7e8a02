//! What the surface is like around each point: normals, how well a plane fits, curvature.
//!
//! The eigenvalue features are those of Hackel, Wegner and Schindler (2016), as CGAL, `CloudCompare` and `jakteristics` define
//! them, but for the entropy, which we take of eigenvalues that sum to 1, as Weinmann et al. (2015) and `pgeof` do, so that
//! it has no unit. Surface variation is Pauly's (2002), at one place 0 as in PCL.
//!
//! The features of a point depend on its neighbors alone, bit for bit: on their positions relative to the point, which on
//! a lattice are exact, taken in the order of (distance, point id).

mod curvature;
pub(crate) mod eigen;
mod feature;
mod plane;

use crate::error::Error;
use crate::lattice::Lattice;
use crate::neighborhood::{Grid, Neighbor, Neighborhoods, Search, support};
use curvature::Curvature;
pub use feature::Feature;
use plane::{Plane, Robust};

/// How planes are fitted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Fit {
    /// Least squares, equal weights.
    #[default]
    LeastSquares,
    /// Blunders are removed by residual weighting, then least squares over what is left. All features but the number of
    /// neighbors are those of what is left.
    Robust,
}

impl Fit {
    /// The name, as users type it.
    pub fn name(self) -> &'static str {
        match self {
            Fit::LeastSquares => "least_squares",
            Fit::Robust => "robust",
        }
    }
}

impl std::str::FromStr for Fit {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        match text {
            "least_squares" => Ok(Fit::LeastSquares),
            "robust" => Ok(Fit::Robust),
            _ => Err(Error::parameter("normals", format!("'{text}'"), "'least_squares' or 'robust'")),
        }
    }
}

/// Features of the points of a window.
#[derive(Debug, Clone, PartialEq)]
pub struct Features {
    /// One column per feature asked for, one value per point; NaN where it has no value.
    pub columns: Vec<Vec<f64>>,
    /// How far around each point its features depend on what is there, in units of the coordinates on the map; ∞ for a
    /// point with fewer neighbors than were asked for, if nothing limits how far they may be.
    pub support: Vec<f64>,
}

/// Computes `wanted` for `points`, which lie on `lattice`.
pub fn compute(
    points: &[[f64; 3]],
    point_ids: &[i64],
    lattice: &Lattice,
    search: Search,
    fit: Fit,
    wanted: &[Feature],
) -> Features {
    compute_and_look(points, point_ids, lattice, search, fit, wanted, |_, _, _| {})
}

/// Computes `wanted` and keeps the neighbors from which it was computed, for those who look at them again.
pub fn compute_and_keep(
    points: &[[f64; 3]],
    point_ids: &[i64],
    lattice: &Lattice,
    search: Search,
    fit: Fit,
    wanted: &[Feature],
) -> (Features, Neighborhoods) {
    let mut kept = Neighborhoods::new(search, points.len());
    let features = compute_and_look(points, point_ids, lattice, search, fit, wanted, |point, found, support| {
        kept.keep(point, found.iter().map(|neighbor| neighbor.point), support);
    });
    (features, kept)
}

/// Computes `wanted`; `look` sees the neighbors of each point and how far around it they were looked for.
fn compute_and_look(
    points: &[[f64; 3]],
    point_ids: &[i64],
    lattice: &Lattice,
    search: Search,
    fit: Fit,
    wanted: &[Feature],
    mut look: impl FnMut(u32, &[Neighbor], f64),
) -> Features {
    let grid = Grid::new(points, point_ids, lattice, search);
    let mut surroundings = Surroundings::new(points, lattice, fit, wanted);
    let mut features =
        Features { columns: vec![vec![f64::NAN; points.len()]; wanted.len()], support: vec![0.0; points.len()] };
    let (mut finder, mut found) = (grid.finder(), Vec::new());
    for &point in grid.order() {
        finder.neighbors(point, &mut found);
        let support = support(&grid, &found);
        features.support[point as usize] = support;
        look(point, &found, support);
        let local = surroundings.of(point, &found);
        for (column, &feature) in features.columns.iter_mut().zip(wanted) {
            column[point as usize] = local.value(feature);
        }
    }
    features
}

/// Fits surfaces to neighborhoods, one after the other.
struct Surroundings<'a> {
    points: &'a [[f64; 3]],
    scale: [f64; 3],
    /// Lengths of a lattice step; 0 for real coordinates.
    steps: [f64; 3],
    with_plane: bool,
    with_curvature: bool,
    robust: Option<Robust>,
    offsets: Vec<[f64; 3]>,
}

impl<'a> Surroundings<'a> {
    fn new(points: &'a [[f64; 3]], lattice: &Lattice, fit: Fit, wanted: &[Feature]) -> Self {
        let scale = lattice.scale();
        Self {
            points,
            scale,
            steps: if lattice.is_whole() { scale } else { [0.0; 3] },
            with_plane: wanted.iter().any(|&feature| feature != Feature::NeighborCount),
            with_curvature: wanted.iter().any(|feature| feature.is_curvature()),
            robust: (fit == Fit::Robust).then(Robust::default),
            offsets: Vec::new(),
        }
    }

    /// The surface through the neighbors of a point.
    fn of(&mut self, point: u32, neighbors: &[Neighbor]) -> Local {
        let mut local = Local { neighbors: neighbors.len(), plane: None, curvature: None };
        if self.with_plane {
            self.gather(point, neighbors);
            if let Some(robust) = &mut self.robust {
                robust.remove_blunders(&mut self.offsets, self.steps);
            }
            local.plane = Plane::fit(&self.offsets);
        }
        if self.with_curvature
            && let Some(plane) = &local.plane
        {
            local.curvature = Curvature::fit(&self.offsets, plane);
        }
        local
    }

    fn gather(&mut self, point: u32, neighbors: &[Neighbor]) {
        let from = self.points[point as usize];
        let (points, scale) = (self.points, self.scale);
        self.offsets.clear();
        self.offsets.extend(neighbors.iter().map(|neighbor| {
            let to = points[neighbor.point as usize];
            [(to[0] - from[0]) * scale[0], (to[1] - from[1]) * scale[1], (to[2] - from[2]) * scale[2]]
        }));
    }
}

/// What is known of the surface around a point.
struct Local {
    neighbors: usize,
    plane: Option<Plane>,
    curvature: Option<Curvature>,
}

impl Local {
    fn value(&self, feature: Feature) -> f64 {
        match feature {
            Feature::NeighborCount => self.neighbors as f64,
            feature if feature.is_curvature() => self.curvature.as_ref().map_or(f64::NAN, |c| of_curvature(c, feature)),
            feature => self.plane.as_ref().map_or(f64::NAN, |plane| of_plane(plane, feature)),
        }
    }
}

fn of_curvature(curvature: &Curvature, feature: Feature) -> f64 {
    match feature {
        Feature::GaussianCurvature => curvature.gaussian,
        Feature::MaxCurvature => curvature.max,
        Feature::MinCurvature => curvature.min,
        _ => curvature.mean,
    }
}

fn of_plane(plane: &Plane, feature: Feature) -> f64 {
    let [a, b, c] = plane.variances;
    match feature {
        Feature::NormalEigenvalue1 => a,
        Feature::NormalEigenvalue2 => b,
        Feature::NormalEigenvalue3 => c,
        // What follows would be 0/0, and PCL's surface variation is then 0.
        Feature::SurfaceVariation if a == 0.0 => 0.0,
        Feature::SurfaceVariation => c / (a + b + c),
        Feature::Linearity => (a - b) / a,
        Feature::Planarity => (b - c) / a,
        Feature::Sphericity => c / a,
        Feature::Anisotropy => (a - c) / a,
        Feature::Omnivariance if a == 0.0 => f64::NAN,
        Feature::Omnivariance => a.cbrt() * b.cbrt() * c.cbrt(),
        Feature::Eigenentropy => entropy([a, b, c]),
        _ if plane.is_line() => f64::NAN,
        Feature::NormalX => plane.normal()[0],
        Feature::NormalY => plane.normal()[1],
        Feature::NormalZ => plane.normal()[2],
        Feature::Verticality => 1.0 - plane.normal()[2],
        _ => plane.sigma0(),
    }
}

/// The entropy of how a sum is shared out.
fn entropy(parts: [f64; 3]) -> f64 {
    let sum: f64 = parts.iter().sum();
    if sum == 0.0 {
        return f64::NAN;
    }
    // Adding zero makes 0 of −0.
    let of = |share: f64| if share > 0.0 { -share * share.ln() } else { 0.0 };
    parts.iter().map(|part| of(part / sum)).sum::<f64>() + 0.0
}

#[cfg(test)]
mod tests;
