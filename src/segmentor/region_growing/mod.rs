//! Region growing: segments are smooth pieces of surface, bounded by edges and roughness.
//!
//! Source: Rabbani, van den Heuvel and Vosselman (2006), in the form that PCL gave it; seeds by least curvature, also by
//! principal curvatures, as in improved region growing (ISPRS Archives XLII-3/W10, 2020). Neighbors whose normals differ by
//! no more than an angle belong together, and a region does not grow on from points of high curvature.
//!
//! There are two forms. PCL's loop (`literal`) gives a rough point to whichever region comes first, so its result
//! depends on the order of everything. The form of ours (`order_free`) asks the same questions of the whole graph at once,
//! and its answer depends on the points alone.
//!
//! Why the order-free form can be streamed: a pair q ∈ N(p) needs the features of both and N(p). If neighbors are no
//! farther than r, the features need what lies within r of a point (which the recipe asks for), and N(p) another r; so
//! with a halo of that much, all pairs of a window's own points are decided as in the whole cloud, and pairs within r
//! share a window if windows overlap by r.

mod literal;
mod order_free;
mod surface;

use super::{Exactness, Segmented, Segmentor};
use crate::error::{Error, Result};
use crate::label::Cause;
use crate::neighborhood::{Grid, Neighbor, Neighborhoods, Search, support};
use crate::window::Window;
use surface::Surface;

/// Which curvature tells smooth points from rough ones.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Curvature {
    /// λ₃/(λ₁ + λ₂ + λ₃), from 0 to 1/3: what PCL calls curvature.
    #[default]
    SurfaceVariation,
    /// The greater of the two principal curvatures, whatever its sign, in 1/units of the coordinates.
    Principal,
}

impl Curvature {
    /// Its name as users type it.
    pub fn name(self) -> &'static str {
        match self {
            Curvature::SurfaceVariation => "surface_variation",
            Curvature::Principal => "principal",
        }
    }

    fn attributes(self) -> &'static [&'static str] {
        match self {
            Curvature::SurfaceVariation => &["SurfaceVariation"],
            Curvature::Principal => &["MaxCurvature", "MinCurvature"],
        }
    }
}

impl std::str::FromStr for Curvature {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        [Curvature::SurfaceVariation, Curvature::Principal]
            .into_iter()
            .find(|curvature| curvature.name() == text)
            .ok_or_else(|| Error::parameter("curvature", format!("'{text}'"), "'surface_variation' or 'principal'"))
    }
}

/// How regions come about.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Form {
    /// From all pairs at once, whatever the order of the points.
    #[default]
    OrderFree,
    /// One after the other, by PCL's loop.
    Literal {
        /// Whether normals are compared with the point that the region grows on from, or else with the region's first.
        smooth: bool,
    },
}

/// The parameters of region growing; the defaults are PCL's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Growth {
    /// Which points are neighbors.
    pub search: Search,
    /// Greatest angle between the normals of neighbors in a region, in degrees.
    pub angle_deg: f64,
    /// Which curvature.
    pub curvature: Curvature,
    /// Regions grow on from points of at most this curvature; none = from all points.
    pub max_curvature: Option<f64>,
    /// Regions grow on to neighbors at most this far from the tangent plane, in units of the coordinates; none =
    /// however far.
    pub residual: Option<f64>,
    /// How regions come about.
    pub form: Form,
}

impl Default for Growth {
    fn default() -> Self {
        Self {
            search: Search::Nearest { k: 30, flat: false, within: f64::INFINITY },
            angle_deg: 30.0,
            curvature: Curvature::SurfaceVariation,
            max_curvature: Some(0.05),
            residual: None,
            form: Form::OrderFree,
        }
    }
}

/// Smooth pieces of surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RegionGrowing {
    growth: Growth,
}

impl RegionGrowing {
    /// Grows regions by these parameters.
    ///
    /// # Errors
    /// If the angle is not between 0 and 90 degrees, or a threshold is not a finite number of at least 0.
    pub fn new(growth: Growth) -> Result<Self> {
        if !(0.0..=90.0).contains(&growth.angle_deg) {
            return Err(Error::parameter("angle_deg", growth.angle_deg, "degrees from 0 to 90"));
        }
        for (name, limit) in [("max_curvature", growth.max_curvature), ("residual", growth.residual)] {
            if let Some(limit) = limit
                && !(limit.is_finite() && limit >= 0.0)
            {
                return Err(Error::parameter(name, limit, "a finite number of at least 0, or None for no limit"));
            }
        }
        Ok(Self { growth })
    }

    /// The parameters.
    pub fn growth(&self) -> &Growth {
        &self.growth
    }
}

impl Segmentor for RegionGrowing {
    fn name(&self) -> &'static str {
        "region growing"
    }

    fn exactness(&self) -> Exactness {
        let reach = self.growth.search.reach();
        match self.growth.form {
            Form::OrderFree => Exactness::WithHalo { reach, halo: reach },
            Form::Literal { .. } => {
                Exactness::Measured { reach: if reach.is_finite() { reach } else { 0.0 }, halo: reach }
            }
        }
    }

    fn attributes(&self) -> Vec<String> {
        let names = ["NormalX", "NormalY", "NormalZ"].iter().chain(self.growth.curvature.attributes());
        names.map(ToString::to_string).collect()
    }

    fn neighborhood(&self) -> Option<Search> {
        Some(self.growth.search)
    }

    fn looks_at_neighbors(&self) -> bool {
        true
    }

    fn bytes_per_point(&self) -> usize {
        Grid::BYTES_PER_POINT + 60
    }

    fn cause(&self) -> Cause {
        match self.growth.form {
            Form::OrderFree => Cause::InNoRegion,
            Form::Literal { .. } => Cause::NoSeed,
        }
    }

    fn segment(&self, window: &Window) -> Result<Segmented> {
        let surface = Surface::new(window, &self.growth)?;
        let neighbors = Neighbors::new(window, self.growth.search);
        Ok(match self.growth.form {
            Form::OrderFree => order_free::segment(window, &surface, neighbors),
            Form::Literal { smooth } => literal::segment(window, &surface, neighbors, smooth),
        })
    }
}

/// The neighbors of each point: looked up where they have been kept, or else searched for.
enum Neighbors<'a> {
    Kept(&'a Neighborhoods),
    Searched { grid: Box<Grid<'a>>, found: Vec<Neighbor>, points: Vec<u32> },
}

impl<'a> Neighbors<'a> {
    fn new(window: &'a Window, search: Search) -> Self {
        match window.neighborhoods() {
            Some(kept) if kept.search() == search => Neighbors::Kept(kept),
            _ => {
                let grid = Grid::new(window.points(), window.point_ids(), window.lattice(), search);
                Neighbors::Searched { grid: Box::new(grid), found: Vec::new(), points: Vec::new() }
            }
        }
    }

    /// All points, those near each other mostly one after the other.
    fn order(&self) -> Vec<u32> {
        match self {
            Neighbors::Kept(kept) => kept.order().to_vec(),
            Neighbors::Searched { grid, .. } => grid.order().to_vec(),
        }
    }

    /// The neighbors of `point` in ascending order of (distance, point id), the point itself being the first; and how far
    /// around it something could change them.
    fn of(&mut self, point: u32) -> (&[u32], f64) {
        match self {
            Neighbors::Kept(kept) => (kept.of(point), kept.support(point)),
            Neighbors::Searched { grid, found, points } => {
                grid.neighbors(point, found);
                points.clear();
                points.extend(found.iter().map(|neighbor| neighbor.point));
                (points, support(grid, found))
            }
        }
    }
}
