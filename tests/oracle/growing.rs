//! Region growing from its definitions: all pairs looked at, nothing clever.

use super::partition::components;

/// Lattice coordinates.
type Place = [i64; 3];

/// The neighbors of each point in ascending order of (distance, number), the point itself being the first: no more than
/// `k`, none beyond the squared distance.
pub fn neighbors(points: &[Place], k: Option<usize>, squared: Option<i64>) -> Vec<Vec<usize>> {
    let distance = |p: usize, q: usize| (0..3).map(|axis| (points[p][axis] - points[q][axis]).pow(2)).sum::<i64>();
    (0..points.len())
        .map(|p| {
            let near = |q: &usize| squared.is_none_or(|squared| distance(p, *q) <= squared);
            let mut found: Vec<usize> = (0..points.len()).filter(near).collect();
            found.sort_by_key(|&q| (distance(p, q), q != p, q));
            found.truncate(k.unwrap_or(usize::MAX));
            found
        })
        .collect()
}

/// What is known of the surface, and the limits.
pub struct Surface {
    pub points: Vec<[f64; 3]>,
    pub scale: [f64; 3],
    pub normals: Vec<[f64; 3]>,
    pub curvatures: Vec<f64>,
    pub least_cosine: f64,
    pub max_curvature: f64,
    pub is_limited: bool,
    pub residual: f64,
}

impl Surface {
    fn has_normal(&self, p: usize) -> bool {
        !self.normals[p][0].is_nan()
    }

    fn is_flat(&self, p: usize) -> bool {
        !self.is_limited || self.curvatures[p] <= self.max_curvature
    }

    fn alike(&self, p: usize, q: usize) -> bool {
        let product: f64 = (0..3).map(|axis| self.normals[p][axis] * self.normals[q][axis]).sum();
        product.abs() >= self.least_cosine
    }

    /// Whether q is near the tangent plane at p.
    fn near(&self, p: usize, q: usize) -> bool {
        let apart = |axis: usize| (self.points[p][axis] - self.points[q][axis]) * self.scale[axis];
        let height: f64 = (0..3).map(|axis| self.normals[p][axis] * apart(axis)).sum();
        height.abs() <= self.residual
    }
}

/// The order-free form: one number per point, −1 = none.
pub fn order_free(surface: &Surface, neighbors: &[Vec<usize>]) -> Vec<i64> {
    let points = neighbors.len();
    let smooth = |p: usize| surface.has_normal(p) && surface.is_flat(p);
    let mut pairs = Vec::new();
    for p in 0..points {
        for q in 0..points {
            let are_neighbors = neighbors[p].contains(&q) || neighbors[q].contains(&p);
            let on_both_planes = surface.near(p, q) && surface.near(q, p);
            if smooth(p) && smooth(q) && are_neighbors && surface.alike(p, q) && on_both_planes {
                pairs.push((p, q));
            }
        }
    }
    let of = components(points, pairs);
    let segment = |p: usize| {
        if smooth(p) {
            return of[p];
        }
        let target = neighbors[p].iter().find(|&&q| smooth(q) && surface.has_normal(p) && surface.alike(p, q));
        target.map_or(-1, |&q| of[q])
    };
    (0..points).map(segment).collect()
}

/// PCL's `RegionGrowing`, with its own names; ties of curvature in the order of the points, NaN last.
pub fn literal(surface: &Surface, neighbors: &[Vec<usize>], smooth_mode: bool) -> Vec<i64> {
    let points = neighbors.len();
    let mut point_residual: Vec<(f64, usize)> = (0..points)
        .map(|i| if surface.curvatures[i].is_nan() { (f64::MAX, i) } else { (surface.curvatures[i], i) })
        .collect();
    point_residual.sort_by(|a, b| a.partial_cmp(b).unwrap_or(std::cmp::Ordering::Equal));
    let mut point_labels = vec![-1; points];
    let mut segment = 0;
    for (_, initial_seed) in point_residual {
        if point_labels[initial_seed] != -1 {
            continue;
        }
        let mut seeds = vec![initial_seed];
        point_labels[initial_seed] = segment;
        let mut current = 0;
        while current < seeds.len() {
            let seed = seeds[current];
            for &index in &neighbors[seed] {
                if point_labels[index] != -1 {
                    continue;
                }
                let (belongs, is_a_seed) = validate_point(surface, initial_seed, seed, index, smooth_mode);
                if !belongs {
                    continue;
                }
                point_labels[index] = segment;
                if is_a_seed {
                    seeds.push(index);
                }
            }
            current += 1;
        }
        segment += 1;
    }
    point_labels
}

fn validate_point(
    surface: &Surface,
    initial_seed: usize,
    point: usize,
    nghbr: usize,
    smooth_mode: bool,
) -> (bool, bool) {
    let reference = if smooth_mode { point } else { initial_seed };
    if !surface.alike(reference, nghbr) {
        return (false, false);
    }
    (true, surface.is_flat(nghbr) && surface.near(point, nghbr))
}
