use std::f64::consts::{PI, TAU};

use super::*;
use proptest::prelude::*;

/// Numbers that look random, the same each time (Steele, Lea and Flood 2014).
struct Random(u64);

impl Random {
    /// Uniform in 0..1.
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.next()
    }

    /// About normally distributed.
    fn noise(&mut self, sigma: f64) -> f64 {
        sigma * ((0..12).map(|_| self.next()).sum::<f64>() - 6.0)
    }
}

/// Features of the first point.
fn first(points: &[[f64; 3]], search: Search, fit: Fit, wanted: &[Feature]) -> Vec<f64> {
    let ids: Vec<i64> = (0..points.len() as i64).collect();
    let features = compute(points, &ids, &Lattice::REAL, search, fit, wanted);
    features.columns.iter().map(|column| column[0]).collect()
}

fn all_of_first(points: &[[f64; 3]]) -> impl Fn(Feature) -> f64 {
    let values = first(points, Search::ball(100.0).unwrap(), Fit::LeastSquares, &Feature::ALL);
    move |feature| values[Feature::ALL.iter().position(|&f| f == feature).unwrap()]
}

fn near(a: f64, b: f64, tolerance: f64) {
    assert!((a - b).abs() <= tolerance, "{a} is not {b}");
}

/// Points of a height field around the origin, which is the first of them.
fn field(height: impl Fn(f64, f64) -> f64, radius: f64) -> Vec<[f64; 3]> {
    let mut points = vec![[0.0, 0.0, height(0.0, 0.0)]];
    for ring in 1..=12 {
        for step in 0..6 * ring {
            let (r, angle) = (radius * f64::from(ring) / 12.0, TAU * f64::from(step) / f64::from(6 * ring));
            let (x, y) = (r * angle.cos(), r * angle.sin());
            points.push([x, y, height(x, y)]);
        }
    }
    points
}

fn turned(points: &[[f64; 3]], a: f64, b: f64) -> Vec<[f64; 3]> {
    let turn = |[x, y, z]: [f64; 3]| {
        let (x, y) = (x * a.cos() - y * a.sin(), x * a.sin() + y * a.cos());
        [x, y * b.cos() - z * b.sin(), y * b.sin() + z * b.cos()]
    };
    points.iter().map(|&point| turn(point)).collect()
}

#[test]
fn names_are_found_in_any_case() {
    for feature in Feature::ALL {
        assert_eq!(Feature::by_name(feature.name()), Some(feature));
        assert_eq!(Feature::by_name(&feature.name().to_uppercase()), Some(feature));
        assert_eq!(feature.name(), format!("{feature:?}"));
    }
    assert_eq!(Feature::by_name("Normal"), None);
}

#[test]
fn a_plane_has_its_normal_and_no_thickness() {
    // 2x − y + 2z = 0, whose normal is (2, −1, 2)/3.
    let points: Vec<[f64; 3]> = field(|x, y| (y - 2.0 * x) / 2.0, 1.0);
    let of = all_of_first(&points);
    for (feature, value) in [(Feature::NormalX, 2.0), (Feature::NormalY, -1.0), (Feature::NormalZ, 2.0)] {
        near(of(feature), value / 3.0, 1e-14);
    }
    for feature in [Feature::NormalSigma0, Feature::SurfaceVariation, Feature::Sphericity, Feature::Omnivariance] {
        near(of(feature), 0.0, 1e-9);
    }
    near(of(Feature::Verticality), 1.0 / 3.0, 1e-14);
    near(of(Feature::Linearity) + of(Feature::Planarity), 1.0, 1e-14);
    near(of(Feature::MeanCurvature), 0.0, 1e-12);
    near(of(Feature::GaussianCurvature), 0.0, 1e-12);
    assert_eq!(of(Feature::NeighborCount), points.len() as f64);
}

#[test]
fn sigma0_is_that_of_an_adjustment() {
    // A square whose corners are 1 above and below in turn: v = ±1, n − 3 = 1.
    let of = all_of_first(&[[1.0, 1.0, 1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0], [1.0, -1.0, -1.0]]);
    // All three eigenvalues are 1, and a plane is as good as another.
    near(of(Feature::NormalSigma0), 2.0, 1e-14);
    near(of(Feature::Eigenentropy), 3f64.ln(), 1e-14);
    near(of(Feature::SurfaceVariation), 1.0 / 3.0, 1e-14);
    let of = all_of_first(&[[3.0, 0.0, 0.0], [0.0, 3.0, 0.0], [0.0, 0.0, 3.0]]);
    assert_eq!(of(Feature::NormalSigma0), 0.0);
    near(of(Feature::NormalX), 1.0 / 3f64.sqrt(), 1e-14);
}

#[test]
fn a_wall_has_no_digits_in_the_air() {
    let wall: Vec<[f64; 3]> = (0..40).map(|i| [7.0, f64::from(i % 8), f64::from(i / 8)]).collect();
    let of = all_of_first(&wall);
    assert_eq!([of(Feature::NormalX), of(Feature::NormalY), of(Feature::NormalZ)], [1.0, 0.0, 0.0]);
    assert_eq!(of(Feature::Verticality), 1.0);
    assert_eq!(of(Feature::NormalSigma0), 0.0);
}

/// H, K, K₁ and K₂ at the first point.
fn curvatures(points: &[[f64; 3]], radius: f64) -> [f64; 4] {
    let wanted = [Feature::MeanCurvature, Feature::GaussianCurvature, Feature::MaxCurvature, Feature::MinCurvature];
    first(points, Search::ball(radius).unwrap(), Fit::LeastSquares, &wanted).try_into().unwrap()
}

#[test]
fn quadrics_have_their_curvatures() {
    for (xx, yy) in [(1.0, 1.0), (-1.0, -1.0), (1.0, -1.0), (3.0, 0.5), (2.0, 0.0), (0.0, -2.0)] {
        let points = field(|x, y| 0.5 * xx * x * x + 0.5 * yy * y * y, 0.3);
        for (a, b) in [(0.0, 0.0), (0.7, 0.0), (0.3, 1.2), (5.0, -0.8)] {
            let found = curvatures(&turned(&points, a, b), 1.0);
            let wanted = [f64::midpoint(xx, yy), xx * yy, f64::max(xx, yy), f64::min(xx, yy)];
            for (found, wanted) in found.into_iter().zip(wanted) {
                near(found, wanted, 1e-9);
            }
        }
    }
}

#[test]
fn a_slope_in_the_frame_of_the_plane_is_allowed_for() {
    // The point is at the border of its neighborhood: a sphere of radius 1, seen from where it is 0.15 off the middle.
    let mut points = field(|x, y| (1.0 - x * x - y * y).sqrt(), 0.15);
    points.rotate_left(6 * 66 + 1);
    let [mean, gaussian, ..] = curvatures(&points, 1.0);
    near(mean, -1.0, 0.02);
    near(gaussian, 1.0, 0.04);
}

#[test]
fn spheres_cylinders_and_tori_have_their_curvatures_but_for_what_a_quadric_is_not() {
    // The relative error of a quadric is of the order (radius of the neighborhood/radius of curvature)²/4.
    let sphere = field(|x, y| (4.0 - x * x - y * y).sqrt(), 0.1);
    let [mean, gaussian, max, min] = curvatures(&sphere, 1.0);
    near(mean, -0.5, 0.5 * 1e-3);
    near(gaussian, 0.25, 0.25 * 2e-3);
    near(max, -0.5, 0.5 * 1e-3);
    near(min, -0.5, 0.5 * 1e-3);
    let cylinder = field(|x, _| (4.0 - x * x).sqrt(), 0.1);
    let [mean, gaussian, max, min] = curvatures(&cylinder, 1.0);
    near(mean, -0.25, 0.25 * 1e-3);
    near(gaussian, 0.0, 1e-6);
    near(max, 0.0, 1e-6);
    near(min, -0.5, 0.5 * 1e-3);
    // The inside of a torus of radii 3 and 1, seen from its axis, is a saddle.
    let torus = |x: f64, y: f64| {
        let across = (1.0 - x * x).sqrt();
        ((3.0 - across) * (3.0 - across) - y * y).sqrt()
    };
    let [mean, gaussian, max, min] = curvatures(&field(torus, 0.1), 2.0);
    near(mean, 0.25, 0.005);
    near(gaussian, -0.5, 0.005);
    near(max, 1.0, 0.005);
    near(min, -0.5, 0.005);
}

/// Neighborhoods that determine nothing, a line, a plane but no quadric.
#[test]
fn what_has_no_value_is_nan() {
    let ids: Vec<i64> = Vec::new();
    let empty = compute(&[], &ids, &Lattice::REAL, Search::ball(1.0).unwrap(), Fit::Robust, &Feature::ALL);
    assert!(empty.columns.len() == Feature::ALL.len() && empty.columns.iter().all(Vec::is_empty));

    for few in [&[[5.0; 3]][..], &[[5.0; 3], [6.0; 3]]] {
        let of = all_of_first(few);
        assert_eq!(of(Feature::NeighborCount), few.len() as f64);
        assert!(Feature::ALL.iter().all(|&f| f == Feature::NeighborCount || of(f).is_nan()));
    }

    let of = all_of_first(&[[5.0; 3]; 20]);
    assert_eq!(of(Feature::NeighborCount), 20.0);
    for zero in [Feature::SurfaceVariation, Feature::NormalEigenvalue1, Feature::NormalEigenvalue3] {
        assert_eq!(of(zero), 0.0);
    }
    for nan in
        [Feature::NormalZ, Feature::NormalSigma0, Feature::Verticality, Feature::Linearity, Feature::Omnivariance]
    {
        assert!(of(nan).is_nan());
    }

    let line: Vec<[f64; 3]> = (0..20).map(|i| [f64::from(i), f64::from(3 * i), f64::from(-i)]).collect();
    let of = all_of_first(&line);
    near(of(Feature::Linearity), 1.0, 1e-12);
    near(of(Feature::Eigenentropy), 0.0, 1e-12);
    near(of(Feature::SurfaceVariation), 0.0, 1e-12);
    for nan in [Feature::NormalX, Feature::NormalSigma0, Feature::Verticality, Feature::MeanCurvature] {
        assert!(of(nan).is_nan());
    }

    let two_lines: Vec<[f64; 3]> =
        (0..20).map(|i| [f64::from(i / 2), f64::from(10 * (i % 2)), f64::from(i / 2 % 3)]).collect();
    let circle: Vec<[f64; 3]> = (0..20).map(|i| [f64::from(i).cos(), f64::from(i).sin(), 0.0]).collect();
    for conic in [two_lines, circle] {
        let of = all_of_first(&conic);
        assert!(of(Feature::NormalZ) > 0.0);
        assert!(of(Feature::MeanCurvature).is_nan() && of(Feature::MinCurvature).is_nan());
    }
}

#[test]
fn coordinates_of_any_size_have_features() {
    for size in [1e-40, 1.0, 1e40] {
        let points: Vec<[f64; 3]> =
            field(|x, y| x * x + y * y, 0.3).iter().map(|point| point.map(|c| c * size)).collect();
        let values = first(&points, Search::nearest(127, None).unwrap(), Fit::Robust, &Feature::ALL);
        assert!(values.iter().all(|value| value.is_finite()), "{size}: {values:?}");
        near(values[16] * size, 2.0, 1e-9);
    }
}

#[test]
fn support_is_how_far_the_neighborhood_could_change() {
    let points: Vec<[f64; 3]> = (0..10).map(|i| [f64::from(i), 0.0, 0.0]).collect();
    let ids: Vec<i64> = (0..10).collect();
    let support = |search| compute(&points, &ids, &Lattice::REAL, search, Fit::LeastSquares, &[]).support;
    assert_eq!(support(Search::disc(2.5).unwrap()), [2.5; 10]);
    let nearest = support(Search::nearest(4, None).unwrap());
    assert_eq!((nearest[0], nearest[1], nearest[5], nearest[9]), (3.0, 2.0, 2.0, 3.0));
    let limited = support(Search::nearest(4, Some(2.5)).unwrap());
    assert_eq!((limited[0], limited[1]), (2.5, 2.0));
    assert_eq!(support(Search::nearest(11, None).unwrap()), [f64::INFINITY; 10]);
}

/// A plane with noise, and blunders above it.
fn with_blunders(seed: u64, blunders: usize) -> Vec<[f64; 3]> {
    let mut random = Random(seed);
    let mut points = vec![[0.0, 0.0, random.noise(0.01)]];
    for i in 1..100 {
        let (x, y) = (random.between(-1.0, 1.0), random.between(-1.0, 1.0));
        let z = if i <= blunders { random.between(0.2, 1.0) } else { random.noise(0.01) };
        points.push([x, y, z]);
    }
    points
}

#[test]
fn blunders_are_removed() {
    let wanted = [Feature::NormalZ, Feature::NormalSigma0, Feature::NeighborCount];
    for seed in 0..200 {
        let points = with_blunders(seed, 20);
        let tilted = turned(&points, 1.0, 0.5);
        let search = Search::ball(10.0).unwrap();
        let all = first(&tilted, search, Fit::LeastSquares, &wanted);
        let robust = first(&tilted, search, Fit::Robust, &wanted);
        assert!(all[1] > 0.1, "blunders spoil least squares");
        assert!((0.007..0.013).contains(&robust[1]), "seed {seed}: σ0 is {}", robust[1]);
        near(robust[0], 0.5f64.cos(), 0.01);
        assert_eq!(robust[2], 100.0);
        // What is left has been fitted with equal weights.
        let good: Vec<[f64; 3]> =
            tilted.iter().enumerate().filter(|(i, _)| *i == 0 || *i > 20).map(|(_, &p)| p).collect();
        let alone = first(&good, search, Fit::LeastSquares, &wanted);
        near(robust[0], alone[0], 1e-12);
    }
}

#[test]
fn without_blunders_robust_is_least_squares() {
    for seed in 0..50 {
        let points = with_blunders(seed, 0);
        let search = Search::ball(10.0).unwrap();
        let fits = [Fit::LeastSquares, Fit::Robust];
        let [all, robust] = fits.map(|fit| first(&points, search, fit, &Feature::ALL));
        assert_eq!(all, robust);
    }
}

#[test]
fn rounding_to_the_lattice_is_no_blunder() {
    // Water at 1 cm: two points of three are at 0, the others one step up.
    let points: Vec<[f64; 3]> = (0..100)
        .map(|i| [f64::from(10 * (i % 10)), f64::from(10 * (i / 10)), f64::from(u8::from(i % 3 == 0))])
        .collect();
    let ids: Vec<i64> = (0..100).collect();
    let lattice = Lattice::new([0.01; 3], [0.0; 3]).unwrap();
    let search = Search::ball(10.0).unwrap();
    let fits = [Fit::LeastSquares, Fit::Robust];
    let [all, robust] = fits.map(|fit| compute(&points, &ids, &lattice, search, fit, &[Feature::NormalSigma0]));
    assert_eq!(all, robust);
    assert!(all.columns[0][0] > 0.004);
}

#[test]
fn a_small_neighborhood_is_not_torn_apart() {
    for seed in 0..100 {
        for n in 3..8 {
            let points = with_blunders(seed, 0)[..n].to_vec();
            let search = Search::ball(10.0).unwrap();
            let values = first(&points, search, Fit::Robust, &[Feature::NormalZ, Feature::NormalSigma0]);
            assert!(values.iter().all(|value| value.is_finite()), "{values:?}");
        }
    }
}

/// Whole lattice coordinates of a rough surface, with ties and doubles.
fn rough(seed: u64, n: usize) -> Vec<[f64; 3]> {
    let mut random = Random(seed);
    let mut points: Vec<[f64; 3]> = Vec::new();
    for i in 0..n {
        let (x, y) = (random.between(0.0, 40.0).floor(), random.between(0.0, 40.0).floor());
        let double = i % 17 == 0 && i > 0;
        points.push(if double { points[i / 2] } else { [x, y, random.noise(3.0).round() + (x / 9.0).sin().round()] });
    }
    points
}

fn bits(features: &Features, points: &[usize]) -> Vec<Vec<u64>> {
    let columns = features.columns.iter().chain([&features.support]);
    columns.map(|column| points.iter().map(|&point| column[point].to_bits()).collect()).collect()
}

fn searches() -> [Search; 5] {
    [
        Search::ball(0.05).unwrap(),
        Search::disc(0.04).unwrap(),
        Search::cylinder(0.05, -0.02, 0.03).unwrap(),
        Search::nearest(12, None).unwrap(),
        Search::Nearest { k: 9, flat: true, within: 0.05 },
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 16, ..ProptestConfig::default() })]

    /// Moving the cloud by steps of the lattice, shuffling the window and adding points far away change no bit.
    #[test]
    fn features_depend_on_the_neighbors_alone(seed: u64, shift in prop::array::uniform3(-1_000_000_000i64..1_000_000_000)) {
        let lattice = Lattice::new([0.01, 0.01, 0.013], [4.0, -7.5, 0.1]).unwrap();
        let points = rough(seed, 120);
        let ids: Vec<i64> = (0..points.len() as i64).collect();
        let mut random = Random(seed ^ 1);
        let mut order: Vec<usize> = (0..points.len()).collect();
        for i in (1..order.len()).rev() {
            order.swap(i, (random.next() * (i + 1) as f64) as usize);
        }
        let mut moved: Vec<[f64; 3]> = Vec::new();
        let mut moved_ids = Vec::new();
        let mut places = vec![0; points.len()];
        for (i, &from) in order.iter().enumerate() {
            if i % 3 == 0 {
                moved.push([1e10 + i as f64, 3e9, 0.0]);
                moved_ids.push(-(i as i64) - 1);
            }
            places[from] = moved.len();
            moved.push(std::array::from_fn(|k| points[from][k] + shift[k] as f64));
            moved_ids.push(5000 + 3 * ids[from]);
        }
        let here: Vec<usize> = (0..points.len()).collect();
        for search in searches() {
            for fit in [Fit::LeastSquares, Fit::Robust] {
                let alone = compute(&points, &ids, &lattice, search, fit, &Feature::ALL);
                let among = compute(&moved, &moved_ids, &lattice, search, fit, &Feature::ALL);
                prop_assert_eq!(bits(&alone, &here), bits(&among, &places));
            }
        }
    }

    /// A window that holds the neighborhood of a point gives it the features that the whole cloud gives it.
    #[test]
    fn a_window_is_enough(seed: u64) {
        let lattice = Lattice::new([0.01; 3], [0.0; 3]).unwrap();
        let points = rough(seed, 200);
        let ids: Vec<i64> = (0..points.len() as i64).collect();
        let (low, high) = (10.0, 30.0);
        let inside: Vec<usize> = (0..points.len()).filter(|&i| low <= points[i][0] && points[i][0] <= high).collect();
        let window: Vec<[f64; 3]> = inside.iter().rev().map(|&i| points[i]).collect();
        let window_ids: Vec<i64> = inside.iter().rev().map(|&i| ids[i]).collect();
        for search in searches() {
            let whole = compute(&points, &ids, &lattice, search, Fit::LeastSquares, &Feature::ALL);
            let part = compute(&window, &window_ids, &lattice, search, Fit::LeastSquares, &Feature::ALL);
            for (at, &point) in inside.iter().rev().enumerate() {
                let room = 0.01 * f64::min(points[point][0] - low, high - points[point][0]);
                if part.support[at] < room {
                    prop_assert_eq!(bits(&part, &[at]), bits(&whole, &[point]));
                }
            }
        }
    }

    /// Turning the cloud changes what depends on its position in space only by rounding.
    #[test]
    fn features_do_not_depend_on_the_frame(seed: u64, a in 0.0..TAU, b in 0.0..PI) {
        let mut random = Random(seed);
        let mut height = || random.noise(0.02);
        let points = field(|_, _| 0.0, 0.5).iter().map(|p| [p[0], 0.8 * p[1], p[0] * p[1] + height()]).collect::<Vec<_>>();
        let search = Search::ball(3.0).unwrap();
        let here = first(&points, search, Fit::LeastSquares, &Feature::ALL);
        let there = first(&turned(&points, a, b), search, Fit::LeastSquares, &Feature::ALL);
        let upside_down = b.cos() * here[2] + 1.0 < 0.0;
        for feature in [3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 15, 17] {
            prop_assert!((here[feature] - there[feature]).abs() <= 1e-9 && !upside_down);
        }
        prop_assert!((here[16].abs() - there[16].abs()).abs() <= 1e-9);
    }
}
