//! Random numbers that are a function of where they are used, so that a scene needs no memory of what it drew before.
//!
//! `SplitMix64` (Steele, Lea and Flood, "Fast splittable pseudorandom number generators", OOPSLA 2014,
//! doi:10.1145/2660193.2660195) both as a hash of coordinates and as a short stream. Only integer arithmetic and
//! correctly rounded float operations are used: no logarithm, sine or cosine whose last bit depends on the platform.

/// Increment of the `SplitMix64` counter: the odd integer nearest to 2⁶⁴ divided by the golden ratio.
const GOLDEN_GAMMA: u64 = 0x9e37_79b9_7f4a_7c15;

/// The output function of `SplitMix64`: a bijection of the 64-bit integers that scatters neighbours.
const fn scatter(state: u64) -> u64 {
    let state = (state ^ (state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let state = (state ^ (state >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    state ^ (state >> 31)
}

/// 64 random bits that belong to the lattice point (`a`, `b`) under `seed`.
pub(super) const fn hash(seed: u64, a: i64, b: i64) -> u64 {
    let first = scatter(seed.wrapping_add((a.cast_unsigned()).wrapping_mul(GOLDEN_GAMMA)));
    scatter(first ^ (b.cast_unsigned()).wrapping_mul(0xd6e8_feb8_6659_fd93))
}

/// The 53 high bits as a number in [0, 1); a double holds them all.
pub(super) fn to_unit(bits: u64) -> f64 {
    (bits >> 11) as f64 * (1.0 / 9_007_199_254_740_992.0)
}

/// A short stream of random numbers.
#[derive(Clone, Debug)]
pub(super) struct Random(u64);

impl Random {
    /// The stream that belongs to the lattice point (`a`, `b`) under `seed`.
    pub(super) const fn at(seed: u64, a: i64, b: i64) -> Self {
        Self(hash(seed, a, b))
    }

    const fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(GOLDEN_GAMMA);
        scatter(self.0)
    }

    /// Uniform in [0, 1).
    pub(super) fn unit(&mut self) -> f64 {
        to_unit(self.bits())
    }

    /// Uniform in [`low`, `high`).
    pub(super) fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// True with the given probability.
    pub(super) fn chance(&mut self, probability: f64) -> bool {
        self.unit() < probability
    }

    /// Nearly normal, mean 0, standard deviation 1, never beyond ±3.47: the sum of four 16-bit uniforms (Irwin–Hall).
    ///
    /// The bound is welcome here (a point cannot stray far from its object), and no logarithm is needed.
    pub(super) fn gaussian(&mut self) -> f64 {
        const MEAN: f64 = 2.0 * 65_535.0;
        const DEVIATION: f64 = 37_837.227; // 65536 · sqrt(4 / 12)
        let bits = self.bits();
        let sum: u64 = (0..4).map(|quarter| (bits >> (16 * quarter)) & 0xffff).sum();
        let sum = sum as f64;
        (sum - MEAN) / DEVIATION
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_stream_is_splitmix64() {
        // First outputs for seed 1234567 of the authors' reference implementation.
        let mut random = Random(1_234_567);
        assert_eq!(random.bits(), 6_457_827_717_110_365_317);
        assert_eq!(random.bits(), 3_203_168_211_198_807_973);
    }

    #[test]
    fn gaussian_has_the_promised_moments() {
        let mut random = Random::at(1, 2, 3);
        let draws: Vec<f64> = (0..200_000).map(|_| random.gaussian()).collect();
        let mean = draws.iter().sum::<f64>() / 200_000.0;
        let variance = draws.iter().map(|draw| (draw - mean) * (draw - mean)).sum::<f64>() / 200_000.0;
        assert!(mean.abs() < 0.01, "mean {mean}");
        assert!((variance - 1.0).abs() < 0.02, "variance {variance}");
        assert!(draws.iter().all(|draw| draw.abs() < 3.47));
    }
}
