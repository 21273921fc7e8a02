//! Partitions of the points `0..n`, as one number per point.

use streamseg::label::Labels;

/// Which points are connected, by relabelling everything at each pair.
pub fn components(points: usize, pairs: impl IntoIterator<Item = (usize, usize)>) -> Vec<i64> {
    let mut of: Vec<i64> = (0..points as i64).collect();
    for (a, b) in pairs {
        let (a, b) = (of[a].min(of[b]), of[a].max(of[b]));
        if a != b {
            of.iter_mut().filter(|whole| **whole == b).for_each(|whole| *whole = a);
        }
    }
    of
}

/// The same partition, whatever the numbers.
pub fn canonical(ids: &[i64]) -> Vec<i32> {
    Labels::from_any(ids).of_points().to_vec()
}

/// Whether points that are together in `fine` are together in `coarse`.
pub fn refines(fine: &[i64], coarse: &[i64]) -> bool {
    let mut coarse_of = std::collections::HashMap::new();
    fine.iter().zip(coarse).all(|(f, c)| coarse_of.entry(f).or_insert(c) == &c)
}
