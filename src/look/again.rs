//! Looks again at points that a window could not decide, with all that they depend on.
//!
//! Where neighbors are the k nearest points however far they are, no halo is wide enough for all of them: an isolated point
//! may have its neighbors anywhere. So its k nearest points are sought in the whole cloud, and the k nearest of those, from
//! which their features come; these few points are a window of their own, which decides it. How much that is depends on k
//! alone, not on how far away they are.
//!
//! With a filter some of the points found are no neighbors, and then twice as many are sought, and so on.

use std::collections::BTreeMap;
use std::sync::Arc;

use rustc_hash::{FxHashMap, FxHashSet};

use super::nearest::{Nearest, Search, Stored};
use super::{Look, Said, Sight, sees_beyond};
use crate::error::Result;
use crate::label::Cause;
use crate::lattice::Lattice;
use crate::neighborhood;
use crate::segmentor::{Segmentor, segment};
use crate::span::{Archive, PointIds, Span};
use crate::window::{Around, Window};

/// How many points are found for others at a time, and looked at together: some tens of megabytes.
const MOST_FOUND: usize = 1 << 20;

/// Nobody's neighbors are sought among more than this many times as many points.
const MOST_TIMES: usize = 32;

/// Looks again at single points, with a stored cloud at hand.
#[derive(Clone)]
pub struct LookAgain {
    segmentor: Arc<dyn Segmentor>,
    archive: Arc<dyn Archive>,
    lattice: Lattice,
    /// Names of the spans' attributes.
    names: Vec<String>,
    /// How many neighbors are looked at, and whether on the map.
    neighbors: usize,
    flat: bool,
}

/// The part of a window that is looked at again.
struct Part {
    window: Window,
    /// Where its points are, one by one.
    stored: Vec<Stored>,
}

impl LookAgain {
    /// With all that is needed to find a point's neighbors on `lattice`; none if the segmentor does not ask for the nearest
    /// ones, however far, or there is no archive.
    pub fn new(
        segmentor: &Arc<dyn Segmentor>,
        archive: impl FnOnce() -> Option<Arc<dyn Archive>>,
        lattice: Lattice,
    ) -> Option<Self> {
        match segmentor.neighborhood() {
            Some(neighborhood::Search::Nearest { k, flat, within: f64::INFINITY })
                if sees_beyond(segmentor.exactness()) =>
            {
                let (segmentor, names) = (Arc::clone(segmentor), Vec::new());
                Some(Self { segmentor, archive: archive()?, lattice, names, neighbors: k, flat })
            }
            _ => None,
        }
    }

    /// Names the attributes of the spans.
    #[must_use]
    pub fn with_attributes(self, names: &[String]) -> Self {
        Self { names: names.to_vec(), ..self }
    }

    /// Looks again at `points`, which are positions among the own points of a window with the spans `own`; adds what is found
    /// to what `look` has shown.
    ///
    /// # Errors
    /// If the cloud cannot be read again, or the segmentor fails.
    pub fn look(&self, window: u64, own: &[Arc<Span>], look: Look, points: &[u32]) -> Result<Look> {
        let mut said = Said::from(look);
        let mut open = stored(own, points);
        for times in (0..).map(|doubled| 1 << doubled).take_while(|times| *times <= MOST_TIMES) {
            let k = self.neighbors * times;
            let mut left = Vec::new();
            for some in open.chunks((MOST_FOUND / (k * k)).max(1)) {
                let part = self.part(window, some, k)?;
                left.extend(self.decide(&part, some, own, &mut said)?);
            }
            open = left;
            if open.is_empty() {
                break;
            }
        }
        Ok(said.together())
    }

    /// Some points with the `k` nearest of each, and with the `k` nearest of those.
    fn part(&self, window: u64, points: &[Stored], k: usize) -> Result<Part> {
        let search = Search::new(&*self.archive, &self.lattice, self.flat, k - 1);
        let (mut around, mut places) = (Around::default(), FxHashSet::default());
        let mut loaded: FxHashMap<i64, Stored> = points.iter().map(|point| (point.point_id, *point)).collect();
        let mut found_for: FxHashSet<i64> = FxHashSet::default();
        let mut next = points.to_vec();
        let mut is_first = true;
        while !next.is_empty() {
            for some in next.chunks((MOST_FOUND / k).max(1)) {
                for (point, Nearest { points, radius, is_tied }) in some.iter().zip(search.nearest(some)?) {
                    around.add(&point.place, radius, is_tied);
                    places.insert(point.place.map(f64::to_bits));
                    found_for.insert(point.point_id);
                    loaded.extend(points.into_iter().map(|stored| (stored.point_id, stored)));
                }
            }
            // What is known around a place has to be true of all points there: they may have other neighbors each, where many
            // more than k are at one place.
            let is_next = |point: &&Stored| is_first || places.contains(&point.place.map(f64::to_bits));
            next =
                loaded.values().filter(|point| !found_for.contains(&point.point_id)).filter(is_next).copied().collect();
            next.sort_unstable_by_key(|point| point.point_id);
            is_first = false;
        }
        let mut stored: Vec<Stored> = loaded.into_values().collect();
        stored.sort_unstable_by_key(|point| point.point_id);
        let span = Arc::new(self.gathered(&stored)?);
        let window = Window::with_halo(window, vec![span], 0..1, self.lattice, &self.names).with_around(around);
        Ok(Part { window, stored })
    }

    /// Points of the archive as a span, with their attributes.
    fn gathered(&self, points: &[Stored]) -> Result<Span> {
        let mut attributes = vec![vec![f64::NAN; points.len()]; self.names.len()];
        let mut by_span: BTreeMap<u64, Vec<usize>> = BTreeMap::new();
        for (at, point) in points.iter().enumerate().filter(|_| !self.names.is_empty()) {
            by_span.entry(point.span).or_default().push(at);
        }
        for (index, members) in by_span {
            let span = self.archive.read(index)?;
            for (values, of_span) in attributes.iter_mut().zip(&span.attributes) {
                for &at in &members {
                    values[at] = of_span[points[at].position as usize];
                }
            }
        }
        Ok(Span {
            index: 0,
            point_ids: PointIds::Listed(points.iter().map(|point| point.point_id).collect()),
            points: points.iter().map(|point| point.place).collect(),
            attributes,
            extent: None,
        })
    }

    /// Has a part segmented and adds what it says of `points`, which are some of its own; returns those that it could not
    /// decide either.
    fn decide(&self, part: &Part, points: &[Stored], own: &[Arc<Span>], said: &mut Said) -> Result<Vec<Stored>> {
        let segmented = segment(&*self.segmentor, &part.window)?;
        let undecided = segmented.undecided.unwrap_or_default();
        let at = |point: &Stored| part.stored.binary_search_by_key(&point.point_id, |stored| stored.point_id);
        let is_undecided = |point: &Stored| at(point).is_ok_and(|at| undecided.binary_search(&(at as u32)).is_ok());
        let (left, decided): (Vec<Stored>, Vec<Stored>) = points.iter().partition(|point| is_undecided(point));

        // Only labels that a decided point has are anything new.
        let labels = segmented.labels.of_points();
        let mut number = FxHashMap::default();
        for label in decided.iter().filter_map(|point| at(point).ok()).map(|at| labels[at]).filter(|label| *label >= 0)
        {
            let is_seeded = segmented.seeded.as_ref().is_none_or(|seeded| seeded[label as usize]);
            number.entry(label).or_insert_with(|| said.add_label(is_seeded));
        }
        for (point, label) in part.stored.iter().zip(labels) {
            if let Some(&label) = number.get(label) {
                match position_among(own, point) {
                    Some(position) => said.label(position, label),
                    None => said.see(Sight { label, span: point.span, position: point.position }),
                }
            }
        }
        for point in &decided {
            let cause = at(point).ok().and_then(|at| Cause::of_label(labels[at]));
            if let (Some(position), Some(cause)) = (position_among(own, point), cause) {
                said.explain(position, cause);
            }
        }
        let mut positions: Vec<u32> = decided.iter().filter_map(|point| position_among(own, point)).collect();
        positions.sort_unstable();
        said.decide(&positions, (part.stored.len() - points.len()) as u64);
        Ok(left)
    }
}

/// Own points of a window by where they are in the cloud.
fn stored(own: &[Arc<Span>], points: &[u32]) -> Vec<Stored> {
    let mut firsts = Vec::new();
    let mut total = 0;
    for span in own {
        firsts.push(total);
        total += span.len();
    }
    let stored = |&point: &u32| {
        let at = firsts.partition_point(|first| *first <= point as usize) - 1;
        let (span, position) = (&own[at], point as usize - firsts[at]);
        let (point_id, place) = (span.point_id(position), span.points[position]);
        Stored { span: span.index, position: position as u32, point_id, place }
    };
    points.iter().map(stored).collect()
}

/// Where a point is among the own points of a window, if it is one.
fn position_among(own: &[Arc<Span>], point: &Stored) -> Option<u32> {
    let first = own.first()?.index;
    let at = point.span.checked_sub(first).filter(|at| *at < own.len() as u64)? as usize;
    let before: usize = own[..at].iter().map(|span| span.len()).sum();
    Some(before as u32 + point.position)
}
