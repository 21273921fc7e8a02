//! What holds for whole scenes, of both kinds.

use std::collections::{BTreeMap, BTreeSet};

use super::classification as class;
use super::geometry::Bounds;
use super::road::Street;
use super::village::Village;
use super::world::{Layout, object_id};
use super::{GROUND_OBJECT, NO_OBJECT, SCALE, Scene, ScenePoint};

const SEED: u64 = 7;
const MILLION: usize = 1_000_000;

/// FNV-1a over every field of the points.
fn digest(points: impl Iterator<Item = ScenePoint>) -> u64 {
    let mut digest: u64 = 0xcbf2_9ce4_8422_2325;
    let mut take = |bytes: &[u8]| {
        for byte in bytes {
            digest = (digest ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
        }
    };
    for point in points {
        for coordinate in point.position {
            take(&coordinate.to_le_bytes());
        }
        take(&point.gps_time.to_bits().to_le_bytes());
        take(&point.intensity.to_le_bytes());
        let flags = [u8::from(point.scan_direction), u8::from(point.edge_of_flight_line)];
        take(&[point.return_number, point.number_of_returns, point.classification, flags[0], flags[1]]);
        take(&point.object_id.to_le_bytes());
    }
    digest
}

/// Metres from the origin of the lattice.
fn local(point: &ScenePoint) -> [f64; 3] {
    point.position.map(|coordinate| f64::from(coordinate) * SCALE)
}

fn smallest_and_largest(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)))
}

/// The boxes of all objects that stand in the first blocks, by id.
fn known_bounds(layout: &impl Layout, blocks: i64) -> BTreeMap<i64, Bounds> {
    let in_block = |block| {
        let objects = layout.objects(block).into_iter().enumerate();
        objects.map(move |(ordinal, object)| (object_id(block, ordinal), object.bounds()))
    };
    (0..blocks).flat_map(in_block).collect()
}

fn check_inside(scene: Scene, bounds: &BTreeMap<i64, Bounds>, margin: f64) {
    for point in scene.take(MILLION).filter(|point| point.object_id > GROUND_OBJECT) {
        let known = bounds[&point.object_id].grown(margin);
        let position = local(&point);
        let is_inside = (0..3).all(|axis| (known.low[axis]..=known.high[axis]).contains(&position[axis]));
        assert!(is_inside, "{point:?} is not in {known:?}");
    }
}

/// Return numbers, times and flags, pulse by pulse.
fn check_pulses(scene: Scene) {
    let points: Vec<ScenePoint> = scene.take(MILLION).collect();
    assert!(points.is_sorted_by(|a, b| a.gps_time <= b.gps_time));
    let pulses: Vec<&[ScenePoint]> = points.chunk_by(|a, b| a.gps_time == b.gps_time).collect();
    for pulse in &pulses[..pulses.len() - 1] {
        for (number, point) in (1_u8..).zip(*pulse) {
            assert_eq!(point.return_number, number);
            assert_eq!(usize::from(point.number_of_returns), pulse.len());
            assert_eq!(point.edge_of_flight_line, pulse[0].edge_of_flight_line);
            assert_eq!(point.scan_direction, pulse[0].scan_direction);
        }
        assert!(pulse.iter().all(|point| point.intensity > 0));
    }
    for point in &points {
        let is_noise = [class::LOW_NOISE, class::HIGH_NOISE].contains(&point.classification);
        let is_ground = [class::GROUND, class::ROAD_SURFACE].contains(&point.classification);
        assert_eq!(point.object_id == NO_OBJECT, is_noise);
        assert_eq!(point.object_id == GROUND_OBJECT, is_ground);
    }
}

fn check_all_kinds(scene: Scene) {
    let mut points_by_class = BTreeMap::new();
    let mut objects_by_class: BTreeMap<u8, BTreeSet<i64>> = BTreeMap::new();
    for point in scene.take(MILLION) {
        *points_by_class.entry(point.classification).or_insert(0) += 1;
        objects_by_class.entry(point.classification).or_default().insert(point.object_id);
    }
    for expected in
        [class::GROUND, class::LOW_VEGETATION, class::MEDIUM_VEGETATION, class::LOW_NOISE, class::HIGH_NOISE]
    {
        assert!(points_by_class.contains_key(&expected), "class {expected} is missing");
    }
    let objects = [
        class::HIGH_VEGETATION,
        class::BUILDING,
        class::WIRE_CONDUCTOR,
        class::TRANSMISSION_TOWER,
        class::CAR,
        class::POLE,
    ];
    for expected in objects {
        let number = objects_by_class.get(&expected).map_or(0, BTreeSet::len);
        assert!(number >= 3, "{number} objects of class {expected}");
    }
}

#[test]
fn a_scene_is_the_same_on_every_machine() {
    // These numbers change when, and only when, the scenes are meant to change.
    assert_eq!(digest(Scene::airborne_strip(SEED).take(50_000)), 0x87d2_a4d3_1f45_5752, "airborne");
    assert_eq!(digest(Scene::street(SEED).take(50_000)), 0x4ea0_efee_91c0_b0b1, "street");
}

#[test]
fn seeds_differ() {
    assert_ne!(digest(Scene::airborne_strip(1).take(1000)), digest(Scene::airborne_strip(2).take(1000)));
    assert_ne!(digest(Scene::street(1).take(1000)), digest(Scene::street(2).take(1000)));
}

#[test]
fn it_does_not_matter_in_how_many_pieces_a_scene_is_taken() {
    for scene in [Scene::airborne_strip(SEED), Scene::street(SEED)] {
        let whole: Vec<ScenePoint> = scene.clone().take(100_000).collect();
        let mut rest = scene;
        let mut pieces = Vec::new();
        for size in (1..).map(|number| number * number % 997) {
            pieces.extend(rest.by_ref().take(size.min(whole.len() - pieces.len())));
            if pieces.len() == whole.len() {
                break;
            }
        }
        assert_eq!(pieces, whole);
    }
}

#[test]
fn pulses_are_consistent() {
    check_pulses(Scene::airborne_strip(SEED));
    check_pulses(Scene::street(SEED));
}

#[test]
fn a_million_points_show_every_kind_of_object() {
    for seed in 1..4 {
        check_all_kinds(Scene::airborne_strip(seed));
        check_all_kinds(Scene::street(seed));
    }
}

#[test]
fn no_point_lies_outside_its_object() {
    // What a footprint and the noise of range and pointing may add.
    check_inside(Scene::airborne_strip(SEED), &known_bounds(&Village::new(SEED), 8), 0.25);
    check_inside(Scene::street(SEED), &known_bounds(&Street::new(SEED), 5), 0.1);
}

#[test]
fn a_strip_is_as_wide_and_as_dense_as_promised() {
    let points: Vec<ScenePoint> = Scene::airborne_strip(SEED).take(MILLION).collect();
    let (south, north) = smallest_and_largest(points.iter().map(|point| local(point)[1]));
    let (west, east) = smallest_and_largest(points.iter().map(|point| local(point)[0]));
    assert!((185.0..215.0).contains(&(north - south)), "{} m wide", north - south);
    let density = 1e6 / ((north - south) * (east - west));
    assert!((8.0..11.0).contains(&density), "{density} points per square metre");
    let deep = points.iter().filter(|point| point.number_of_returns >= 3).count();
    assert!(deep > 20_000, "{deep} points of pulses with three returns or more");
}

#[test]
fn a_street_is_as_long_as_promised() {
    let points: Vec<ScenePoint> = Scene::street(SEED).take(MILLION).collect();
    let (west, east) =
        smallest_and_largest(points.iter().filter(|point| point.object_id > 1).map(|point| local(point)[0]));
    assert!((150.0..300.0).contains(&(east - west)), "{} m long", east - west);
}

#[test]
fn an_airborne_scanner_sees_some_walls() {
    let layout = Village::new(SEED);
    let bounds = known_bounds(&layout, 8);
    let roofs = Scene::airborne_strip(SEED).take(MILLION).filter(|point| point.classification == class::BUILDING);
    // No eave is lower than 2.2 m, and walls start 2.5 m below the ground.
    let on_walls = roofs.filter(|point| local(point)[2] < bounds[&point.object_id].low[2] + 2.5 + 1.8).count();
    assert!(on_walls > 200, "{on_walls} points on walls");
}
