//! How much may be under way at the same time: what is in flight is counted before it is taken.
//!
//! A window is in flight from when its points are gathered until it is woven. One that is done and waits for those before
//! it counts too, so whatever the scheduler does, finished windows cannot pile up.

/// Bytes that windows in flight may take.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Allowance {
    points: u64,
}

impl Allowance {
    /// As many points as take so many `bytes`, at so many `per_point`.
    pub fn new(bytes: u64, per_point: u64) -> Self {
        Self { points: bytes / per_point.max(1) }
    }

    /// Whether a window of so many points may be taken, besides those that have so many `in_flight`. A window that is too
    /// large is taken when nothing else is in flight, for it cannot be made smaller.
    pub(super) fn has_room_for(self, points: u64, in_flight: u64) -> bool {
        in_flight == 0 || in_flight.saturating_add(points) <= self.points
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_in_flight_counts_and_a_window_too_large_is_taken_alone() {
        let allowance = Allowance::new(1000, 10);
        assert!(allowance.has_room_for(60, 40) && !allowance.has_room_for(61, 40));
        assert!(allowance.has_room_for(5000, 0) && !allowance.has_room_for(5000, 1));
        assert!(!allowance.has_room_for(u64::MAX, 1));
        assert!(Allowance::new(7, 0).has_room_for(6, 1));
    }
}
