//! The SEGMENTOR of the framework: one window in, labels out.
//!
//! A segmentor sees the points of one window and nothing else: no other window, no segment ids, no other segmentor.
//! Adding one is one file here and one line in this list.

mod coming_back;
mod conditional_clustering;
mod dbscan;
mod exactness;
mod plane_extraction;
mod proximity;
mod region_growing;

pub use coming_back::ComingBack;
pub use conditional_clustering::ConditionalClustering;
pub use dbscan::Dbscan;
pub use exactness::{Assessment, Exactness, Layout};
pub use plane_extraction::{Coplanarity, PlaneExtraction};
pub use proximity::{Graph, Proximity};
pub use region_growing::{Curvature, Form, Growth, RegionGrowing};

use std::ops::Range;

use crate::certificate::Tally;
use crate::error::{Error, Result};
use crate::front::Frontier;
use crate::label::{Cause, Labels, NONE};
use crate::neighborhood::Search;
use crate::window::{Halo, Window};

/// What a segmentor says of a window.
#[derive(Debug, Clone, PartialEq)]
pub struct Segmented {
    /// One label per point; a cause where there is none, or none yet: a later window may see more.
    pub labels: Labels,
    /// Whether each label holds a point that may be a seed; none if all do.
    pub seeded: Option<Vec<bool>>,
    /// The plane of each label, if segments of two windows are one only where their planes agree.
    pub planes: Option<Vec<Plane>>,
    /// The points that the window could not decide because it does not hold all that they depend on, ascending; none if no
    /// decision is about a point.
    pub undecided: Option<Vec<u32>>,
    /// What this window decided, and what it could not because it does not hold all that it depends on. Points are counted
    /// by whoever knows which are the window's own.
    pub tally: Tally,
    /// What later windows may decide of it, where they can.
    pub frontier: Option<Frontier>,
}

impl From<Labels> for Segmented {
    fn from(labels: Labels) -> Self {
        Self { labels, seeded: None, planes: None, undecided: None, tally: Tally::default(), frontier: None }
    }
}

impl Segmented {
    /// What is said of the points at `positions`, nothing where there is no position because the point is `lacking`.
    #[must_use]
    pub fn take(self, positions: &[Option<u32>], lacking: Cause) -> Self {
        self.take_each(positions.iter().copied(), lacking).0
    }

    /// What is said of the points in `range` only, and which of its labels the points in `others` have.
    #[must_use]
    pub fn keep(self, range: Range<usize>, others: Range<usize>) -> (Self, Vec<i32>) {
        let mut of_others = self.labels.of_points()[others].to_vec();
        let mut number = vec![NONE as i32; self.labels.count()];
        let (kept, old) = self.take_each(range.map(|position| Some(position as u32)), Cause::BySegmentor);
        for (label, &old) in (0..).zip(&old) {
            number[old as usize] = label;
        }
        of_others.iter_mut().filter(|label| **label >= 0).for_each(|label| *label = number[*label as usize]);
        (kept, of_others)
    }

    /// What is said of the points at `over`, spread over all of `points` points; the `others` have no label.
    #[must_use]
    pub fn spread(self, over: &[u32], points: usize, others: Cause) -> Self {
        let undecided = self.undecided.map(|undecided| undecided.iter().map(|&point| over[point as usize]).collect());
        Self { labels: self.labels.spread(over, points, others), undecided, ..self }
    }

    /// The same, with `more` points that could not be decided either.
    #[must_use]
    pub fn leaving_open(mut self, more: Vec<u32>) -> Self {
        self.labels.because(more.iter().copied(), Cause::Undecided);
        let undecided = self.undecided.get_or_insert_default();
        undecided.extend(more);
        undecided.sort_unstable();
        self
    }

    /// What is said of the points at `positions`, and for each of its labels which one it was.
    fn take_each(self, positions: impl Iterator<Item = Option<u32>> + Clone, lacking: Cause) -> (Self, Vec<u32>) {
        let is_among = |undecided: &[u32], at: Option<u32>| at.is_some_and(|at| undecided.binary_search(&at).is_ok());
        let undecided = self.undecided.map(|undecided| {
            let numbered = (0..).zip(positions.clone());
            // Mostly there are none, and nothing has to be looked up.
            let numbered = numbered.take(if undecided.is_empty() { 0 } else { usize::MAX });
            numbered.filter(|&(_, at)| is_among(&undecided, at)).map(|(point, _)| point).collect()
        });
        let (labels, old) = self.labels.take(positions, lacking);
        let kept = Self {
            labels,
            seeded: self.seeded.map(|seeded| old.iter().map(|&label| seeded[label as usize]).collect()),
            planes: self.planes.map(|planes| old.iter().map(|&label| planes[label as usize]).collect()),
            undecided,
            tally: self.tally,
            // Labels have other numbers now, and places may lack the points that made them what they were.
            frontier: None,
        };
        (kept, old)
    }
}

/// A plane in real coordinates, and how well it fits the points that it was adjusted to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    /// A point of the plane: the center of gravity of its points.
    pub center: [f64; 3],
    /// Its unit normal.
    pub normal: [f64; 3],
    /// Standard deviation of its points' distances, in units of the coordinates.
    pub sigma0: f64,
    /// How many points it was adjusted to.
    pub points: u64,
    /// Their covariance: xx, xy, xz, yy, yz, zz.
    pub covariance: [f64; 6],
}

impl Plane {
    /// How far the points of another plane lie from this one: the root of their mean squared distance.
    pub fn deviation_of(&self, other: &Plane) -> f64 {
        let [x, y, z] = self.normal;
        let [xx, xy, xz, yy, yz, zz] = other.covariance;
        let spread = xx * x * x + yy * y * y + zz * z * z + 2.0 * (xy * x * y + xz * x * z + yz * y * z);
        let off: f64 = (0..3).map(|k| self.normal[k] * (other.center[k] - self.center[k])).sum();
        (off * off + spread.max(0.0)).sqrt()
    }
}

/// Labels the points of one window.
pub trait Segmentor: Send + Sync {
    /// Short name, as in messages and manifests.
    fn name(&self) -> &str;

    /// Under which condition the streamed partition equals the static one.
    fn exactness(&self) -> Exactness;

    /// What has to be loaded around a window.
    fn halo(&self) -> Halo {
        self.exactness().halo()
    }

    /// Whether several windows may be segmented at the same time.
    fn is_concurrent(&self) -> bool {
        true
    }

    /// The attributes of points that it looks at beside their position: columns of the cloud or features.
    fn attributes(&self) -> Vec<String> {
        Vec::new()
    }

    /// Says where its own text names an attribute that is not among those `available`.
    ///
    /// # Errors
    /// If it does.
    fn check(&self, _available: &[String]) -> Result<()> {
        Ok(())
    }

    /// The columns of the cloud that windows have to bring along.
    fn reads(&self) -> Vec<String> {
        self.attributes()
    }

    /// The neighborhood from which features are computed that it, or a filter before it, needs and the cloud does not have.
    fn neighborhood(&self) -> Option<Search> {
        None
    }

    /// Whether it looks at the nearest neighbors itself, so that they are worth keeping where features were computed from
    /// them.
    fn looks_at_neighbors(&self) -> bool {
        false
    }

    /// How much memory it takes while it works on a window, in bytes for each point, besides the window itself: measured,
    /// so that windows can be planned. Segmentors of which nothing is known count as much as the greediest of ours.
    fn bytes_per_point(&self) -> usize {
        500
    }

    /// One label for each of [`Window::points`].
    ///
    /// # Errors
    /// If the window cannot be segmented.
    fn segment(&self, window: &Window) -> Result<Segmented>;

    /// Why a point that it has decided about may have no label.
    fn cause(&self) -> Cause {
        Cause::BySegmentor
    }

    /// Whether segments of two windows that share points and have these planes are one.
    fn agree(&self, _: &Plane, _: &Plane) -> bool {
        true
    }
}

/// Has `segmentor` label the points of `window`, and says of those without a label why.
///
/// # Errors
/// If it fails, or does not return one label for each point.
pub fn segment(segmentor: &dyn Segmentor, window: &Window) -> Result<Segmented> {
    let mut segmented = segmentor.segment(window)?;
    let (given, points) = (segmented.labels.of_points().len(), window.points().len());
    if given == points {
        segmented.labels.because(segmented.undecided.iter().flatten().copied(), Cause::Undecided);
        segmented.labels.otherwise(segmentor.cause());
        return Ok(segmented);
    }
    let problem = format!("returned {given} labels for window {} of {points} points", window.index());
    Err(Error::Labels { segmentor: segmentor.name().into(), problem })
}
