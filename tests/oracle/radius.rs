//! The radius graph: all pairs within a distance.

/// Squared length of a difference, on the map or in space.
pub fn squared_length(a: [i64; 3], b: [i64; 3], axes: usize) -> i64 {
    (0..axes).map(|k| (a[k] - b[k]) * (a[k] - b[k])).sum()
}

/// All pairs whose squared length is at most `squared`; `axes` is 2 on the map and 3 in space.
pub fn pairs_within(points: &[[i64; 3]], squared: i64, axes: usize) -> Vec<(usize, usize)> {
    let pairs = (0..points.len()).flat_map(|b| (0..b).map(move |a| (a, b)));
    pairs.filter(|&(a, b)| squared_length(points[a], points[b], axes) <= squared).collect()
}
