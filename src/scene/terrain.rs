//! Ground that rolls: smooth noise as a height field, and where a ray meets such a field.
//!
//! Value noise: random values on a square lattice, blended by Perlin's quintic (Perlin, "Improving noise", SIGGRAPH 2002,
//! doi:10.1145/566654.566636), so that heights and slopes are continuous. Some octaves of it make a landscape.

use super::geometry::Ray;
use super::random::{hash, to_unit};

/// Smooth random values in [−1, 1] with one lattice cell per unit length.
#[derive(Clone, Copy, Debug)]
pub(super) struct Noise {
    seed: u64,
}

impl Noise {
    /// A field of its own for each seed.
    pub(super) const fn new(seed: u64) -> Self {
        Self { seed }
    }

    /// The value at a point of the plane.
    pub(super) fn at(self, x: f64, y: f64) -> f64 {
        let (column, x_share) = split(x);
        let (row, y_share) = split(y);
        let corner = |step_x, step_y| to_unit(hash(self.seed, column + step_x, row + step_y));
        let (across, up) = (fade(x_share), fade(y_share));
        let lower = corner(0, 0) + (corner(1, 0) - corner(0, 0)) * across;
        let upper = corner(0, 1) + (corner(1, 1) - corner(0, 1)) * across;
        2.0 * (lower + (upper - lower) * up) - 1.0
    }

    /// The value at a point of a line.
    pub(super) fn along(self, x: f64) -> f64 {
        let (column, share) = split(x);
        let (start, end) = (to_unit(hash(self.seed, column, 0)), to_unit(hash(self.seed, column + 1, 0)));
        2.0 * (start + (end - start) * fade(share)) - 1.0
    }
}

/// Whole and fractional part.
fn split(x: f64) -> (i64, f64) {
    let whole = x.floor();
    (whole as i64, x - whole)
}

/// Perlin's quintic: 0 to 1 with slope and curvature zero at both ends.
fn fade(share: f64) -> f64 {
    share * share * share * (share * (share * 6.0 - 15.0) + 10.0)
}

/// Rolling countryside: hills, hummocks and bumps, heights in metres.
#[derive(Clone, Copy, Debug)]
pub(super) struct Terrain {
    noise: Noise,
}

impl Terrain {
    /// Mean height, metres above the vertical datum.
    const ELEVATION: f64 = 250.0;
    /// Wavelength and amplitude of each octave, metres.
    const OCTAVES: [(f64, f64); 3] = [(390.0, 13.0), (110.0, 2.6), (23.0, 0.22)];

    /// A terrain of its own for each seed.
    pub(super) const fn new(seed: u64) -> Self {
        Self { noise: Noise::new(seed) }
    }

    /// Height of the ground, metres.
    pub(super) fn height(self, x: f64, y: f64) -> f64 {
        let mut height = Self::ELEVATION;
        for (wavelength, amplitude) in Self::OCTAVES {
            // Turned (3-4-5 triangle) and shifted, so that the lattice shows neither along nor across the track.
            let (along, across) = (0.8 * x - 0.6 * y + 0.37 * wavelength, 0.6 * x + 0.8 * y + 0.19 * wavelength);
            height += amplitude * self.noise.at(along / wavelength, across / wavelength);
        }
        height
    }
}

/// Distance along a downward ray to a smooth height field, in metres; `None` beyond `reach` or if it gets away.
///
/// Secant steps from `guess`: three evaluations are enough where the ray is steeper than the ground.
pub(super) fn meet(height: impl Fn(f64, f64) -> f64, ray: &Ray, guess: f64, reach: f64) -> Option<f64> {
    /// Heights are right to a tenth of the lattice.
    const TOLERANCE: f64 = 1e-4;
    let fall = ray.direction[2];
    if fall > -1e-3 {
        return None;
    }
    let clearance = |distance: f64| {
        let [x, y, z] = ray.at(distance);
        z - height(x, y)
    };
    let mut last = guess.min(reach);
    let mut last_clearance = clearance(last);
    let mut next = last - last_clearance / fall;
    for _ in 0..10 {
        let next_clearance = clearance(next);
        if next_clearance.abs() < TOLERANCE {
            return (next > 0.0 && next < reach).then_some(next);
        }
        let rate = (next_clearance - last_clearance) / (next - last);
        if rate > -1e-4 || !rate.is_finite() {
            return None; // the ground falls away as fast as the ray
        }
        (last, last_clearance) = (next, next_clearance);
        next = (next - next_clearance / rate).min(2.0 * reach);
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_continuous_across_cells() {
        let noise = Noise::new(5);
        for cell in -20..20 {
            let edge = f64::from(cell);
            assert!((noise.at(edge - 1e-7, 0.3) - noise.at(edge + 1e-7, 0.3)).abs() < 1e-5);
            assert!((noise.along(edge - 1e-7) - noise.along(edge + 1e-7)).abs() < 1e-5);
        }
    }

    #[test]
    fn a_met_point_lies_on_the_ground() {
        let terrain = Terrain::new(3);
        let height = |x: f64, y: f64| terrain.height(x, y);
        for step in 0..100 {
            let across = f64::from(step) * 0.006 - 0.3;
            let length = (1.0 + across * across).sqrt();
            let direction = [0.0, across / length, -1.0 / length];
            let ray = Ray { origin: [f64::from(step) * 7.0, 0.0, 560.0], direction, aperture: 0.0, spread: 0.0 };
            let met = meet(height, &ray, 300.0, 800.0).expect("a steep ray meets the ground");
            let [x, y, z] = ray.at(met);
            assert!((z - terrain.height(x, y)).abs() < 1e-4);
        }
    }
}
