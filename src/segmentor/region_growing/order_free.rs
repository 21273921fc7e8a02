//! Region growing whatever the order: components of the graph over smooth points.
//!
//! 1. A point is *smooth* if it has a normal and its curvature is low, *rough* if it has a normal only.
//! 2. Two smooth points are joined if one is a neighbor of the other, their normals are alike, and each lies on the
//!    other's tangent plane.
//! 3. A rough point goes to the nearest smooth point of its neighbors whose normal is like its own, at equal distance to
//!    the one with the smaller point id. As with PCL it joins a region, but no region grows on from it.
//!
//! A window decides what is final: it joins a pair q ∈ N(p) if N(p) is final and the features of both are. N(q) need not be,
//! since one direction suffices. A point is decided if N(p) and the features of all in it are final: all its pairs are known
//! then, and where a rough point goes.
//!
//! Where a filter looks at features, a point without final ones may or may not take part. It is in the window all the same,
//! and whoever has it among its neighbors is not decided: without it, other neighbors would come after the ones that there
//! are, so that joining these is right either way.

use super::surface::Surface;
use super::{Neighbors, Segmented};
use crate::label::{Cause, Labels};
use crate::union_find::UnionFind;
use crate::window::Window;

/// No point.
const NOBODY: u32 = u32::MAX;

/// What a window knows of a point by itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Smooth,
    Rough,
    WithoutNormal,
    /// Its features may change with what is seen later.
    Unknown,
}

impl Kind {
    fn of(point: u32, window: &Window, surface: &Surface) -> Kind {
        if !window.is_final(point) {
            Kind::Unknown
        } else if !surface.has_normal(point) {
            Kind::WithoutNormal
        } else if surface.is_smooth(point) {
            Kind::Smooth
        } else {
            Kind::Rough
        }
    }
}

pub(super) fn segment(window: &Window, surface: &Surface, mut neighbors: Neighbors) -> Segmented {
    let points = window.points().len() as u32;
    let kinds: Vec<Kind> = (0..points).map(|point| Kind::of(point, window, surface)).collect();
    let kind = |point: u32| kinds[point as usize];
    let mut sets = UnionFind::new(points as usize);
    // A smooth point of the segment of each point.
    let mut members = vec![NOBODY; points as usize];
    let mut undecided = Vec::new();
    for point in neighbors.order() {
        let mut is_decided = kind(point) != Kind::Unknown;
        if let Kind::Smooth | Kind::Rough = kind(point) {
            let (found, support) = neighbors.of(point);
            let are_found = window.holds(&window.points()[point as usize], support);
            is_decided = are_found && found.iter().all(|&other| kind(other) != Kind::Unknown);
            let mut alike =
                found.iter().copied().filter(|&other| kind(other) == Kind::Smooth && surface.is_alike(point, other));
            if kind(point) == Kind::Smooth {
                members[point as usize] = point;
                if are_found {
                    alike
                        .filter(|&other| surface.is_on_plane(other, point) && surface.is_on_plane(point, other))
                        .for_each(|other| sets.union(point, other));
                }
            } else if is_decided {
                members[point as usize] = alike.next().unwrap_or(NOBODY);
            }
        }
        if !is_decided {
            undecided.push(point);
        }
    }
    undecided.sort_unstable();
    Segmented { undecided: Some(undecided), ..labels(&members, &sets.into_representatives()).into() }
}

fn labels(members: &[u32], representatives: &[u32]) -> Labels {
    let labelled: Vec<u32> = (0..).zip(members).filter(|(_, member)| **member != NOBODY).map(|(i, _)| i).collect();
    let of_labelled = labelled.iter().map(|&point| representatives[members[point as usize] as usize]);
    Labels::from_representatives(of_labelled, members.len()).spread(&labelled, members.len(), Cause::InNoRegion)
}
