"""Proximity against its slow twins: on anything, on what triangulators stumble over, and on measured clouds."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import laspy
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from numpy.typing import NDArray

import streamseg as ss
from reference import segmentor as twin
from reference.clouds import LatticeCloud
from reference.partition import refines, same

Steps = NDArray[np.int64]

UTM = np.array([500_000.0, 5_400_000.0, 300.0])


def write_las(path: Path, steps: Steps, scales: tuple[float, float, float] = (0.01, 0.01, 0.01)) -> Path:
    header = laspy.LasHeader(point_format=0, version="1.2")
    header.scales, header.offsets = np.array(scales), UTM
    las = laspy.LasData(header)
    las.X, las.Y, las.Z = steps.T.astype(np.int32)
    las.write(str(path))
    return path


def assert_equals_twins(points: Steps, distance: float) -> None:
    """Both metrics exactly; the edges of the xyz metric are those that any triangulation has."""
    assert same(ss.segment_static(points, ss.Proximity(distance, metric="xy")), twin.radius(points, distance))
    labels = ss.segment_static(points, ss.Proximity(distance))
    assert labels.min(initial=1) >= 1
    places = np.unique(points[:, :2], axis=0)
    _, canonical = twin.sure_and_possible_edges(places)
    assert same(labels, twin.proximity(points, distance, edges=canonical))


def points_on(spread: int) -> st.SearchStrategy[Steps]:
    coordinate = st.integers(-spread, spread)
    cloud = st.lists(st.tuples(coordinate, coordinate, st.integers(-4, 4)), max_size=14)
    return cloud.map(lambda rows: np.array(rows, np.int64).reshape(-1, 3))


@given(points_on(4), st.sampled_from([1.0, 1.5, 2.0, 3.0, 5.0]))
def test_quantised_points_with_many_on_one_circle_line_or_place(points: Steps, distance: float) -> None:
    assert_equals_twins(points, distance)


@given(points_on(1000), st.integers(1, 1500).map(float))
@example(np.array([[0, 0, 0], [1000, 1, 0], [-1000, -1, 0], [500, 0, 0]]), 500.0)
def test_scattered_points(points: Steps, distance: float) -> None:
    assert_equals_twins(points, distance)


@given(
    st.lists(st.tuples(st.integers(0, 20_000), st.integers(0, 1), st.integers(0, 3)), max_size=12), st.integers(1, 9000)
)
def test_nearly_collinear_points(rows: list[tuple[int, int, int]], distance: int) -> None:
    x, aside, z = np.array(rows, np.int64).reshape(-1, 3).T
    assert_equals_twins(np.column_stack([3 * x, 7 * x + aside, z]), float(distance))


@pytest.mark.parametrize("metric", ["xyz", "xy"])
def test_no_one_and_two_points(metric: str) -> None:
    proximity = ss.Proximity(1.0, metric=metric)
    assert ss.segment_static(np.empty((0, 3)), proximity).tolist() == []
    assert ss.segment_static(np.array([[5.0, 5, 5]]), proximity).tolist() == [1]
    assert ss.segment_static(np.array([[5.0, 5, 5], [6, 5, 5]]), proximity).tolist() == [1, 1]
    assert ss.segment_static(np.array([[5.0, 5, 5], [6.5, 5, 5]]), proximity).tolist() == [1, 2]


def test_coincident_points_are_one_segment() -> None:
    points = np.full((1000, 3), 7.25)
    assert ss.segment_static(points, ss.Proximity(0.001)).tolist() == [1] * 1000


def test_minus_zero_is_zero() -> None:
    points = np.array([[0.0, 0.0, 0.0], [-0.0, 0.0, 5.0], [0.0, -0.0, 1.0], [-0.0, -0.0, 6.0]])
    assert ss.segment_static(points, ss.Proximity(1.0)).tolist() == [1, 2, 1, 2]
    assert ss.segment_static(points, ss.Proximity(1.0, metric="xy")).tolist() == [1, 1, 1, 1]


def test_a_wall_is_split_where_it_has_a_gap_and_joins_its_neighbor_at_any_height() -> None:
    heights = np.concatenate([np.arange(0, 30), np.arange(40, 60)])
    wall = np.column_stack([np.zeros((len(heights), 2), np.int64), heights])
    beside = np.array([[1, 0, 15], [1, 0, 50], [1, 0, 34]])
    labels = ss.segment_static(np.concatenate([wall, beside]).astype(float), ss.Proximity(2.0))
    assert labels.tolist() == [1] * 30 + [2] * 20 + [1, 2, 3]


@pytest.mark.parametrize("seed", range(6))
def test_tall_stacks_of_equal_xy(seed: int) -> None:
    random = np.random.default_rng(seed)
    places = random.integers(0, 500, (8, 2))
    points = np.column_stack([places[random.integers(0, 8, 400)], random.integers(0, 3000, 400)])
    for distance in (5.0, 20.0, 100.0, 250.0):
        assert_equals_twins(points, distance)


@pytest.mark.parametrize("distance", [1.0, 1.2, 1.5])
@pytest.mark.parametrize("size", [2, 3, 40])
def test_a_grid_is_one_segment_from_its_spacing_on(size: int, distance: float) -> None:
    x, y = np.meshgrid(np.arange(size), np.arange(size))
    grid = np.column_stack([x.ravel(), y.ravel(), np.zeros(size * size)])
    assert np.all(ss.segment_static(grid, ss.Proximity(distance)) == 1)
    assert len(np.unique(ss.segment_static(grid, ss.Proximity(0.999)))) == size * size


@pytest.mark.parametrize("metric", ["xyz", "xy"])
def test_a_pair_at_exactly_the_distance_is_joined(tmp_path: Path, metric: str) -> None:
    # Pythagorean triples: 36² + 48² = 60², one step further is apart. Each pair is alone in its place.
    random = np.random.default_rng(11)
    corner = 5000 * np.column_stack([np.arange(200), random.permutation(200), np.zeros(200, np.int64)])
    corner[:, :2] += random.integers(0, 3000, (200, 2))
    at, beyond = corner + np.array([36, 48, 0]), corner + np.array([36, 49, 0])
    for second, joined in ((at, True), (beyond, False)):
        steps = np.concatenate([corner, second])
        expected = np.concatenate([np.arange(1, 201), np.arange(1, 201) + (0 if joined else 200)])
        path = write_las(tmp_path / "pairs.las", steps)
        for source in (path, steps * 0.01 + UTM, laspy.read(path).xyz):
            labels = ss.segment_static(source, ss.Proximity(0.6, metric=metric))
            assert np.array_equal(labels, expected)


def test_a_pair_at_exactly_the_distance_is_joined_where_the_axes_have_scales_of_their_own(tmp_path: Path) -> None:
    # 36 · 0.01 and 240 · 0.002 are the sides of a triangle with a hypotenuse of 0.6; 36 · 0.01 and 480 · 0.001 too.
    scales = (0.01, 0.002, 0.001)
    corner = 10_000 * np.column_stack([np.arange(20), np.arange(20) ** 2 % 19, np.zeros(20, np.int64)])
    for difference, joined in (
        ((36, 240, 0), True),
        ((36, 241, 0), False),
        ((36, 0, 480), True),
        ((36, 0, 481), False),
    ):
        path = write_las(tmp_path / "pairs.las", np.concatenate([corner, corner + difference]), scales)
        labels = ss.segment_static(path, ss.Proximity(0.6))
        assert np.array_equal(labels[:20], np.arange(1, 21))
        assert np.array_equal(labels[20:], np.arange(1, 21) + (0 if joined else 20))


def test_exactly_the_distance_in_height(tmp_path: Path) -> None:
    stack = np.array([[7, 7, 0], [7, 7, 70], [7, 7, 141], [7, 77, 141], [77, 7, 211]])
    for source in (write_las(tmp_path / "stack.las", stack), stack * 0.01 + UTM):
        assert ss.segment_static(source, ss.Proximity(0.7)).tolist() == [1, 1, 2, 2, 3]


@given(points_on(30), st.sampled_from([0.05, 0.1, 0.13, 0.3]))
def test_floats_of_a_utm_lattice_equal_the_lattice(points: Steps, distance: float) -> None:
    for metric in ("xyz", "xy"):
        labels = ss.segment_static(points * 0.01 + UTM, ss.Proximity(distance, metric=metric))
        if metric == "xy":
            assert same(labels, twin.radius(points, distance, 0.01))
            continue
        sure, possible = twin.sure_and_possible_edges(np.unique(points[:, :2], axis=0))
        assert refines(twin.proximity(points, distance, 0.01, edges=sure), labels)
        assert refines(labels, twin.proximity(points, distance, 0.01, edges=possible))


def test_points_on_one_line_are_no_burden() -> None:
    # A triangulator that is quadratic on collinear points would not end.
    count = 200_000
    for line in (np.array([1, 0, 0]), np.array([0, 1, 0]), np.array([3, 7, 1])):
        points = np.arange(count)[:, None] * line
        points[count // 2 :] += 5 * line
        labels = ss.segment_static(points, ss.Proximity(1.5 * float(np.linalg.norm(line))))
        assert np.array_equal(labels, 1 + (np.arange(count) >= count // 2))


def test_two_parallel_scan_lines_are_no_burden() -> None:
    count = 100_000
    x = np.arange(count)
    lines = np.concatenate([np.column_stack([x, np.full(count, y), np.zeros(count)]) for y in (0, 3)])
    assert np.array_equal(ss.segment_static(lines, ss.Proximity(2.0)), np.repeat([1, 2], count))
    assert np.all(ss.segment_static(lines, ss.Proximity(3.0)) == 1)


def test_one_tall_stack_is_no_burden() -> None:
    count = 200_000
    stack = np.column_stack([np.zeros((count, 2)), np.random.default_rng(5).permutation(count)])
    assert np.all(ss.segment_static(stack, ss.Proximity(1.0)) == 1)
    assert len(np.unique(ss.segment_static(stack, ss.Proximity(0.9)))) == count


@pytest.mark.parametrize("seed", range(3))
def test_random_clouds_equal_qhull(seed: int) -> None:
    # On so fine a lattice four points on one circle do not happen.
    points = np.random.default_rng(seed).integers(0, 10**7, (20_000, 3))
    points[:, 2] //= 100
    for distance in (20_000.0, 60_000.0, 90_000.0):
        for metric in ("xyz", "xy"):
            labels = ss.segment_static(points, ss.Proximity(distance, metric=metric))
            assert same(labels, twin.proximity(points, distance, metric=metric))
        assert same(labels, twin.radius(points, distance))


@pytest.mark.parametrize(
    ("name", "distance"),
    [
        ("als/topography.laz", 0.9),
        ("als/mixed_conifer.laz", 1.0),
        ("als/chablais3.laz", 0.4),
        ("als/autzen_trim.laz", 3.0),
    ],
)
def test_measured_clouds_equal_qhull(cloud: Callable[[str], LatticeCloud], name: str, distance: float) -> None:
    path, points, scale = cloud(name)
    labels = ss.segment_static(path, ss.Proximity(distance))
    expected = twin.proximity(points, distance, scale)
    # Of four points on one circle either diagonal may be an edge; that decides something for very few.
    parts, expected_parts = len(np.unique(labels)), len(np.unique(expected))
    print(f"{name} at {distance}: {parts} segments, Qhull {expected_parts}")
    assert abs(parts - expected_parts) <= 1e-3 * expected_parts
    assert same(ss.segment_static(path, ss.Proximity(distance, metric="xy")), twin.radius(points, distance, scale))


def test_the_papers_cloud_at_its_distance(data: Path) -> None:
    labels = ss.segment_static(data / "isprs" / "CSite3.laz", ss.Proximity(2.5))
    sizes = np.bincount(labels)
    print(f"CSite3 at 2.5 m: {len(sizes) - 1} segments, the largest has {sizes.max()} points")
    assert len(sizes) - 1 == 17_542
    assert sizes.max() == 223_089
    assert sizes[0] == 0
    assert labels.min() == 1
