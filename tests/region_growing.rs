//! Region growing against slow twins on random clouds: the order-free form from its definition, PCL's loop step by step,
//! and the streamed result against the static one.
//!
//! `PROPTEST_CASES` scales the number of clouds tried; 256 is the normal amount.
#![cfg(not(loom))]
#![allow(clippy::unwrap_used)]

mod clouds;
mod oracle;
mod streaming;

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use clouds::{Survey, cases, cloud, squared_distance, survey};
use oracle::growing::{Surface, literal, neighbors, order_free};
use oracle::partition::{canonical, refines};
use proptest::prelude::*;
use streaming::{Outcome, Run, static_labels, static_labels_with, stream, stream_with};
use streamseg::error::Result;
use streamseg::features::{Feature, Fit, compute};
use streamseg::label::NONE;
use streamseg::neighborhood::Search;
use streamseg::recipe::{Ingredients, Recipe};
use streamseg::segmentor::{Curvature, Exactness, Form, Growth, RegionGrowing, Segmented, Segmentor};
use streamseg::span::{Direction, Source, SpanBy};
use streamseg::window::{Window, WindowSize};

/// Up to k nearest points, or all, within a squared radius in steps.
#[derive(Debug, Clone, Copy)]
struct Sought {
    k: Option<usize>,
    squared: Option<i64>,
}

impl Sought {
    fn search(self, survey: &Survey) -> Search {
        let radius = self.squared.map(|squared| (squared as f64).sqrt() * survey.unit);
        match self.k {
            Some(k) => Search::nearest(k, radius).unwrap(),
            None => Search::ball(radius.unwrap()).unwrap(),
        }
    }
}

fn within_radius() -> impl Strategy<Value = Sought> {
    (prop::option::weighted(0.7, 1usize..9), squared_distance()).prop_map(|(k, s)| Sought { k, squared: Some(s) })
}

fn sought() -> impl Strategy<Value = Sought> {
    prop_oneof![2 => within_radius(), 1 => (1usize..9).prop_map(|k| Sought { k: Some(k), squared: None })]
}

fn form() -> impl Strategy<Value = Form> {
    let forms = vec![Form::OrderFree, Form::Literal { smooth: true }, Form::Literal { smooth: false }];
    prop::sample::select(forms)
}

/// Parameters for steps of length 1; the search is told later.
fn growth() -> impl Strategy<Value = Growth> {
    let angle_deg = prop::sample::select(vec![0.0, 10.0, 30.0, 45.0, 60.0, 90.0]);
    let max_curvature = prop::option::weighted(0.8, prop::sample::select(vec![0.0, 0.01, 0.05, 0.1]));
    let residual = prop::option::of(prop::sample::select(vec![0.0, 0.5, 1.0, 3.0]));
    let curvature = prop::sample::select(vec![Curvature::SurfaceVariation, Curvature::Principal]);
    (angle_deg, curvature, max_curvature, residual).prop_map(|(angle_deg, curvature, max_curvature, residual)| Growth {
        angle_deg,
        curvature,
        max_curvature,
        residual,
        ..Growth::default()
    })
}

fn growing(growth: Growth, sought: Sought, survey: &Survey) -> RegionGrowing {
    let residual = growth.residual.map(|residual| residual * survey.unit);
    RegionGrowing::new(Growth { search: sought.search(survey), residual, ..growth }).unwrap()
}

/// Normals of a few directions and curvatures of a few sizes, in all combinations; some are missing.
fn made_up(count: usize, curvature: Curvature, seed: u64) -> Vec<Vec<f64>> {
    let mut state = seed;
    let mut next = |below: u64| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((state >> 33) % below) as usize
    };
    let normals: Vec<[f64; 3]> = (0..count)
        .map(|_| match next(12) {
            0 => [f64::NAN; 3],
            1..=6 => [0.0, 0.0, 1.0],
            7 => [0.0, 0.0, -1.0],
            8 => [1.0, 0.0, 0.0],
            9 => [0.0, 0.5f64.sqrt(), 0.5f64.sqrt()],
            10 => [0.0, 0.6, 0.8],
            _ => [0.6, 0.0, 0.8],
        })
        .collect();
    let mut curvatures = || -> Vec<f64> {
        let sizes = [0.0, 0.0, 0.01, 0.01, 0.04, 0.05, 0.06, 0.2, f64::NAN, -0.0, 0.03, 0.0];
        (0..count).map(|_| sizes[next(12)]).collect()
    };
    let mut columns: Vec<Vec<f64>> = (0..3).map(|axis| normals.iter().map(|normal| normal[axis]).collect()).collect();
    columns.push(curvatures());
    if curvature == Curvature::Principal {
        columns.push(curvatures().into_iter().map(|c| -c).collect());
    }
    columns
}

/// Computed features, as the recipe computes them.
fn computed(points: &[[f64; 3]], growing: &RegionGrowing, survey: &Survey) -> Vec<Vec<f64>> {
    let wanted: Vec<Feature> = growing.attributes().iter().map(|name| Feature::by_name(name).unwrap()).collect();
    let ids: Vec<i64> = (0..points.len() as i64).collect();
    compute(points, &ids, &survey.lattice, growing.growth().search, Fit::default(), &wanted).columns
}

fn recipe(segmentor: impl Segmentor + 'static) -> Recipe {
    let ingredients = Ingredients {
        stages: vec![],
        filter: None,
        seed_filter: None,
        fit: Fit::default(),
        segmentor: Arc::new(segmentor),
    };
    Recipe::new(ingredients, &[], false).unwrap()
}

fn surface(points: &[[f64; 3]], columns: &[Vec<f64>], growth: &Growth, survey: &Survey) -> Surface {
    Surface {
        points: points.to_vec(),
        scale: survey.lattice.scale(),
        normals: (0..points.len()).map(|i| [columns[0][i], columns[1][i], columns[2][i]]).collect(),
        curvatures: (0..points.len())
            .map(|i| match columns.get(4) {
                Some(min) if columns[3][i].is_nan() || min[i].is_nan() => f64::NAN,
                Some(min) => columns[3][i].abs().max(min[i].abs()),
                None => columns[3][i],
            })
            .collect(),
        least_cosine: growth.angle_deg.to_radians().cos(),
        max_curvature: growth.max_curvature.unwrap_or(f64::INFINITY),
        is_limited: growth.max_curvature.is_some(),
        residual: growth.residual.unwrap_or(f64::INFINITY),
    }
}

fn direction() -> impl Strategy<Value = Direction> {
    prop_oneof![Just(Direction::X), Just(Direction::Y), (-360.0f64..360.0).prop_map(Direction::Azimuth)]
}

fn overlapping() -> impl Strategy<Value = WindowSize> {
    (2usize..6).prop_flat_map(|spans| (Just(spans), 1..spans)).prop_map(|(s, o)| WindowSize::new(s, o).unwrap())
}

/// Spans so wide that the overlap holds the reach, with some steps to spare.
fn wide_enough(reach: f64, spare: i64, size: WindowSize, direction: Direction, survey: &Survey) -> SpanBy {
    let width = reach / size.overlap() as f64 * (1.0 + 2e-6) + spare as f64 * survey.unit;
    SpanBy::Width { width, direction }
}

/// Whether distances in steps are what the library computes, so that ties are ties.
fn is_exact(survey: &Survey) -> bool {
    survey.lattice.is_whole() || survey.unit == 1.0
}

/// Counts what a segmentor leaves undecided.
struct Counting {
    segmentor: RegionGrowing,
    undecided: Arc<AtomicU64>,
}

impl Segmentor for Counting {
    fn name(&self) -> &str {
        self.segmentor.name()
    }

    fn exactness(&self) -> Exactness {
        self.segmentor.exactness()
    }

    fn attributes(&self) -> Vec<String> {
        self.segmentor.attributes()
    }

    fn neighborhood(&self) -> Option<Search> {
        self.segmentor.neighborhood()
    }

    fn looks_at_neighbors(&self) -> bool {
        self.segmentor.looks_at_neighbors()
    }

    fn segment(&self, window: &Window) -> Result<Segmented> {
        let segmented = self.segmentor.segment(window)?;
        self.undecided.fetch_add(segmented.tally.waiting_points, Ordering::Relaxed);
        Ok(segmented)
    }
}

proptest! {
    #![proptest_config(cases(192))]

    /// The static result of either form is its twin's, with attributes that were given and with computed ones.
    #[test]
    fn static_is_the_twin(
        cloud in cloud(), survey in survey().prop_filter("exact", is_exact), sought in sought(), growth in growth(),
        form in form(), seed in any::<u64>(),
    ) {
        let points = survey.told(&cloud);
        let growing = growing(Growth { form, ..growth }, sought, &survey);
        let near = neighbors(&survey.in_units(&cloud), sought.k, sought.squared);
        let twin = |columns: &[Vec<f64>]| {
            let surface = surface(&points, columns, growing.growth(), &survey);
            match form {
                Form::OrderFree => order_free(&surface, &near),
                Form::Literal { smooth } => literal(&surface, &near, smooth),
            }
        };
        let given = made_up(cloud.len(), growth.curvature, seed);
        let found = static_labels_with(&points, &given, survey.lattice, &growing);
        prop_assert_eq!(canonical(&found), canonical(&twin(&given)));
        let found = static_labels(&points, survey.lattice, &recipe(growing));
        prop_assert_eq!(canonical(&found), canonical(&twin(&computed(&points, &growing, &survey))));
    }

    /// Class B: with a radius, streamed = static, and nothing is left undecided.
    #[test]
    fn within_a_radius_streamed_is_static(
        cloud in cloud(), survey in survey(), sought in within_radius(), growth in growth(), size in overlapping(),
        spare in prop::sample::select(vec![0i64, 1, 7, 40]), direction in direction(), seed in any::<u64>(),
        threads in prop::sample::select(vec![1usize, 2, 4]), chunk in 1usize..30,
    ) {
        let points = survey.told(&cloud);
        let segmentor = growing(growth, sought, &survey);
        let by = wide_enough(segmentor.growth().search.reach(), spare, size, direction, &survey);
        let run = Run { by, size, source: Source::Stored, chunks: vec![chunk], threads };
        let undecided = Arc::new(AtomicU64::new(0));
        let counting = || Counting { segmentor, undecided: undecided.clone() };

        prop_assert!(segmentor.exactness().assess(by, size, &survey.lattice).is_identical);
        let given = made_up(cloud.len(), growth.curvature, seed);
        let outcome = stream_with(&points, &given, survey.lattice, Arc::new(counting()), &run);
        let whole = static_labels_with(&points, &given, survey.lattice, &segmentor);
        prop_assert_eq!(canonical(&outcome.settled), canonical(&whole));

        let recipe = recipe(counting());
        prop_assert!(recipe.exactness().assess(by, size, &survey.lattice).is_identical);
        let whole = static_labels(&points, survey.lattice, &recipe);
        let outcome = stream(&points, survey.lattice, Arc::new(recipe), &run);
        prop_assert_eq!(canonical(&outcome.settled), canonical(&whole));
        prop_assert_eq!(undecided.load(Ordering::Relaxed), 0);
    }

    /// Without a radius what is labelled is together only where it is in the whole cloud, and what is not is counted.
    #[test]
    fn without_a_radius_streamed_splits_but_never_merges(
        cloud in cloud(), survey in survey(), k in 1usize..9, growth in growth(), size in overlapping(),
        width in 1i64..60, direction in direction(), seed in any::<u64>(),
    ) {
        let points = survey.told(&cloud);
        let segmentor = growing(growth, Sought { k: Some(k), squared: None }, &survey);
        let by = SpanBy::Width { width: width as f64 * survey.unit, direction };
        let run = Run { by, size, source: Source::Stored, chunks: vec![7], threads: 1 };
        let check = |outcome: &Outcome, whole: &[i64], undecided: u64| {
            let labelled: Vec<usize> = (0..cloud.len()).filter(|&i| outcome.settled[i] != NONE).collect();
            let streamed: Vec<i64> = labelled.iter().map(|&i| outcome.settled[i]).collect();
            let of_whole: Vec<i64> = labelled.iter().map(|&i| whole[i]).collect();
            prop_assert!(!of_whole.contains(&NONE), "a point is labelled that has no segment");
            prop_assert!(refines(&streamed, &of_whole), "points of two segments are joined");
            let missing = whole.iter().filter(|id| **id != NONE).count() - labelled.len();
            prop_assert!(missing as u64 <= undecided, "{} are missing, {} undecided", missing, undecided);
            // Where all was decided in every window, only pairs that share no window can be missing.
            Ok(())
        };
        let undecided = Arc::new(AtomicU64::new(0));
        let counting = || Counting { segmentor, undecided: undecided.clone() };
        let given = made_up(cloud.len(), growth.curvature, seed);
        let outcome = stream_with(&points, &given, survey.lattice, Arc::new(counting()), &run);
        let whole = static_labels_with(&points, &given, survey.lattice, &segmentor);
        check(&outcome, &whole, undecided.swap(0, Ordering::Relaxed))?;

        let recipe = recipe(counting());
        let whole = static_labels(&points, survey.lattice, &recipe);
        undecided.store(0, Ordering::Relaxed);
        let outcome = stream(&points, survey.lattice, Arc::new(recipe), &run);
        check(&outcome, &whole, undecided.load(Ordering::Relaxed))?;
    }

    /// Ids are the same for any number of threads and any chunks, and the order-free partition for any order of points
    /// where no two neighbors are equally far.
    #[test]
    fn ids_depend_neither_on_threads_nor_on_chunks(
        cloud in cloud(), survey in survey(), sought in sought(), growth in growth(), form in form(),
        size in overlapping(), width in 1i64..60, direction in direction(), chunk in 1usize..30,
        count in prop::option::of(1usize..30),
    ) {
        let points = survey.told(&cloud);
        let by = match count {
            Some(points) => SpanBy::Count { points },
            None => SpanBy::Width { width: width as f64 * survey.unit, direction },
        };
        let outcome = |threads, chunks| {
            let run = Run { by, size, source: Source::Stored, chunks, threads };
            let recipe = recipe(growing(Growth { form, ..growth }, sought, &survey));
            stream(&points, survey.lattice, Arc::new(recipe), &run)
        };
        let first = outcome(1, vec![points.len().max(1)]);
        prop_assert_eq!(&outcome(2, vec![chunk]), &first);
        prop_assert_eq!(&outcome(4, vec![1, chunk]), &first);
    }

    /// With all points within a radius as neighbors there are no ties but those of rough points, so the order of the
    /// points decides nothing about the smooth ones.
    #[test]
    fn the_order_of_points_does_not_matter(
        cloud in cloud(), squared in squared_distance(), growth in growth(), seed in any::<u64>(),
        order in any::<prop::sample::Index>(),
    ) {
        let survey = plain();
        let growth = Growth { max_curvature: None, ..growth };
        let growing = growing(growth, Sought { k: None, squared: Some(squared) }, &survey);
        let points = survey.told(&cloud);
        let columns = made_up(cloud.len(), growth.curvature, seed);
        let whole = static_labels_with(&points, &columns, survey.lattice, &growing);
        let turn = order.index(cloud.len() + 1);
        let turned = |of: &[f64]| [&of[turn..], &of[..turn]].concat().into_iter().rev().collect::<Vec<f64>>();
        let turned_points: Vec<_> = points[turn..].iter().chain(&points[..turn]).rev().copied().collect();
        let turned_columns: Vec<Vec<f64>> = columns.iter().map(|column| turned(column)).collect();
        let again = static_labels_with(&turned_points, &turned_columns, survey.lattice, &growing);
        let expected: Vec<i64> = whole[turn..].iter().chain(&whole[..turn]).rev().copied().collect();
        prop_assert_eq!(canonical(&again), canonical(&expected));
    }
}

fn plain() -> Survey {
    Survey::whole(1.0, [1; 3], [0.0; 3])
}

#[test]
fn wrong_parameters_are_told() {
    let wrong = |growth: Growth| RegionGrowing::new(growth).unwrap_err().to_string();
    let default = Growth::default();
    assert_eq!(wrong(Growth { angle_deg: 91.0, ..default }), "angle_deg is 91, allowed: degrees from 0 to 90");
    assert!(wrong(Growth { angle_deg: f64::NAN, ..default }).starts_with("angle_deg is NaN"));
    assert!(wrong(Growth { max_curvature: Some(-1.0), ..default }).contains("at least 0, or None for no limit"));
    assert!(wrong(Growth { residual: Some(f64::INFINITY), ..default }).starts_with("residual is inf"));
    assert!("gauss".parse::<Curvature>().unwrap_err().to_string().contains("'gauss'"));
}

#[test]
fn a_window_without_normals_is_refused() {
    let growing = RegionGrowing::new(Growth::default()).unwrap();
    let window = Window::new(0, vec![], streamseg::lattice::Lattice::REAL);
    assert!(growing.segment(&window).unwrap_err().to_string().contains("'NormalX'"));
}
