//! Plane extraction: points that lie in one plane, grown from seeds where the surface is most even.
//!
//! Source: the plane extraction of OPALS' segmentation module (Pöchtrager, TU Wien, 2016). From the best seed on, a
//! neighbor joins if it is near the plane and its normal agrees; the plane is adjusted as it grows ([`growth`]). As in
//! OPALS, that is done in each tile of the map independently ([`tiles`]), and planes of neighboring tiles are then joined
//! ([`mosaic`]). OPALS does not say when a plane is adjusted, how large a tile is and which planes are joined; here it is:
//! * when it has grown by a quarter;
//! * twenty times the search radius, unless told otherwise. Our tiles lie at absolute places and look beyond their
//!   borders, so a plane grows the same in any window that holds its tile: streamed is static;
//! * those that share points and are coplanar: the angle between them is small, and the points of the smaller one lie
//!   about the plane of the larger one with a standard deviation below that of a plane. A plane whose points in its
//!   tile fall into pieces that are no neighbors is one segment per piece, unless another tile joins them.

mod adjustment;
mod growth;
mod mosaic;
mod tiles;

use std::f64::consts::SQRT_2;

use super::{Exactness, Plane, Segmented, Segmentor};
use crate::error::{Error, Result, positive};
use crate::expression::Calculator;
use crate::label::{Cause, Labels};
use crate::neighborhood::{Grid, Search};
use crate::window::Window;
use adjustment::Sums;
use growth::Growth;
use mosaic::Mosaic;
use tiles::Tiles;

/// The attributes that are always needed.
const NEEDED: [&str; 4] = ["NormalX", "NormalY", "NormalZ", "NormalSigma0"];

/// The side of a tile, if nothing else is asked for, and the width of its margin, in search radii.
const TILE_RADII: f64 = 20.0;
const MARGIN_RADII: f64 = 2.0;

/// When points lie in one plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coplanarity {
    /// Points nearer to a plane than this may belong to it, in units of the coordinates.
    pub max_distance: f64,
    /// The standard deviation of a plane's points is below this, in units of the coordinates.
    pub max_sigma: f64,
    /// Normals that differ by up to this, or up to 2·atan(NormalSigma0) if that is more, agree.
    pub min_angle_deg: f64,
    /// The side of a tile, in units of the coordinates; none = twenty search radii.
    pub tile_size: Option<f64>,
}

impl Default for Coplanarity {
    /// Those of OPALS.
    fn default() -> Self {
        Self { max_distance: 0.05, max_sigma: 0.05, min_angle_deg: 10.0, tile_size: None }
    }
}

/// Planes grown from seeds.
#[derive(Debug, Clone)]
pub struct PlaneExtraction {
    search: Search,
    coplanarity: Coplanarity,
    seed_calculator: Calculator,
    tile_size: f64,
}

impl PlaneExtraction {
    /// What makes a point a seed, and which seed comes first, if nothing else is asked for: OPALS' default.
    pub const SEED_CALCULATOR: &str = "NormalSigma0 < 0.02 ? NormalSigma0 : invalid";

    /// Grows planes among neighbors under `search`, from seeds in ascending order of what `seed_calculator` gives.
    ///
    /// # Errors
    /// If a length is not a finite number above 0, the angle not one of 0 to 90 degrees, the tile smaller than its margin, or
    /// nothing limits how far away a neighbor can be.
    pub fn new(search: Search, coplanarity: Coplanarity, seed_calculator: Calculator) -> Result<Self> {
        let Coplanarity { max_distance, max_sigma, min_angle_deg, tile_size } = coplanarity;
        positive("max_distance", max_distance)?;
        positive("max_sigma", max_sigma)?;
        if !(0.0..=90.0).contains(&min_angle_deg) {
            return Err(Error::parameter("min_angle_deg", min_angle_deg, "0 to 90 degrees"));
        }
        let radius = search.reach();
        if radius == f64::INFINITY {
            return Err(Error::parameter("search_radius", "None", "a finite number above 0, also with k"));
        }
        let tile_size = positive("tile_size", tile_size.unwrap_or(TILE_RADII * radius))?;
        if tile_size < MARGIN_RADII * radius {
            return Err(Error::parameter("tile_size", tile_size, "at least twice the search radius"));
        }
        Ok(Self { search, coplanarity, seed_calculator, tile_size })
    }

    /// Which points are neighbors.
    pub fn search(&self) -> Search {
        self.search
    }

    /// When points lie in one plane.
    pub fn coplanarity(&self) -> Coplanarity {
        self.coplanarity
    }

    /// What makes a point a seed, and which seed comes first.
    pub fn seed_calculator(&self) -> &Calculator {
        &self.seed_calculator
    }

    /// The side of a tile, in units of the coordinates.
    pub fn tile_size(&self) -> f64 {
        self.tile_size
    }

    fn margin(&self) -> f64 {
        MARGIN_RADII * self.search.reach()
    }

    /// The turn of each point as a seed: seeds in ascending order of weight, then of point id.
    fn turns(&self, window: &Window) -> Result<Vec<Option<u32>>> {
        let calculator = self.seed_calculator.bind(|name| window.columns().get(name))?;
        let weights: Vec<f64> = (0..window.points().len()).map(|point| calculator.value(point)).collect();
        let is_seed = |&point: &u32| !weights[point as usize].is_nan() && window.is_seed(point);
        let mut seeds: Vec<u32> = (0..weights.len() as u32).filter(is_seed).collect();
        let weight = |point: u32| weights[point as usize];
        let id = |point: u32| window.point_ids()[point as usize];
        seeds.sort_unstable_by(|&a, &b| weight(a).total_cmp(&weight(b)).then_with(|| id(a).cmp(&id(b))));
        let mut turns = vec![None; weights.len()];
        for (seed, turn) in seeds.into_iter().zip(0..) {
            turns[seed as usize] = Some(turn);
        }
        Ok(turns)
    }
}

fn column<'a>(window: &'a Window, name: &str) -> Result<&'a [f64]> {
    let names = || window.columns().names().map(ToString::to_string).collect::<Vec<String>>();
    window.columns().get(name).ok_or_else(|| Error::unknown_attribute(name, &names()))
}

impl Segmentor for PlaneExtraction {
    fn name(&self) -> &'static str {
        "plane extraction"
    }

    fn exactness(&self) -> Exactness {
        let reach = self.search.reach();
        // From any point of a tile to the farthest corner that has to be loaded.
        Exactness::WithHalo { reach, halo: SQRT_2 * (self.tile_size + self.margin() + reach) }
    }

    fn attributes(&self) -> Vec<String> {
        NEEDED.into_iter().chain(self.seed_calculator.attributes()).map(ToString::to_string).collect()
    }

    fn check(&self, available: &[String]) -> Result<()> {
        self.seed_calculator.check(available)
    }

    fn neighborhood(&self) -> Option<Search> {
        Some(self.search)
    }

    fn bytes_per_point(&self) -> usize {
        Grid::BYTES_PER_POINT + 110
    }

    fn cause(&self) -> Cause {
        Cause::InNoPlane
    }

    fn segment(&self, window: &Window) -> Result<Segmented> {
        let [x, y, z, sigmas] = NEEDED.map(|name| column(window, name));
        let turns = self.turns(window)?;
        let points = window.points();
        let grid = Grid::new(points, window.point_ids(), window.lattice(), self.search);
        let mut growth = Growth::new(window, &grid, [x?, y?, z?], sigmas?, self.coplanarity);
        let tiles = Tiles::new(window, self.tile_size, self.margin());
        let mut mosaic = Mosaic::new(points.len());
        let mut undecided = Vec::new();
        for (tile, core) in tiles.iter() {
            if !tiles.is_loaded(tile, self.search.reach()) {
                undecided.extend_from_slice(core);
                continue;
            }
            let surroundings = tiles.surroundings(tile);
            let mut seeds: Vec<u32> = surroundings.iter().copied().filter(|&i| turns[i as usize].is_some()).collect();
            seeds.sort_unstable_by_key(|&point| turns[point as usize]);
            for patch in growth.grow_among(&surroundings, &seeds) {
                mosaic.take_in(patch, &grid, |point| tiles.tile(point) == tile);
            }
        }
        let labels = mosaic.labels(&grid, |a, b| self.agree(a, b));
        // What is grown in space is the same in all windows: sharing points is enough. Elsewhere planes have to agree.
        let planes = window.extent().is_none().then(|| planes(window, &labels, &mosaic));
        undecided.sort_unstable();
        Ok(Segmented { planes, undecided: Some(undecided), ..labels.into() })
    }

    /// Planes agree if the angle between them is small and the points of the smaller one lie about the larger one with a
    /// small standard deviation. It is the larger one that is carried on to the smaller one's place.
    fn agree(&self, a: &Plane, b: &Plane) -> bool {
        let cosine: f64 = a.normal.iter().zip(b.normal).map(|(a, b)| a * b).sum();
        let fits = |smaller: &Plane, larger: &Plane| {
            smaller.points > larger.points || larger.deviation_of(smaller) < self.coplanarity.max_sigma
        };
        cosine.abs() >= self.coplanarity.min_angle_deg.to_radians().cos() && fits(a, b) && fits(b, a)
    }
}

/// The plane of each label, adjusted to all its points.
fn planes(window: &Window, labels: &Labels, mosaic: &Mosaic) -> Vec<Plane> {
    let lattice = window.lattice();
    let mut sums: Vec<Option<(u32, Sums)>> = vec![None; labels.count()];
    for (point, &label) in (0..).zip(labels.of_points()) {
        if label >= 0 {
            let (first, sums) = sums[label as usize].get_or_insert((point, Sums::default()));
            sums.add(lattice.offset_between(&window.points()[*first as usize], &window.points()[point as usize]));
        }
    }
    let plane = |(first, sums): (u32, Sums)| match sums.adjust() {
        Some(adjusted) => adjusted.plane(lattice.real(&window.points()[first as usize]), &sums),
        // A tile may hold a line of a patch only.
        None => *mosaic.plane_of(first),
    };
    sums.into_iter().flatten().map(plane).collect()
}
