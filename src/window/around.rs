//! Places around which the cloud has been loaded, where the rest of it has not been loaded on purpose.

use rustc_hash::{FxHashMap, FxHashSet};

/// How much of the cloud has been loaded around some places, where the rest of it has not been loaded on purpose: lengths in
/// units of the coordinates, on the map or in space, as the neighbors are sought.
#[derive(Debug, Clone, Default)]
pub struct Around {
    radii: FxHashMap<[u64; 3], f64>,
    /// Places around which there may be more at exactly the radius.
    tied: FxHashSet<[u64; 3]>,
}

impl Around {
    /// Notes that all that lies within `radius` of `place` has been loaded; at exactly the radius perhaps not all if it
    /// `is_tied`, but those with the smallest ids.
    pub fn add(&mut self, place: &[f64; 3], radius: f64, is_tied: bool) {
        self.radii.insert(place.map(f64::to_bits), radius);
        if is_tied {
            self.tied.insert(place.map(f64::to_bits));
        }
    }

    /// The same where points have been left out: then others at exactly the radius count that were not loaded.
    pub(super) fn with_less(mut self) -> Self {
        for place in std::mem::take(&mut self.tied) {
            self.radii.entry(place).and_modify(|radius| *radius = radius.next_down());
        }
        self
    }

    /// How much has been loaded around `place`; less than nothing if it is none of the places.
    pub(super) fn of(&self, place: &[f64; 3]) -> f64 {
        self.radii.get(&place.map(f64::to_bits)).copied().unwrap_or(f64::NEG_INFINITY)
    }

    pub(super) fn shrink(&mut self, margin: f64) {
        self.radii.values_mut().for_each(|radius| *radius -= margin);
    }
}
