//! What a run could prove: how many of its decisions depend on nothing that was not loaded.
//!
//! A decision is about a pair of points (a Delaunay edge) or about a point (its features, whether it is an outlier, whose
//! border it is). It is *decided* when everything that it depends on has been loaded, or is known to be empty; until then it *waits*.
//! What still waits when the stream has ended is *undecided*. If nothing is, the streamed partition is the static one.

/// The decisions that came with one window.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Tally {
    /// Pairs of points decided, here or among those that had waited.
    pub decided_edges: u64,
    /// Pairs of points that wait when the window has been woven.
    pub waiting_edges: u64,
    /// The window's own points that were decided.
    pub decided_points: u64,
    /// The window's own points that wait for a later window.
    pub waiting_points: u64,
    /// Points of earlier windows, out of scope, that were brought back to be looked at again.
    pub returned_points: u64,
    /// Points decided though more of the cloud may still come to where they are.
    pub early_decisions: u64,
}

/// The decisions of a whole run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Certificate {
    /// Pairs of points decided; a pair counts in each window that decides it.
    pub decided_edges: u64,
    /// Pairs of points that wait; at the end, those that could not be decided. Where none can wait for a later window, a pair
    /// counts in each window that could not decide it.
    pub undecided_edges: u64,
    /// Points decided; a point counts in each window that decides it.
    pub decided_points: u64,
    /// Points that went out of scope before any window could decide them.
    pub undecided_points: u64,
    /// Points of earlier windows brought back to be looked at again; a point counts each time.
    pub returned_points: u64,
    /// Points that were kept until their surroundings had come, beyond the span in which they came.
    pub waited_points: u64,
    /// How many points waited at the same time, at the most.
    pub most_waiting: u64,
    /// Points decided though more of the cloud could still come to where they are.
    pub early_decisions: u64,
}

impl Certificate {
    /// Takes in a window. Where edges `wait` for later windows, those that waited before are among those that wait now, or
    /// have been decided; elsewhere nothing decides them any more.
    pub fn take_in(&mut self, window: Tally, edges_wait: bool) {
        self.decided_edges += window.decided_edges;
        self.undecided_edges = window.waiting_edges + if edges_wait { 0 } else { self.undecided_edges };
        self.decided_points += window.decided_points;
        self.returned_points += window.returned_points;
        self.early_decisions += window.early_decisions;
    }

    /// Whether nothing was left undecided, and nothing decided too early.
    pub fn is_complete(&self) -> bool {
        self.undecided_edges == 0 && self.undecided_points == 0 && self.early_decisions == 0
    }
}
