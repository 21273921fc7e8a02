//! Which pairs of places are Delaunay neighbors, decided for each pair with exact arithmetic.
//!
//! The circles through p and q have their centers at m + t·n on the bisector. A point r to the left of pq lies strictly
//! outside as long as t < t(r), one to the right as long as t > t(r), with t(r) ~ (r−p)·(r−q) / (q−p)×(r−p). So the pair
//! is *strictly* Delaunay (part of every triangulation) if the greatest t(r) to the right is less than the least to the
//! left, and *weakly* (part of some) if it is not greater.

use std::cmp::Ordering;

/// A pair of places on the map.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Adjacency {
    /// Equal xy: one vertex.
    Coincident,
    /// In every Delaunay triangulation.
    Strict,
    /// In some, because of points on one circle.
    Weak,
    /// In none.
    None,
}

/// How the places of points `p` and `q` of the cloud are related.
pub fn adjacency(points: &[[i64; 3]], p: usize, q: usize) -> Adjacency {
    let (p, q) = (xy(points[p]), xy(points[q]));
    if p == q {
        return Adjacency::Coincident;
    }
    let (mut right, mut left): (Option<Ratio>, Option<Ratio>) = (None, None);
    for r in points.iter().map(|point| xy(*point)).filter(|&r| r != p && r != q) {
        let dot = (r[0] - p[0]) * (r[0] - q[0]) + (r[1] - p[1]) * (r[1] - q[1]);
        let cross = (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
        match cross.cmp(&0) {
            Ordering::Equal if dot < 0 => return Adjacency::None,
            Ordering::Equal => {}
            Ordering::Greater => left = Some(least(left, Ratio(dot, cross))),
            Ordering::Less => right = Some(greatest(right, Ratio(-dot, -cross))),
        }
    }
    match (right, left) {
        (Some(right), Some(left)) => match right.compare(left) {
            Ordering::Less => Adjacency::Strict,
            Ordering::Equal => Adjacency::Weak,
            Ordering::Greater => Adjacency::None,
        },
        _ => Adjacency::Strict,
    }
}

/// Whether no other point lies in the closed disc whose diameter is the pair: its smallest circle proves the edge.
pub fn is_gabriel(points: &[[i64; 3]], p: usize, q: usize) -> bool {
    let (p, q) = (xy(points[p]), xy(points[q]));
    let outside = |r: [i128; 2]| (r[0] - p[0]) * (r[0] - q[0]) + (r[1] - p[1]) * (r[1] - q[1]) > 0;
    p != q && points.iter().map(|point| xy(*point)).all(|r| r == p || r == q || outside(r))
}

fn xy(point: [i64; 3]) -> [i128; 2] {
    [point[0].into(), point[1].into()]
}

/// A fraction with a denominator above 0.
#[derive(Debug, Clone, Copy)]
struct Ratio(i128, i128);

impl Ratio {
    fn compare(self, other: Ratio) -> Ordering {
        (self.0 * other.1).cmp(&(other.0 * self.1))
    }
}

fn least(a: Option<Ratio>, b: Ratio) -> Ratio {
    a.filter(|a| a.compare(b).is_lt()).unwrap_or(b)
}

fn greatest(a: Option<Ratio>, b: Ratio) -> Ratio {
    a.filter(|a| a.compare(b).is_gt()).unwrap_or(b)
}
