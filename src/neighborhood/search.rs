//! Which points count as the neighbors of a point.

use crate::error::{Error, Result, at_least_one, positive};

/// More neighbors than this are a slip.
const MOST_NEIGHBORS: usize = 100_000;

/// The region around a point, or the number of nearest points, in which others are its neighbors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Search {
    /// All points within `radius` on the map: an infinite cylinder ("2d").
    Disc {
        /// In units of the coordinates.
        radius: f64,
    },
    /// All points within `radius` on the map whose height differs by `low` to `high` ("2.5d").
    Cylinder {
        /// In units of the coordinates.
        radius: f64,
        /// Lowest height of a neighbor above the point; mostly below 0.
        low: f64,
        /// Greatest height of a neighbor above the point.
        high: f64,
    },
    /// All points within `radius` in space ("3d").
    Ball {
        /// In units of the coordinates.
        radius: f64,
    },
    /// The `k` nearest points, the point itself being the first of them; at equal distance the smaller point id.
    Nearest {
        /// How many, the point itself included.
        k: usize,
        /// Whether distances are taken on the map instead of in space.
        flat: bool,
        /// Points farther away than this are no neighbors; ∞ = no limit.
        within: f64,
    },
}

impl Search {
    /// All points within `radius` in space.
    ///
    /// # Errors
    /// If the radius is not a finite number above 0.
    pub fn ball(radius: f64) -> Result<Self> {
        Ok(Search::Ball { radius: positive("search_radius", radius)? })
    }

    /// All points within `radius` on the map.
    ///
    /// # Errors
    /// If the radius is not a finite number above 0.
    pub fn disc(radius: f64) -> Result<Self> {
        Ok(Search::Disc { radius: positive("search_radius", radius)? })
    }

    /// All points within `radius` on the map and `low` to `high` above the point.
    ///
    /// # Errors
    /// If the radius is not a finite number above 0, or 0 is not between `low` and `high`.
    pub fn cylinder(radius: f64, low: f64, high: f64) -> Result<Self> {
        if !(low.is_finite() && high.is_finite() && low <= 0.0 && 0.0 <= high) {
            let given = format!("[{radius}, {low}, {high}]");
            let allowed = "[radius, lowest, highest] with lowest <= 0 <= highest, or [radius, height], or [radius]";
            return Err(Error::parameter("search_radius", given, allowed));
        }
        Ok(Search::Cylinder { radius: positive("search_radius", radius)?, low, high })
    }

    /// The `k` nearest points in space, the point itself included, none farther than `within`.
    ///
    /// # Errors
    /// If `k` is 0 or above 100 000, or `within` is not above 0.
    pub fn nearest(k: usize, within: Option<f64>) -> Result<Self> {
        let within = within.map_or(Ok(f64::INFINITY), |within| positive("search_radius", within))?;
        if k > MOST_NEIGHBORS {
            return Err(Error::parameter("k", k, "a whole number of 1 to 100000"));
        }
        Ok(Search::Nearest { k: at_least_one("k", k)?, flat: false, within })
    }

    /// How far away on the map a neighbor can be, in units of the coordinates; ∞ if there is no limit.
    pub fn reach(&self) -> f64 {
        match *self {
            Search::Disc { radius } | Search::Cylinder { radius, .. } | Search::Ball { radius } => radius,
            Search::Nearest { within, .. } => within,
        }
    }

    /// Whether q is a neighbor of p exactly when p is one of q.
    pub fn is_symmetric(&self) -> bool {
        match *self {
            Search::Disc { .. } | Search::Ball { .. } => true,
            Search::Cylinder { low, high, .. } => low == -high,
            Search::Nearest { .. } => false,
        }
    }
}
