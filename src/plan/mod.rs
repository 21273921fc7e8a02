//! A PLAN: spans and windows for a stored cloud that keep to a budget of memory wherever the cloud is dense or thin.
//!
//! 1. A [`Census`] counts the points in narrow slabs along x and along y, in one pass over the cloud.
//! 2. Spans follow each other along the axis across which fewer points have to be in memory together. A span is as many
//!    slabs as hold a small part of a window's points, so spans are wide where the cloud is thin.
//! 3. A window is as many spans as load no more points than there is room for, and two at least. Two windows share one
//!    span, which is as wide as the segmentor's reach or wider, so the partition does not depend on the plan.
//! 4. The room is what a [`Budget`] leaves for each of the windows at a time ([`Footprint`]).
//!
//! A plan depends on the cloud, the segmentor and the budget, not on the machine: how many windows are segmented at a time
//! is limited by the plan, and threads beyond that have nothing to do.

mod census;
mod layout;
mod memory;
mod words;

pub use census::{Census, Counts};
pub use layout::{PlannedWindow, windows};
use memory::READING;
pub use memory::{Budget, Footprint};

use crate::error::Result;
use crate::segmentor::{Exactness, Segmentor};
use crate::span::{Direction, SpanBy};
use crate::window::{Halo, WindowSize};

/// Windows at a time, at most.
const MOST_AT_A_TIME: usize = 8;

/// Windows of more points than this bring nothing, so rather are there more of them at a time.
const LARGE: u64 = 100_000;

/// Spans of a full window: where a little overlap is enough, and where nobody knows how much would be.
const SPANS_WITH_REACH: u64 = 16;
const SPANS_WITHOUT_REACH: u64 = 5;

/// Spans and windows for a cloud, and what they are expected to take.
#[derive(Debug, Clone)]
pub struct Plan {
    width: f64,
    direction: Direction,
    points_per_span: usize,
    size: WindowSize,
    at_a_time: usize,
    budget: Budget,
    footprint: Footprint,
    exactness: Exactness,
    halo: Halo,
    points: u64,
    slabs: usize,
    /// What the smallest windows would have to load at the most, along either axis.
    smallest: [u64; 2],
    windows: Vec<PlannedWindow>,
}

impl Plan {
    /// A plan for the cloud that was counted. The reach of the census has to be that of the segmentor.
    ///
    /// # Errors
    /// If the cloud has no point.
    pub fn new(census: &Census, segmentor: &dyn Segmentor, budget: Budget, with_history: bool) -> Result<Self> {
        let exactness = segmentor.exactness();
        let (halo, footprint) = (segmentor.halo(), Footprint::of(segmentor, with_history));
        let has_reach = exactness.reach() > 0.0 && exactness.reach().is_finite();
        let (least, parts) = if has_reach { (2, SPANS_WITH_REACH) } else { (3, SPANS_WITHOUT_REACH) };
        let size = WindowSize::new(least, 1)?;
        let smallest = census.counts().each_ref().map(|counts| most_loaded(&layout::windows(counts, 0, size, halo)));
        let axis = usize::from(smallest[1] < smallest[0]);
        let at_a_time = at_a_time(&footprint, budget, smallest[axis], segmentor.is_concurrent());
        let room = footprint.room(budget, at_a_time);
        let (size, most) = (size.with_room(room as usize), room / parts);
        let counts = &census.counts()[axis];
        Ok(Self {
            width: counts.width(),
            direction: counts.direction(),
            points_per_span: most as usize,
            size,
            at_a_time,
            budget,
            footprint,
            exactness,
            halo,
            points: census.points(),
            slabs: counts.slabs().len(),
            smallest,
            windows: layout::windows(counts, most, size, halo),
        })
    }

    /// How the cloud is to be cut.
    pub fn spans(&self) -> SpanBy {
        SpanBy::Slabs { width: self.width, direction: self.direction, points: self.points_per_span }
    }

    /// How large windows are to be.
    pub fn size(&self) -> WindowSize {
        self.size
    }

    /// How many windows may be segmented at the same time.
    pub fn at_a_time(&self) -> usize {
        self.at_a_time
    }

    /// Bytes that the windows at work may take together, and bytes of each point that they load. A window that is larger
    /// than there is room for, where the cloud is densest, then has no other beside it.
    pub fn at_work(&self) -> (u64, u64) {
        let per_point = self.footprint.work();
        (self.at_a_time as u64 * self.room() as u64 * per_point, per_point)
    }

    /// The windows that there will be.
    pub fn windows(&self) -> &[PlannedWindow] {
        &self.windows
    }

    /// The bytes that a run is expected to take at most on so many threads.
    pub fn peak(&self, threads: usize) -> u64 {
        self.footprint.peak(self.most_points(), self.working(threads))
    }

    /// One sentence, if even the smallest windows do not keep to the budget, or what comes before and after them.
    pub fn warning(&self) -> Option<String> {
        let needed = self.footprint.needed(self.most_points());
        match self.budget.bytes() {
            budget if budget < needed => Some(words::too_dense(needed, self)),
            budget if budget < READING => Some(words::too_little(self)),
            _ => None,
        }
    }

    /// Along which the slabs follow each other.
    pub fn direction(&self) -> Direction {
        self.direction
    }

    /// The width of a slab, in units of the coordinates.
    pub fn width(&self) -> f64 {
        self.width
    }

    /// Most points that the slabs of a span of several have together.
    pub fn points_per_span(&self) -> usize {
        self.points_per_span
    }

    /// How many points a window of more spans than it needs may load.
    pub fn room(&self) -> usize {
        self.size.room().unwrap_or(0)
    }

    /// How many points the window loads that loads most.
    pub fn most_points(&self) -> u64 {
        most_loaded(&self.windows)
    }

    /// How many windows so many threads work on at the same time.
    fn working(&self, threads: usize) -> usize {
        threads.min(self.at_a_time).min(self.windows.len()).max(1)
    }
}

/// As many windows at a time as leave each of them large enough, and one at least.
fn at_a_time(footprint: &Footprint, budget: Budget, smallest: u64, is_concurrent: bool) -> usize {
    let most = if is_concurrent { MOST_AT_A_TIME } else { 1 };
    let is_roomy = |at_a_time: &usize| footprint.room(budget, *at_a_time) >= LARGE.max(smallest);
    (2..=most).rev().find(is_roomy).unwrap_or(1)
}

fn most_loaded(windows: &[PlannedWindow]) -> u64 {
    windows.iter().map(|window| window.loaded).max().unwrap_or(0)
}
