//! Each stage against its definition, computed in n² steps, and every stream of windows against the whole cloud.

use std::collections::BTreeMap;

use proptest::prelude::*;

use super::*;
use crate::attribute::Columns;
use crate::crew::Crew;
use crate::lattice::Lattice;
use crate::span::{Chunk, Direction, PointIds, Source, Span, SpanBy, Spans, spans_of};
use crate::survey::{OwnIds, Survey};
use crate::window::Halo;

#[derive(Debug, Clone)]
struct Cloud {
    points: Vec<[f64; 3]>,
    lattice: Lattice,
}

impl Cloud {
    fn window(&self) -> Window {
        let intensity = (0..self.points.len()).map(|i| i as f64).collect();
        let point_ids = PointIds::From(0);
        let span = Span { index: 0, point_ids, points: self.points.clone(), attributes: vec![intensity], extent: None };
        Window::with_halo(0, vec![Arc::new(span)], 0..1, self.lattice, &["intensity".into()])
    }

    fn spans(&self, width: f64, direction: Direction) -> Spans {
        let intensity: Vec<f64> = (0..self.points.len()).map(|i| i as f64).collect();
        let chunk = |(points, values): (&[[f64; 3]], &[f64])| {
            Ok(Chunk { points: points.to_vec(), attributes: vec![values.to_vec()] })
        };
        let chunks: Vec<_> = self.points.chunks(7).zip(intensity.chunks(7)).map(chunk).collect();
        spans_of(chunks.into_iter(), SpanBy::Width { width, direction }, &self.lattice, Source::Stored).unwrap()
    }

    fn distance(&self, a: usize, b: usize) -> f64 {
        let scale = self.lattice.scale();
        let d: [f64; 3] = std::array::from_fn(|k| (self.points[a][k] - self.points[b][k]) * scale[k]);
        (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt()
    }

    /// Distances to all other points, ascending.
    fn distances(&self, of: usize) -> Vec<f64> {
        let mut distances: Vec<f64> =
            (0..self.points.len()).filter(|&i| i != of).map(|i| self.distance(of, i)).collect();
        distances.sort_by(f64::total_cmp);
        distances
    }

    fn measure(
        &self,
        removal: StatisticalOutlierRemoval,
        earlier: &[Arc<dyn Stage>],
        width: f64,
        halo: f64,
    ) -> Statistics {
        let mut open = || Ok(self.spans(width, Direction::X));
        measure(removal, earlier, &mut open, self.lattice, halo, 1, &mut || Box::new(|| Ok(()))).unwrap()
    }
}

/// What stands for each point: its id and position, bit for bit, and an attribute.
type Fate = BTreeMap<i64, (i64, [u64; 3], u64)>;

fn fates(window: &Window, prepared: &Preprocessed) -> Fate {
    let of = |(&id, successor): (&i64, &Option<u32>)| {
        let at = (*successor)? as usize;
        let position = prepared.window.points()[at].map(f64::to_bits);
        let intensity = prepared.window.columns().get("intensity").unwrap()[at].to_bits();
        Some((id, (prepared.window.point_ids()[at], position, intensity)))
    };
    window.point_ids().iter().zip(&prepared.successors).filter_map(of).collect()
}

fn in_one_window(cloud: &Cloud, stages: &[Arc<dyn Stage>]) -> Fate {
    let window = cloud.window();
    fates(&window, &apply_all(stages, &window).unwrap())
}

fn in_windows(cloud: &Cloud, stages: &[Arc<dyn Stage>], width: f64, direction: Direction, threads: usize) -> Fate {
    let halo = Halo::Length(total_halo(stages).max(f64::MIN_POSITIVE));
    let stages: Vec<_> = stages.to_vec();
    let work = move |window: &Window| {
        let own = OwnIds::of(window);
        let mut fates = fates(window, &apply_all(&stages, window)?);
        fates.retain(|&id, _| own.contains(id));
        Ok(fates)
    };
    let crew = Crew::new(threads).unwrap();
    let names = vec!["intensity".into()];
    Survey::new(cloud.spans(width, direction), cloud.lattice, names, halo, crew, Arc::new(work))
        .unwrap()
        .flat_map(|fates| fates.unwrap())
        .collect()
}

fn check_windows(cloud: &Cloud, stages: &[Arc<dyn Stage>]) {
    let whole = in_one_window(cloud, stages);
    for (width, direction, threads) in
        [(0.5, Direction::X, 1), (3.0, Direction::Y, 2), (1.7, Direction::Azimuth(30.0), 1), (50.0, Direction::X, 1)]
    {
        assert_eq!(in_windows(cloud, stages, width, direction, threads), whole, "{width} {direction:?}");
    }
}

/// Points on a lattice of centimeters at UTM size, or with real coordinates; some far away.
fn clouds() -> impl Strategy<Value = Cloud> {
    let coordinate =
        || prop_oneof![6 => 0i64..600, 3 => prop::sample::select(vec![0, 100, 150, 300]), 1 => -3000i64..3000];
    let height = prop_oneof![0i64..50, -500i64..500];
    let points = prop::collection::vec((coordinate(), coordinate(), height), 0..60);
    (points, any::<bool>()).prop_map(|(points, whole)| {
        let points = points.into_iter().map(|(x, y, z)| [x, y, z].map(|c| c as f64));
        if whole {
            let lattice = Lattice::new([0.01; 3], [500_000.0, 5_400_000.0, 0.0]).unwrap();
            Cloud { points: points.collect(), lattice }
        } else {
            Cloud { points: points.map(|p| p.map(|c| c * 0.01 + 400.0)).collect(), lattice: Lattice::REAL }
        }
    })
}

fn degenerate() -> Vec<Cloud> {
    let lattice = Lattice::new([0.01; 3], [0.0; 3]).unwrap();
    let clouds = [
        vec![],
        vec![[3.0, 4.0, 5.0]],
        vec![[3.0, 4.0, 5.0]; 20],
        (0..30).map(|i| [f64::from(i) * 10.0, 0.0, 0.0]).collect(),
        (0..30).map(|i| [100.0, 0.0, f64::from(i) * 10.0]).collect(),
        (0..36).map(|i| [f64::from(i % 6) * 100.0, f64::from(i / 6) * 100.0, 0.0]).collect(),
        [vec![[0.0; 3]; 10], vec![[1e6, -1e6, 1e5]]].concat(),
    ];
    clouds.into_iter().map(|points| Cloud { points, lattice }).collect()
}

const DIALECTS: [Dialect; 3] = [Dialect::Pcl, Dialect::Pdal, Dialect::Open3d];

/// Means, statistics and verdicts by the words of the table in the documentation; no verdict where rounding decides.
fn outliers_by_definition(
    cloud: &Cloud,
    k: usize,
    multiplier: f64,
    dialect: Dialect,
) -> (Statistics, Vec<Option<bool>>) {
    let n = cloud.points.len();
    let means: Vec<f64> = (0..n)
        .map(|i| {
            let mut distances = cloud.distances(i);
            if dialect == Dialect::Open3d {
                distances.insert(0, 0.0);
            }
            distances.truncate(k);
            distances.iter().sum::<f64>() / distances.len().max(1) as f64
        })
        .collect();
    let mean = means.iter().sum::<f64>() / n.max(1) as f64;
    let counted = means.iter().filter(|d| dialect != Dialect::Open3d || **d > 0.0);
    let squared = counted.map(|d| (d - mean).powi(2)).sum::<f64>();
    let deviation = if n < 2 { 0.0 } else { (squared / (n as f64 - 1.0)).sqrt() };
    let threshold = mean + multiplier * deviation;
    let outliers = means
        .iter()
        .map(|&d| {
            let is_clear = (d - threshold).abs() > 1e-9 * threshold || threshold == 0.0;
            let is_outlier = match dialect {
                Dialect::Pcl => d > threshold,
                Dialect::Pdal => d >= threshold,
                Dialect::Open3d => d >= threshold || d == 0.0,
            };
            is_clear.then_some(is_outlier)
        })
        .collect();
    (Statistics { count: n as u64, mean, deviation, reach: None }, outliers)
}

fn check_statistical(cloud: &Cloud, k: usize, multiplier: f64, dialect: Dialect) {
    let removal = StatisticalOutlierRemoval::new(k, multiplier, dialect).unwrap();
    let measured = cloud.measure(removal, &[], 1e9, 0.0);
    let (expected, outliers) = outliers_by_definition(cloud, k, multiplier, dialect);
    assert_eq!(measured.count, expected.count);
    assert!((measured.mean - expected.mean).abs() <= 1e-12 * expected.mean, "{measured:?} {expected:?}");
    assert!((measured.deviation - expected.deviation).abs() <= 1e-8 * expected.mean, "{measured:?} {expected:?}");
    for (width, halo) in [(0.7, 0.0), (0.7, 1.0), (2.0, 3.0)] {
        assert_eq!(cloud.measure(removal, &[], width, halo), measured);
    }
    let stages: Vec<Arc<dyn Stage>> = vec![Arc::new(removal.with_statistics(measured))];
    let kept = in_one_window(cloud, &stages);
    for (id, outlier) in outliers.iter().enumerate() {
        assert!(outlier.is_none_or(|outlier| outlier != kept.contains_key(&(id as i64))), "{id} {dialect:?}");
    }
    check_windows(cloud, &stages);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: cases(40), ..ProptestConfig::default() })]

    #[test]
    fn statistical_outliers_are_those_of_the_definition_in_any_windows(
        cloud in clouds(), k in 2usize..9, multiplier in 0.0..2.5f64, dialect in prop::sample::select(DIALECTS.to_vec()),
    ) {
        check_statistical(&cloud, k, multiplier, dialect);
    }

    #[test]
    fn radius_outliers_are_those_of_the_definition_in_any_windows(
        cloud in clouds(), radius in 1u32..200, min_neighbors in 1usize..6,
    ) {
        check_radius(&cloud, f64::from(radius) * 0.01, min_neighbors);
    }

    #[test]
    fn voxels_are_those_of_the_definition_in_any_windows(
        cloud in clouds(), size in prop::sample::select(vec![0.01, 0.25, 0.3, 1.0, 1.234, 7.0]), nearest in any::<bool>(),
    ) {
        check_voxels(&cloud, size, if nearest { Representative::Nearest } else { Representative::Centroid });
    }

    #[test]
    fn stages_in_a_row_are_the_same_in_any_windows(
        cloud in clouds(), size in 0.1..1.0f64, dialect in prop::sample::select(DIALECTS.to_vec()), order in 0usize..3,
    ) {
        let voxels: Arc<dyn Stage> = Arc::new(VoxelGrid::new(size, Representative::Centroid).unwrap());
        let radius: Arc<dyn Stage> = Arc::new(RadiusOutlierRemoval::new(1.0, 2).unwrap());
        let removal = StatisticalOutlierRemoval::new(4, 1.0, dialect).unwrap();
        let mut stages = [vec![], vec![Arc::clone(&voxels)], vec![radius, voxels]][order].clone();
        let measured = cloud.measure(removal, &stages, 1e9, 0.0);
        prop_assert_eq!(cloud.measure(removal, &stages, 1.3, 0.5), measured);
        stages.push(Arc::new(removal.with_statistics(measured)));
        stages.push(Arc::new(VoxelGrid::new(1.5 * size, Representative::Nearest).unwrap()));
        check_windows(&cloud, &stages);
    }

    #[test]
    fn on_a_lattice_the_order_of_the_points_does_not_change_a_voxel(cloud in clouds(), seed in any::<u64>()) {
        let grid: Vec<Arc<dyn Stage>> = vec![Arc::new(VoxelGrid::new(0.8, Representative::Centroid).unwrap())];
        let mut order: Vec<usize> = (0..cloud.points.len()).collect();
        order.sort_by_key(|&i| (i as u64 ^ seed).wrapping_mul(0x9e37_79b9_7f4a_7c15));
        let shuffled = Cloud { points: order.iter().map(|&i| cloud.points[i]).collect(), ..cloud.clone() };
        if cloud.lattice.is_whole() {
            let (straight, mixed) = (in_one_window(&cloud, &grid), in_one_window(&shuffled, &grid));
            for (new, &old) in order.iter().enumerate() {
                prop_assert_eq!(straight[&(old as i64)].1, mixed[&(new as i64)].1);
            }
        }
    }
}

fn cases(usual: u32) -> u32 {
    std::env::var("PROPTEST_CASES").ok().and_then(|cases| cases.parse().ok()).unwrap_or(usual)
}

#[test]
fn degenerate_clouds_are_as_the_definitions_say() {
    for cloud in degenerate() {
        for dialect in DIALECTS {
            check_statistical(&cloud, 4, 1.0, dialect);
            check_statistical(&cloud, 40, 0.5, dialect);
        }
        check_radius(&cloud, 0.1, 2);
        check_voxels(&cloud, 0.25, Representative::Centroid);
        check_voxels(&cloud, 0.01, Representative::Nearest);
    }
}

fn check_radius(cloud: &Cloud, radius: f64, min_neighbors: usize) {
    let stages: Vec<Arc<dyn Stage>> = vec![Arc::new(RadiusOutlierRemoval::new(radius, min_neighbors).unwrap())];
    let kept = in_one_window(cloud, &stages);
    for i in 0..cloud.points.len() {
        let distances = cloud.distances(i);
        let within = |radius: f64| distances.iter().filter(|d| **d <= radius).count() >= min_neighbors;
        let (less, more) = (within(radius * (1.0 - 1e-9)), within(radius * (1.0 + 1e-9)));
        let stays = kept.contains_key(&(i as i64));
        assert!(stays == more || (stays == less && !cloud.lattice.is_whole()), "{i}");
    }
    check_windows(cloud, &stages);
}

/// The voxel of a point by exact whole numbers where there are some.
fn voxel_of(cloud: &Cloud, i: usize, size: f64) -> [i64; 3] {
    let (scale, offset) = (cloud.lattice.scale(), cloud.lattice.offset());
    let steps = (size * 100.0).round();
    if cloud.lattice.is_whole() && (steps / 100.0 - size).abs() < 1e-12 {
        return std::array::from_fn(|k| {
            (cloud.points[i][k] as i64 + (offset[k] * 100.0).round() as i64).div_euclid(steps as i64)
        });
    }
    std::array::from_fn(|k| ((cloud.points[i][k] * scale[k] + offset[k]) / size).floor() as i64)
}

fn check_voxels(cloud: &Cloud, size: f64, representative: Representative) {
    let stages: Vec<Arc<dyn Stage>> = vec![Arc::new(VoxelGrid::new(size, representative).unwrap())];
    let fates = in_one_window(cloud, &stages);
    assert_eq!(fates.len(), cloud.points.len());
    let mut voxels: BTreeMap<[i64; 3], Vec<usize>> = BTreeMap::new();
    for i in 0..cloud.points.len() {
        voxels.entry(voxel_of(cloud, i, size)).or_default().push(i);
    }
    for members in voxels.values() {
        let real = |i: usize| cloud.lattice.real(&cloud.points[i]);
        let mean = |k: usize| members.iter().map(|&i| real(i)[k]).sum::<f64>() / members.len() as f64;
        let center = [mean(0), mean(1), mean(2)];
        let from_center = |i: usize| (0..3).map(|k| (real(i)[k] - center[k]).powi(2)).sum::<f64>().sqrt();
        let least = members.iter().map(|&i| from_center(i)).fold(f64::INFINITY, f64::min);
        let fate = fates[&(members[0] as i64)];
        assert!(members.iter().all(|&i| fates[&(i as i64)] == fate));
        let (id, position, intensity) = (fate.0, fate.1.map(f64::from_bits), f64::from_bits(fate.2));
        assert!(from_center(intensity as usize) <= least + 1e-8, "attributes are those of the nearest point");
        match representative {
            Representative::Centroid => {
                assert_eq!(id, members[0] as i64);
                assert!((0..3).all(|k| (position[k] - center[k]).abs() < 1e-8), "{position:?} {center:?}");
            }
            Representative::Nearest => {
                assert_eq!(id, intensity as i64);
                assert_eq!(position, cloud.points[id as usize]);
            }
        }
    }
    check_windows(cloud, &stages);
}

#[test]
fn voxels_of_a_millimeter_at_the_other_end_of_the_world() {
    let lattice = Lattice::new([0.001; 3], [0.0; 3]).unwrap();
    let points = vec![[833_000_123.0, 9_300_000_456.0, 8_000_000.0], [833_000_124.0, 9_300_000_456.0, 8_000_000.0]];
    let far = Cloud { points, lattice };
    check_voxels(&far, 0.001, Representative::Centroid);
    let all = in_one_window(&far, &[Arc::new(VoxelGrid::new(0.001, Representative::Centroid).unwrap())]);
    assert_ne!(all[&0].0, all[&1].0);
    let error = VoxelGrid::new(1e-9, Representative::Centroid).unwrap().apply(&far.window()).err().unwrap().to_string();
    assert!(error.starts_with("size is 0.000000001, with a point at [833000.123"), "{error}");
}

#[test]
fn the_dialects_differ_as_documented() {
    let cloud = Cloud { points: vec![[0.0; 3]; 5], lattice: Lattice::REAL };
    let kept = |dialect| {
        let removal = StatisticalOutlierRemoval::new(2, 1.0, dialect).unwrap();
        let measured = cloud.measure(removal, &[], 1.0, 0.0);
        in_one_window(&cloud, &[Arc::new(removal.with_statistics(measured))]).len()
    };
    assert_eq!(DIALECTS.map(kept), [5, 0, 0]);
}

#[test]
fn a_stray_point_does_not_make_the_halo_longer() {
    let row = (0..4000).map(|i| [f64::from(i), f64::from(i * 7919 % 13), f64::from(i % 3)]);
    let strays = [[1e9, 0.0, 0.0], [-3e8, 5.0, 0.0]];
    let cloud = Cloud { points: row.chain(strays).collect(), lattice: Lattice::REAL };
    for dialect in DIALECTS {
        let removal = StatisticalOutlierRemoval::new(8, 1.0, dialect).unwrap();
        let measured = cloud.measure(removal, &[], 40.0, 40.0);
        assert_eq!(cloud.measure(removal, &[], 1e10, 0.0), measured);
        let stage = removal.with_statistics(measured);
        assert!(removal.threshold(&measured) > 1e6 && stage.halo() < 20.0, "{measured:?}");
        let halo = Halo::Length(stage.halo());
        let count = Arc::new(|window: &Window| Ok(window.points().len()));
        let spans = cloud.spans(40.0, Direction::X);
        let sizes = Survey::new(spans, cloud.lattice, vec!["intensity".into()], halo, Crew::new(1).unwrap(), count);
        assert!(sizes.unwrap().all(|size| size.unwrap() <= 120));
        let stages: Vec<Arc<dyn Stage>> = vec![Arc::new(stage)];
        let kept = in_windows(&cloud, &stages, 40.0, Direction::X, 1);
        assert_eq!(kept, in_one_window(&cloud, &stages));
        let without = Statistics { reach: None, ..measured };
        assert_eq!(kept, in_one_window(&cloud, &[Arc::new(removal.with_statistics(without))]));
        assert_eq!(kept.len(), 4000);
        // The reach holds for thresholds up to the one it was measured for.
        let (less, more) =
            (StatisticalOutlierRemoval::new(8, 0.5, dialect), StatisticalOutlierRemoval::new(8, 2.0, dialect));
        assert!(less.unwrap().with_statistics(measured).halo() < 20.0);
        assert!(more.unwrap().with_statistics(measured).halo() > 1e6);
    }
}

#[test]
fn statistics_of_another_cloud_give_the_same_in_any_windows() {
    let line = |step: f64| (0..60).map(move |i| [f64::from(i) * step, f64::from(i * i % 7) * step, 0.0]).collect();
    let (dense, sparse) =
        (Cloud { points: line(0.1), lattice: Lattice::REAL }, Cloud { points: line(0.13), lattice: Lattice::REAL });
    for dialect in DIALECTS {
        let removal = StatisticalOutlierRemoval::new(5, 1.0, dialect).unwrap();
        check_windows(&sparse, &[Arc::new(removal.with_statistics(dense.measure(removal, &[], 1e9, 0.0)))]);
        check_windows(&dense, &[Arc::new(removal.with_statistics(sparse.measure(removal, &[], 1e9, 0.0)))]);
    }
}

#[test]
fn running_statistics_are_those_of_what_has_come() {
    // Four groups; in the second the points are farther apart than anything before, in the last one is alone.
    let group = |x: f64, step: f64| (0..6).map(move |i| [x + f64::from(i) * step, 0.0, 0.0]);
    let lattice = Lattice::new([0.01; 3], [0.0; 3]).unwrap();
    let points = group(0.0, 10.0).chain(group(1000.0, 10.0)).chain(group(2000.0, 10.0)).chain([[2500.0, 0.0, 0.0]]);
    let cloud = Cloud { points: points.collect(), lattice };
    let removal = StatisticalOutlierRemoval::new(2, 2.0, Dialect::Pcl).unwrap();
    let stages: Vec<Arc<dyn Stage>> = vec![Arc::new(removal.running())];
    let kept = in_windows(&cloud, &stages, 10.0, Direction::X, 1);
    assert_eq!(kept.len(), 18, "all but the one that is alone: {kept:?}");
    let whole = vec![Arc::new(removal.running()) as Arc<dyn Stage>];
    assert_eq!(in_one_window(&cloud, &whole), kept);
}

#[test]
fn an_empty_window_is_no_trouble() {
    let empty = Window::new(0, vec![], Lattice::REAL);
    let removal = StatisticalOutlierRemoval::new(2, 2.0, Dialect::Pcl).unwrap();
    let stages: Vec<Arc<dyn Stage>> = vec![
        Arc::new(removal.running()),
        Arc::new(removal.with_statistics(Moments::default().statistics())),
        Arc::new(RadiusOutlierRemoval::new(1.0, 1).unwrap()),
        Arc::new(VoxelGrid::new(1.0, Representative::Nearest).unwrap()),
    ];
    assert!(apply_all(&stages, &empty).unwrap().window.points().is_empty());
    let none = empty.replaced(vec![], vec![], Lattice::REAL, Columns::default());
    assert!(apply_all(&[], &none).unwrap().successors.is_empty());
}

#[test]
fn what_is_not_allowed_is_said() {
    let message = |result: Result<StatisticalOutlierRemoval>| result.unwrap_err().to_string();
    assert!(message(StatisticalOutlierRemoval::new(0, 1.0, Dialect::Pcl)).starts_with("k is 0"));
    assert!(
        message(StatisticalOutlierRemoval::new(1, 1.0, Dialect::Open3d)).contains("the point itself is one of them")
    );
    assert!(message(StatisticalOutlierRemoval::new(8, f64::NAN, Dialect::Pcl)).starts_with("multiplier is NaN"));
    assert!(message(StatisticalOutlierRemoval::new(1_000_000_000_000, 1.0, Dialect::Pcl)).contains("at most 100000"));
    assert!(RadiusOutlierRemoval::new(-1.0, 1).is_err() && RadiusOutlierRemoval::new(1.0, 0).is_err());
    assert!(VoxelGrid::new(f64::INFINITY, Representative::Centroid).is_err());
    assert!("mean".parse::<Representative>().unwrap_err().to_string().contains("'centroid' or 'nearest'"));
    assert!("cgal".parse::<Dialect>().unwrap_err().to_string().contains("'pcl', 'pdal' or 'open3d'"));
}
