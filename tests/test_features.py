"""Features of points, beside a NumPy twin and beside surfaces of known curvature."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

import streamseg as ss
from reference import features as twin
from reference.clouds import LatticeCloud

NAMES = [*twin.PLANE, *twin.CURVATURE]
EXACT = 1e-9

Reals = NDArray[np.float64]


def tolerance(name: str, expected: twin.Twin) -> float:
    """Absolute for unit normals and ratios, relative to the size of the neighborhood or of the curvatures elsewhere."""
    if name.startswith("NormalEigenvalue") or name == "Omnivariance":
        return EXACT * expected.spread**2
    if name == "NormalSigma0":
        return EXACT * expected.spread
    if name in twin.CURVATURE:
        size = max(abs(expected.values[curvature]) for curvature in ("MaxCurvature", "MinCurvature"))
        # A flat neighborhood has a curvature of 0 but for rounding.
        size = EXACT * max(size, 1e-3 / expected.spread)
        return size if name != "GaussianCurvature" else size * size / EXACT
    return EXACT


def assert_equal(found: dict[str, Reals], queries: Sequence[int], expected: Iterable[twin.Twin]) -> int:
    """Compare; return at how many points normals or curvatures are not determined and were left out."""
    undetermined = 0
    for query, wanted in zip(queries, expected, strict=True):
        without_curvature = not wanted.is_wide or 1e-7 < wanted.pivot < 1e-5
        undetermined += without_curvature
        for name in NAMES:
            value, other = found[name][query], wanted.values[name]
            if name in twin.CURVATURE and without_curvature:
                continue
            if name in ("NormalX", "NormalY", "NormalZ", "Verticality") and not wanted.is_apart:
                assert np.isnan(value) == np.isnan(other), f"{name} of point {query}"
                continue
            if abs(wanted.values["NormalZ"]) < EXACT:
                # A normal that is level but for rounding may be turned over, and curvatures with it.
                if name in ("MaxCurvature", "MinCurvature"):
                    continue
                value, other = abs(value), abs(other)
            assert np.isnan(value) == np.isnan(other), f"{name} of point {query} is {value}, expected {other}"
            if not np.isnan(value):
                off = abs(value - other)
                assert off <= tolerance(name, wanted), f"{name} of point {query} is {value}, expected {other}"
    return undetermined


def twins(
    points: NDArray[Any], queries: Sequence[int], neighbors: Iterable[NDArray[np.int64]], scale: float = 1.0
) -> Iterator[twin.Twin]:
    for query, near in zip(queries, neighbors, strict=True):
        yield twin.features((points[near] - points[query]) * scale)


SMALL = st.integers(-4, 4)
CLOUDS = st.one_of(
    st.lists(st.tuples(SMALL, SMALL, SMALL), max_size=40),
    st.lists(st.tuples(SMALL, SMALL, st.just(0)), max_size=40),
    st.lists(st.tuples(SMALL, SMALL, SMALL).map(lambda p: (p[0], 2 * p[0] + p[1] // 4, p[2] // 4)), max_size=30),
    st.lists(st.tuples(SMALL, SMALL, SMALL).map(lambda p: (1000 * p[0], p[1], 50 * p[0] + p[2])), max_size=40),
)


@given(CLOUDS, st.integers(1, 20), st.booleans())
def test_nearest_of_small_clouds(rows: list[tuple[int, int, int]], k: int, flat: bool) -> None:
    points = np.array(rows, float).reshape(-1, 3)
    queries = range(len(points))
    found = ss.features(points, NAMES, k=k, search_mode="2d" if flat else "3d")
    assert_equal(found, queries, twins(points, queries, twin.nearest(points, queries, k, 2 if flat else 3)))


@given(CLOUDS, st.sampled_from([1.0, 2.0, 3.0, 5.0, 1001.0]), st.sampled_from(["2d", "2.5d", "3d"]))
def test_radius_in_small_clouds(rows: list[tuple[int, int, int]], radius: float, mode: Any) -> None:
    points = np.array(rows, float).reshape(-1, 3)
    queries = range(len(points))
    limits = (-1.0, 2.0) if mode == "2.5d" else (-np.inf, np.inf)
    found = ss.features(points, NAMES, search_radius=[radius, *limits] if mode == "2.5d" else radius, search_mode=mode)
    neighbors = twin.around(points, queries, radius, 3 if mode == "3d" else 2, *limits)
    assert_equal(found, queries, twins(points, queries, neighbors))


def test_eigenvalues_and_normals_are_those_of_numpy() -> None:
    random = np.random.default_rng(1)
    points = random.normal(size=(300, 3)) * [3.0, 1.0, 0.01]
    found = ss.features(points, NAMES, k=25)
    for query, near in enumerate(twin.nearest(points, range(300), 25)):
        values, vectors = np.linalg.eigh(np.cov(points[near], rowvar=False, bias=True))
        ours = [found[f"NormalEigenvalue{i}"][query] for i in (3, 2, 1)]
        np.testing.assert_allclose(ours, values, rtol=EXACT, atol=EXACT * values[-1])
        normal = [found[f"Normal{axis}"][query] for axis in "XYZ"]
        np.testing.assert_allclose(normal, twin.upward(vectors[:, 0]), rtol=0, atol=EXACT)


def sample(count: int, size: int) -> Sequence[int]:
    return np.random.default_rng(3).choice(count, size, replace=False).tolist()


def around_the_middle(points: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """Points nearest to the middle on the map, in their order."""
    far = np.abs(points[:, :2] - np.median(points[:, :2], axis=0)).max(axis=1)
    return points[np.sort(np.argpartition(far, count)[:count])]


@pytest.mark.parametrize(("name", "radius"), [("isprs/CSite3.laz", 250), ("als/delft_ahn3.laz", 1000)])
def test_measured_clouds(cloud: Callable[[str], LatticeCloud], name: str, radius: int) -> None:
    """Some 20,000 points of each, in steps of the lattice: 1 cm and 1 mm."""
    points = around_the_middle(cloud(name).points, 20_000)
    queries = sample(len(points), 300)
    found = ss.features(points, NAMES, k=30)
    left_out = assert_equal(found, queries, twins(points, queries, twin.nearest(points, queries, 30)))
    found = ss.features(points, NAMES, search_radius=radius)
    left_out += assert_equal(found, queries, twins(points, queries, twin.around(points, queries, radius)))
    print(f"{name}: {left_out} of {2 * len(queries)} left out: no determined normal or curvature")
    assert left_out <= 0.02 * 2 * len(queries)


def test_a_measured_file(cloud: Callable[[str], LatticeCloud]) -> None:
    tile = cloud("als/lidarhd_77050_627755.laz")
    queries = sample(len(tile.points), 300)
    found = ss.features(tile.path, NAMES, k=16)
    neighbors = twin.nearest(tile.points, queries, 16)
    left_out = assert_equal(found, queries, twins(tile.points, queries, neighbors, tile.scale))
    found = ss.features(tile.path, NAMES, search_radius=[1.0, 2.0], search_mode="2.5d")
    radius, height = round(1.0 / tile.scale), round(2.0 / tile.scale)
    neighbors = twin.around(tile.points, queries, radius, 2, -height, height)
    left_out += assert_equal(found, queries, twins(tile.points, queries, neighbors, tile.scale))
    print(f"{tile.path.name}: {left_out} of {2 * len(queries)} left out: no determined normal or curvature")
    assert left_out <= 0.02 * 2 * len(queries)


def test_a_frame_of_a_spinning_scanner(data: Path) -> None:
    points = np.fromfile(data / "spinning" / "kitti_a.bin", np.float32).reshape(-1, 4)[:, :3].astype(float)
    queries = sample(len(points), 400)
    found = ss.features(points, NAMES, k=30)
    left_out = assert_equal(found, queries, twins(points, queries, twin.nearest(points, queries, 30)))
    print(f"kitti_a: {left_out} of {len(queries)} left out: no determined normal or curvature")
    assert left_out <= 0.02 * len(queries)


def test_a_file_and_its_coordinates_have_the_same_features(cloud: Callable[[str], LatticeCloud]) -> None:
    measured = cloud("als/lidarhd_77050_627755.laz")
    names = ["NormalZ", "Planarity", "NeighborCount"]
    of_file = ss.features(measured.path, names, search_radius=1.0)
    of_array = ss.features(laspy.read(measured.path).xyz, names, search_radius=1.0)
    assert np.array_equal(of_file["NeighborCount"], of_array["NeighborCount"])
    # Planes of points that span a few steps are as uncertain as the rounding of real coordinates.
    off = np.abs(of_file["Planarity"] - of_array["Planarity"])
    assert np.nanmax(off) < 1e-6


def sphere(random: np.random.Generator) -> tuple[Reals, Reals, Reals, NDArray[np.bool_]]:
    """The cap of a sphere of radius 1, some 13,000 points; its border is not compared."""
    height, around = random.uniform(0.75, 1, 13_000), random.uniform(0, 2 * np.pi, 13_000)
    far = np.sqrt(1 - height**2)
    points = np.column_stack([far * np.cos(around), far * np.sin(around), height])
    return points, np.ones(len(points)), np.ones(len(points)), height > 0.87


def torus(random: np.random.Generator) -> tuple[Reals, Reals, Reals, NDArray[np.bool_]]:
    """A slice of a torus of radii 3 and 1, some 50,000 points evenly spread; its ends are not compared."""
    around, along = random.uniform(0, 2 * np.pi, 67_000), random.uniform(-0.16, 0.16, 67_000)
    even = random.uniform(0, 4, 67_000) < 3 + np.cos(around)
    around, along = around[even], along[even]
    far = 3 + np.cos(around)
    points = np.column_stack([far * np.cos(along), far * np.sin(along), np.sin(around)])
    return points, (3 + 2 * np.cos(around)) / (2 * far), np.cos(around) / far, far * np.abs(along) < 0.16 * far - 0.25


@pytest.mark.parametrize(("surface", "radius"), [(sphere, 0.17), (torus, 0.25)])
def test_curvature_of_known_surfaces(surface: Callable[..., Any], radius: float) -> None:
    """Radius 1 m, 1 mm noise in all directions, 1.1 cm between points; neighbors within 0.17 m, 0.25 m on the torus."""
    random = np.random.default_rng(7)
    points, mean, gaussian, inner = surface(random)
    found = ss.features(points + random.normal(0, 0.001, points.shape), NAMES[-4:], search_radius=radius)
    # H is positive where the surface bends toward its upward normal; these bend inward all around.
    off_mean = np.abs(np.abs(found["MeanCurvature"]) / mean - 1)[inner]
    off_gaussian = np.abs(found["GaussianCurvature"] / gaussian - 1)[inner]
    medians = f"mean {np.median(off_mean):.2%}, Gaussian {np.median(off_gaussian):.2%}"
    print(f"{surface.__name__}: {medians} at {np.count_nonzero(inner)} points")
    assert np.median(off_mean) < 0.02
    assert np.median(off_gaussian) < 0.02
    root = np.sqrt(np.maximum(found["MeanCurvature"] ** 2 - found["GaussianCurvature"], 0))
    np.testing.assert_allclose(found["MaxCurvature"], found["MeanCurvature"] + root, atol=1e-6)
    np.testing.assert_allclose(found["MinCurvature"], found["MeanCurvature"] - root, atol=1e-6)


def test_a_robust_normal_is_not_that_of_the_blunders() -> None:
    random = np.random.default_rng(5)
    points = np.column_stack([random.uniform(-1, 1, (500, 2)), random.normal(0, 0.01, 500)])
    points[:100, 2] += random.uniform(0.2, 1.0, 100)
    spoiled = ss.features(points, "NormalSigma0", k=500)["NormalSigma0"]
    robust = ss.features(points, "NormalSigma0", k=500, normals="robust")["NormalSigma0"]
    alone = ss.features(points[100:], "NormalSigma0", k=400)["NormalSigma0"]
    assert spoiled[0] > 0.2
    np.testing.assert_allclose(robust, alone[0], rtol=1e-9)


def test_names_come_back_as_given_and_sources_of_all_kinds_are_taken(tmp_path: Path) -> None:
    points = np.random.default_rng(2).uniform(size=(50, 3))
    np.save(tmp_path / "points.npy", points)
    of_array = ss.features(points, ["normalz", "NORMALX"], k=10)
    assert list(of_array) == ["normalz", "NORMALX"]
    for source in (tmp_path / "points.npy", [points[:20], points[20:]], iter([points]), points.tolist()):
        found = ss.features(source, ["normalz", "NORMALX"], k=10)
        assert all(np.array_equal(found[name], of_array[name]) for name in found)
    assert ss.features(np.empty((0, 3)), "Planarity", k=3)["Planarity"].shape == (0,)
    assert ss.features(points, [], k=3) == {}


BAD: dict[str, tuple[dict[str, Any], str]] = {
    "nothing": ({}, "search_radius and k are both None, allowed: search_radius=<length>, k="),
    "k 0": ({"k": 0}, "k is 0, allowed: a whole number of at least 1"),
    "k negative": ({"k": -1}, "k is -1, allowed: a whole number of at least 1"),
    "k in a cylinder": ({"k": 3, "search_mode": "2.5d"}, "search_mode is '2.5d', allowed: '2d' or '3d' with k"),
    "mode": ({"k": 3, "search_mode": "4d"}, "search_mode is '4d', allowed: '2d', '2.5d' or '3d'"),
    "radius negative": ({"search_radius": -1.0}, "search_radius is -1, allowed: a finite number above 0"),
    "radius NaN": ({"search_radius": float("nan")}, "search_radius is NaN, allowed: a finite number above 0"),
    "radii of a ball": (
        {"search_radius": [1, 2]},
        r"search_radius is \[1, 2\], allowed: a finite number above 0; only",
    ),
    "radius of letters": ({"search_radius": "far"}, "search_radius is 'far', allowed: a finite number above 0"),
    "four radii": (
        {"search_radius": [1, 2, 3, 4], "search_mode": "2.5d"},
        r"search_radius is \[1, 2, 3, 4\], allowed: a number, \[radius\], \[radius, height\] or \[radius, lowest, hi",
    ),
    "height negative": (
        {"search_radius": [1, -2], "search_mode": "2.5d"},
        r"search_radius is \[1, -2\], allowed: \[radius, height\] with height >= 0",
    ),
    "heights on one side": (
        {"search_radius": [1, 2, 3], "search_mode": "2.5d"},
        r"search_radius is \[1, 2, 3\], allowed: .*lowest <= 0 <= highest",
    ),
    "fit": ({"k": 3, "normals": "best"}, "normals is 'best', allowed: 'least_squares' or 'robust'"),
    "name": ({"k": 3, "names": "Normal"}, "feature is 'Normal', allowed: NormalX, NormalY, NormalZ, NormalSigma0,"),
}


@pytest.mark.parametrize("case", BAD)
def test_what_is_wrong_is_said(case: str) -> None:
    given, message = BAD[case]
    with pytest.raises(ss.InvalidParameter, match=message):
        ss.features(np.zeros((3, 3)), **{"names": "NormalX", **given})


def test_points_that_cannot_be_computed_with() -> None:
    with pytest.raises(ss.InvalidInput, match="point 1 has the coordinates"):
        ss.features(np.array([[0.0, 0, 0], [0, np.nan, 0]]), "NormalX", k=3)
    with pytest.raises(ss.InvalidInput, match=r"points has shape \(3, 2\), expected \(n, 3\)"):
        ss.features(np.zeros((3, 2)), "NormalX", k=3)
