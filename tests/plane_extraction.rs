//! Planes depend on the points and their ids alone, and every plane keeps to its limits.
#![cfg(not(loom))]
#![allow(clippy::unwrap_used)]

use std::sync::Arc;

use proptest::prelude::*;
use streamseg::expression::Calculator;
use streamseg::features::Fit;
use streamseg::lattice::Lattice;
use streamseg::neighborhood::Search;
use streamseg::recipe::{Ingredients, Recipe};
use streamseg::segmentor::{Coplanarity, PlaneExtraction, Segmented, Segmentor};
use streamseg::span::{PointIds, Span};
use streamseg::window::Window;

const LIMITS: Coplanarity =
    Coplanarity { max_distance: 0.1, max_sigma: 0.06, min_angle_deg: 10.0, tile_size: Some(4.0) };

fn extraction() -> Recipe {
    let calculator = Calculator::parse("NormalSigma0 < 0.05 ? NormalSigma0 : invalid").unwrap();
    let segmentor = Arc::new(PlaneExtraction::new(Search::ball(1.0).unwrap(), LIMITS, calculator).unwrap());
    let fit = Fit::default();
    let ingredients = Ingredients { stages: vec![], filter: None, seed_filter: None, fit, segmentor };
    Recipe::new(ingredients, &[], false).unwrap()
}

fn segmented(points: Vec<[f64; 3]>, point_ids: Vec<i64>) -> Segmented {
    let lattice = Lattice::new([0.01; 3], [500_000.0, 5_400_000.0, 0.0]).unwrap();
    let span = Span { index: 0, point_ids: PointIds::Listed(point_ids), points, attributes: vec![], extent: None };
    extraction().segment(&Window::new(0, vec![Arc::new(span)], lattice)).unwrap()
}

/// Two slopes that meet in a ridge, with some noise, in centimeters.
fn roofs() -> impl Strategy<Value = Vec<[f64; 3]>> {
    let place = (0i32..800, 0i32..600, -4i32..5);
    let height = |x: i32| if x < 400 { x / 2 } else { (800 - x) / 2 };
    let point = move |(x, y, noise): (i32, i32, i32)| [x, y, height(x) + noise].map(f64::from);
    prop::collection::vec(place.prop_map(point), 0..600)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn where_a_point_stands_in_the_window_does_not_matter(points in roofs(), seed in any::<u64>()) {
        let ids: Vec<i64> = (0..points.len() as i64).collect();
        let mut order: Vec<usize> = (0..points.len()).collect();
        order.sort_by_key(|&i| (i as u64 + 1).wrapping_mul(seed | 1).rotate_left(17));
        let plain = segmented(points.clone(), ids);
        let shuffled = segmented(order.iter().map(|&i| points[i]).collect(), order.iter().map(|&i| i as i64).collect());
        let (plain, shuffled) = (plain.labels.of_points(), shuffled.labels.of_points());
        let mut pairs: Vec<(i32, i32)> = order.iter().zip(shuffled).map(|(&i, &label)| (plain[i], label)).collect();
        pairs.sort_unstable();
        pairs.dedup();
        prop_assert!(pairs.windows(2).all(|pair| pair[0].0 != pair[1].0), "{:?}", pairs);
        pairs.sort_unstable_by_key(|pair| pair.1);
        prop_assert!(pairs.windows(2).all(|pair| pair[0].1 != pair[1].1), "{:?}", pairs);
        prop_assert!(pairs.iter().all(|pair| (pair.0 < 0) == (pair.1 < 0)));
    }

    #[test]
    fn planes_are_even_and_lie_on_the_slopes(points in roofs()) {
        let ids = (0..points.len() as i64).collect();
        let planes = segmented(points, ids).planes.unwrap();
        for plane in planes.iter().filter(|plane| plane.points > 30) {
            prop_assert!(plane.sigma0 < LIMITS.max_sigma, "{:?}", plane);
            let slope = (plane.normal[0] / plane.normal[2]).abs();
            prop_assert!((slope - 0.5).abs() < 0.15, "{:?}", plane);
        }
    }
}
