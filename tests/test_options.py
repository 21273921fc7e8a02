"""Options that every segmentor has: filters, seeds, sizes, order, attributes, preprocessing."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest
from matplotlib.path import Path as Polygon
from numpy.typing import NDArray
from scipy.spatial import cKDTree

import streamseg as ss
from reference.conditional import clusters, components, near
from reference.partition import agreement, same
from reference.roster import SAME_NORMAL, Positions, houses
from reference.sizes import Limits

Ids = NDArray[np.int64]

PLAIN: dict[str, Callable[..., Any]] = {
    "proximity": lambda **options: ss.Proximity(0.8, **options),
    "radius": lambda **options: ss.Proximity(0.6, graph="radius", **options),
    "dbscan": lambda **options: ss.Dbscan(0.75, 6, **options),
    "conditional": lambda **options: ss.ConditionalClustering(
        "abs(Z-n[0].Z)<0.2", search_radius=0.7, **{"min_segment_size": 1, **options}
    ),
}
WITH_FEATURES: dict[str, Callable[..., Any]] = {
    "normals": lambda **options: ss.ConditionalClustering(
        SAME_NORMAL, search_radius=1.0, **{"min_segment_size": 1, **options}
    ),
    "growing": lambda **options: ss.RegionGrowing(16, search_radius=1.5, angle_deg=20.0, **options),
    "planes": lambda **options: ss.PlaneExtraction(
        1.0, max_distance=0.2, seed_calculator="NormalSigma0", **{"min_segment_size": 1, **options}
    ),
    "growing, literal": lambda **options: ss.RegionGrowing(16, search_radius=0.75, literal=True, **options),
}
ALL = {**PLAIN, **WITH_FEATURES}
COMPONENTS = [name for name in ALL if name not in ("planes", "growing, literal")]

SPANS = ss.SpanByWidth(4.0)


def both(points: Any, segmentor: Any, **more: Any) -> Iterator[Ids]:
    """The static labels and the streamed ones."""
    yield ss.segment_static(points, segmentor, **more)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ss.StreamsegWarning)
        yield ss.segment(points, segmentor, spans=SPANS, **more)


def spread(labels: Ids, kept: NDArray[np.bool_]) -> Ids:
    """Labels of the kept rows, among all."""
    everything = np.full(len(kept), -1, np.int64)
    everything[kept] = labels
    return everything


# Filters.


@pytest.mark.parametrize("name", PLAIN)
def test_a_filter_is_the_cloud_without_the_others(name: str) -> None:
    points = houses(21)
    kept = (points[:, 2] > 0.5) & (points[:, 0] + points[:, 1] < 25)
    expected = spread(ss.segment_static(points[kept], PLAIN[name]()), kept)
    for labels in both(points, PLAIN[name](filter="Z > 0.5 and X + Y < 25")):
        assert np.array_equal(labels == -1, expected == -1)
        # At borders of windows the triangulation joins only what it can prove, and ties may be broken otherwise.
        assert same(labels, expected) or (name == "proximity" and agreement(labels, expected) > 0.8)
    assert same(ss.segment_static(points, PLAIN[name](filter="Z > 0.5 and X + Y < 25")), expected)


@pytest.mark.parametrize("name", WITH_FEATURES)
def test_features_behind_a_filter_are_those_of_the_whole_cloud(name: str) -> None:
    points = houses(22)
    kept = points[:, 2] > 0.7
    attributes = dict(zip(FEATURES, features_for(name, points), strict=True))
    given = {feature: values[kept] for feature, values in attributes.items()}
    expected = spread(ss.segment_static(points[kept], WITH_FEATURES[name](), attributes=given), kept)
    assert same(ss.segment_static(points, WITH_FEATURES[name](filter="Z > 0.7")), expected)


FEATURES = ("NormalX", "NormalY", "NormalZ", "NormalSigma0", "SurfaceVariation")


def features_for(name: str, points: Positions) -> list[NDArray[np.float64]]:
    segmentor = WITH_FEATURES[name]()
    found = ss.features(points, FEATURES, k=getattr(segmentor, "k", None), search_radius=segmentor.search_radius)
    return [found[feature] for feature in FEATURES]


@pytest.mark.parametrize("name", ALL)
def test_a_filter_that_nothing_passes(name: str) -> None:
    for labels in both(houses(23), ALL[name](filter="Z > 1000")):
        assert np.all(labels == -1)


@pytest.mark.parametrize("name", ALL)
def test_a_filter_that_all_pass(name: str) -> None:
    points = houses(24)
    assert np.array_equal(ss.segment_static(points, ALL[name](filter="true")), ss.segment_static(points, ALL[name]()))


POLYGON = [(2.03, 1.01), (20.02, 0.51), (22.03, 9.03), (12.01, 3.02), (5.04, 9.51)]


def test_a_region_is_the_inside_of_its_polygon() -> None:
    points = houses(25)
    text = f"Region[{' '.join(f'{x} {y}' for x, y in POLYGON)}]"
    inside = Polygon(POLYGON).contains_points(points[:, :2])
    assert 0.2 < inside.mean() < 0.8
    every = ss.ConditionalClustering(search_radius=0.01, min_segment_size=1, filter=text)
    for labels in both(points, every):
        np.testing.assert_array_equal(labels > 0, inside)
    turned = ss.ConditionalClustering(search_radius=0.01, min_segment_size=1, filter=f"not {text}")
    np.testing.assert_array_equal(ss.segment_static(points, turned) > 0, ~inside)


@pytest.mark.parametrize("text", ["Class[2 Building]", "classification == 2 or CLASSIFICATION == 6", "class[2, 6]"])
def test_a_class_filter(text: str) -> None:
    points = houses(26)
    classes = np.random.default_rng(1).choice([1, 2, 6, 9], len(points))
    kept = np.isin(classes, [2, 6])
    expected = spread(ss.segment_static(points[kept], ss.Dbscan(0.75, 6)), kept)
    for labels in both(points, ss.Dbscan(0.75, 6, filter=text), attributes={"classification": classes}):
        assert same(labels, expected)


@pytest.mark.parametrize("name", COMPONENTS)
def test_a_seed_filter_keeps_segments_that_hold_a_seed(name: str) -> None:
    points = houses(27)
    seeds = (points[:, 2] > 4.5) | (points[:, 0] < 0.5)
    for labels, plain in zip(
        both(points, ALL[name](seed_filter="Z > 4.5 or X < 0.5")), both(points, ALL[name]()), strict=True
    ):
        kept = np.isin(plain, np.setdiff1d(plain[seeds], [-1]))
        assert 0 < np.count_nonzero(kept) < len(kept)
        np.testing.assert_array_equal(labels, np.where(kept, plain, -1))


@pytest.mark.parametrize("name", ["planes", "growing, literal"])
def test_every_grown_segment_holds_a_seed(name: str) -> None:
    points = houses(28)
    seeds = points[:, 2] > 4.5
    labels = ss.segment_static(points, ALL[name](seed_filter="Z > 4.5"))
    assert labels.max() > 0
    assert set(np.unique(labels)) - {-1} == set(np.unique(labels[seeds])) - {-1}
    assert np.all(ss.segment_static(points, ALL[name](seed_filter="false")) == -1)


# Sizes.


@pytest.mark.parametrize("name", ALL)
@pytest.mark.parametrize(
    "limits", [Limits(5, 200), Limits(2, None, "descending"), Limits(1, 60, "ascending"), Limits(3, 3)], ids=str
)
def test_sizes_and_order(name: str, limits: Limits) -> None:
    points = houses(29)
    for labels, plain in zip(
        both(points, ALL[name](**limits._asdict())), both(points, ALL[name](min_segment_size=1)), strict=True
    ):
        np.testing.assert_array_equal(labels, limits.select(plain))


def test_small_segments_can_be_had_from_the_history(tmp_path: Path) -> None:
    points = houses(30)
    segmentor = ss.Proximity(0.6, graph="radius", min_segment_size=20)
    with ss.stream(points, segmentor, spans=SPANS, history=tmp_path / "past", result="final") as run:
        kept = np.concatenate([span.segment_ids for span in run])
        left_out = run.left_out
    assert left_out.points == np.count_nonzero(kept == -1) > 0
    everything = ss.segment_static(points, ss.Proximity(0.6, graph="radius"))
    assert left_out.segments == np.count_nonzero(np.bincount(everything)[1:] < 20)


# Attributes.


def test_attributes_are_used_instead_of_being_computed() -> None:
    points = houses(31)
    random = np.random.default_rng(2)
    normals = random.choice([[0, 0, 1], [1, 0, 0], [0, 0.6, 0.8]], len(points)).astype(float)
    pairs = near(points, 1.0)
    named = {"NORMAL_X": normals[:, 0], "normaly": normals[:, 1], "Normal_z": normals[:, 2]}
    expected = clusters(
        len(points),
        pairs,
        {"x": normals[:, 0], "y": normals[:, 1], "z": normals[:, 2]},
        lambda p, n: p["x"] * n["x"] + p["y"] * n["y"] + p["z"] * n["z"] > 0.99,
    )
    for labels in both(points, WITH_FEATURES["normals"](), attributes=named):
        assert same(labels, expected)
    computed = ss.segment_static(points, WITH_FEATURES["normals"]())
    assert not same(computed, expected)
    found = ss.features(points, ["NormalX", "NormalY", "NormalZ"], search_radius=1.0)
    assert same(ss.segment_static(points, WITH_FEATURES["normals"](), attributes=found), computed)


@pytest.mark.parametrize("spelling", ["Intensity", "intensity", "INTENSITY", "inten_sity", "n_intensity_"])
def test_names_whatever_their_case_and_underscores(spelling: str) -> None:
    points = houses(32, 300)
    values = np.random.default_rng(3).integers(0, 4, len(points))
    segmentor = ss.ConditionalClustering("Intensity == n[0].Intensity", search_radius=1.0, min_segment_size=1)
    if spelling.startswith("n_"):
        with pytest.raises(
            ss.InvalidParameter, match=r"column 1: there is no attribute 'Intensity'.*there are: .*n_inten"
        ):
            ss.segment_static(points, segmentor, attributes={spelling: values})
        return
    expected = clusters(len(points), near(points, 1.0), {"i": values}, lambda p, n: p["i"] == n["i"])
    assert same(ss.segment_static(points, segmentor, attributes={spelling: values}), expected)


def test_a_missing_attribute_is_told_with_its_column_and_what_there_is() -> None:
    points = houses(33, 100)
    zeros = np.zeros(len(points))
    segmentor = ss.ConditionalClustering("abs(Z - n[0].Intensty) < 0.15", search_radius=1.0)
    for run in (ss.segment, ss.segment_static):
        with pytest.raises(ss.StreamsegError) as told:
            run(points, segmentor, attributes={"Intensity": zeros, "range": zeros})
        text = str(told.value)
        assert text.startswith("criterion, column 14: there is no attribute 'Intensty', did you mean 'Intensity'?")
        for name in ("X", "Y", "Z", "Intensity", "range"):
            assert name in text.split("there are: ")[1]
    for option in ("filter", "seed_filter"):
        with pytest.raises(ss.StreamsegError, match="filter, column 1: there is no attribute 'Depth'"):
            ss.segment_static(points, ss.Proximity(1.0, **{option: "Depth > 3"}))


def test_features_need_a_neighborhood() -> None:
    with pytest.raises(ss.StreamsegError, match=r"NormalZ is no attribute of the cloud, and .* has no neighborhood"):
        ss.segment_static(houses(34, 50), ss.Proximity(1.0, filter="NormalZ > 0.5"))


@pytest.mark.parametrize(
    "values",
    [np.zeros(99), np.zeros((100, 1)), np.array(["a"] * 100), np.zeros(100, complex)],
    ids=lambda v: str(v.dtype),
)
def test_attributes_that_are_no_columns_are_refused(values: NDArray[Any]) -> None:
    with pytest.raises(ss.InvalidInput, match="Depth"):
        ss.segment_static(np.zeros((100, 3)), ss.Proximity(1.0, filter="Depth > 3"), attributes={"Depth": values})


@pytest.mark.parametrize("is_live", [False, True])
def test_of_attributes_with_like_names_the_exact_spelling_counts(is_live: bool) -> None:
    points = np.column_stack([np.arange(6.0), np.zeros((6, 2))])
    given = {"Intensity": np.array([1, 1, 1, 2, 2, 2]), "intensity": np.array([1, 1, 2, 2, 2, 2])}
    source, attributes = ([(points, given)], tuple(given)) if is_live else (points, given)
    for name, values in given.items():
        ids = ss.segment(source, ss.Proximity(1.5, filter=f"{name} == 1"), attributes=attributes)
        assert np.array_equal(ids > 0, values == 1)
    with pytest.raises(ss.StreamsegError, match="'INTENSITY' can be 'Intensity' or 'intensity'"):
        ss.segment(source, ss.Proximity(1.5, filter="INTENSITY == 1"), attributes=attributes)
    assert ss.segment(source, ss.Proximity(1.5), attributes=attributes).tolist() == [1] * 6


def test_a_live_source_takes_no_arrays_beside_it() -> None:
    with pytest.raises(ss.InvalidInput, match=r"attributes is a mapping, expected names, .*'Depth'"):
        ss.segment(iter([np.zeros((9, 3))]), ss.Proximity(1.0), attributes={"Depth": np.zeros(9)})


def test_what_is_not_a_number_is_invalid() -> None:
    points = houses(36)
    random = np.random.default_rng(4)
    values = random.integers(0, 3, len(points)).astype(float)
    values[random.random(len(points)) < 0.2] = np.nan
    given = {"Depth": values}
    pairs = near(points, 0.7)
    every = ss.ConditionalClustering("Depth == n[0].Depth", search_radius=0.7, min_segment_size=1)
    expected = clusters(len(points), pairs, given, lambda p, n: p["Depth"] == n["Depth"])
    for labels in both(points, every, attributes=given):
        assert same(labels, expected)
        # Alone, but points all the same.
        assert len(np.unique(labels[np.isnan(values)])) == np.count_nonzero(np.isnan(values))
    kept = ~np.isnan(values)
    for text in ("Depth", "valid(Depth)", "not invalid(Depth)", "Depth >= 0"):
        labels = ss.segment_static(points, ss.Dbscan(0.75, 6, filter=text), attributes=given)
        assert same(labels, spread(ss.segment_static(points[kept], ss.Dbscan(0.75, 6)), kept))


@pytest.mark.parametrize("kind", ["f4", "i2", "u1", "i8", "bool", "f8, swapped", "strided"])
def test_columns_of_any_number_type(kind: str) -> None:
    points = houses(37, 400)
    values = np.random.default_rng(5).integers(0, 2, len(points))
    if kind == "strided":
        column: Any = np.repeat(values, 2)[::2]
    else:
        column = values.astype(kind if "," not in kind else ">f8")
    labels = ss.segment_static(points, ss.Dbscan(1.0, 4, filter="flag == 1"), attributes={"flag": column})
    assert np.array_equal(labels == -1, (values == 0) | (labels == -1))
    assert labels.max() > 0


def test_a_live_source_brings_attributes_along() -> None:
    points = houses(38)
    points = points[np.argsort(points[:, 0], kind="stable")]
    values = np.random.default_rng(6).integers(0, 5, len(points))
    segmentor = ss.ConditionalClustering("Intensity == n[0].Intensity", search_radius=0.9, min_segment_size=1)
    expected = clusters(len(points), near(points, 0.9), {"i": values}, lambda p, n: p["i"] == n["i"])

    def items() -> Iterator[tuple[Positions, dict[str, Any]]]:
        for start in range(0, len(points), 250):
            part = slice(start, start + 250)
            yield points[part], {"intensity": values[part]}

    assert same(ss.segment(items(), segmentor, spans=SPANS), expected)
    assert same(ss.segment_static(items(), segmentor), expected)
    with pytest.raises(ss.StreamsegError, match="Depth"):
        ss.segment(items(), ss.Proximity(1.0, filter="Depth > 1"), spans=SPANS)


def test_a_live_source_brings_normals_along_if_it_says_so() -> None:
    points = houses(39)
    normals = np.random.default_rng(7).choice([[0, 0, 1], [1, 0, 0]], len(points)).astype(float)
    names = ("NormalX", "NormalY", "NormalZ")
    named = dict(zip(names, normals.T, strict=True))
    expected = ss.segment_static(points, WITH_FEATURES["normals"](), attributes=named)
    item = [(points, named)]
    assert same(ss.segment_static(item, WITH_FEATURES["normals"](), attributes=names), expected)
    assert same(
        ss.segment_static(item, WITH_FEATURES["normals"]()), ss.segment_static(points, WITH_FEATURES["normals"]())
    )


# Files.


@pytest.fixture
def measured(data: Path, tmp_path: Path) -> Path:
    """A piece of a measured file, with dimensions of its own."""
    las = laspy.read(data / "als" / "lidarhd_77050_627755.laz")
    near_corner = (las.x < las.x.min() + 20) & (las.y < las.y.min() + 20)
    las.points = las.points[near_corner]
    random = np.random.default_rng(8)
    for name, kind in [("Pulse width", "f8"), ("echo_ratio", "f4"), ("side", "u1")]:
        las.add_extra_dim(laspy.ExtraBytesParams(name, kind))
        las[name] = random.integers(0, 3, len(las.x))
    las.write(tmp_path / "piece.laz")
    return tmp_path / "piece.laz"


CRITERIA: dict[str, Callable[[Any, Any], Any]] = {
    "[Pulse width] == n[0].[pulse WIDTH]": lambda p, n: p["Pulse width"] == n["Pulse width"],
    "abs(EchoRatio - n[0].echo_ratio) <= 1 and side == n[0].Side": lambda p, n: (
        (abs(p["echo_ratio"] - n["echo_ratio"]) <= 1) & (p["side"] == n["side"])
    ),
    "return_number == n[0].ReturnNumber and abs(Intensity - n[0].Intensity) < 200": lambda p, n: (
        (p["return_number"] == n["return_number"]) & (abs(p["intensity"] - n["intensity"]) < 200)
    ),
    "abs(GpsTime - n[0].gps_time) < 0.5": lambda p, n: abs(p["gps_time"] - n["gps_time"]) < 0.5,
    "Classification == n[0].Classification and abs(Z - n[0].Z) < 0.1": lambda p, n: (
        (p["classification"] == n["classification"]) & (abs(p["z"] - n["z"]) < 0.1)
    ),
}


@pytest.mark.parametrize("criterion", CRITERIA)
def test_every_dimension_of_a_file_is_an_attribute(measured: Path, criterion: str) -> None:
    las = laspy.read(measured)
    steps = np.column_stack([las.X, las.Y, las.Z]).astype(np.int64)
    names = ["z", "Pulse width", "echo_ratio", "side", "return_number", "intensity", "gps_time", "classification"]
    columns = {name: np.asarray(las[name], float) for name in names}
    expected = clusters(len(steps), near(steps, 50), columns, CRITERIA[criterion])
    assert 1 < expected.max() < len(steps)
    for labels in both(measured, ss.ConditionalClustering(criterion, search_radius=0.5, min_segment_size=1)):
        assert same(labels, expected)


# With preprocessing.


@pytest.mark.parametrize("name", PLAIN)
def test_options_after_outliers_are_removed(name: str) -> None:
    points = houses(40, step=None)
    counts = np.array([len(found) for found in cKDTree(points).query_ball_point(points, 0.8)]) - 1
    kept = (counts >= 6) & (points[:, 2] < 4.2)
    segmentor = PLAIN[name](filter="Z < 4.2", min_segment_size=4, sort="descending")
    expected = spread(ss.segment_static(points[kept], PLAIN[name](min_segment_size=4, sort="descending")), kept)
    for labels in both(points, segmentor, preprocess=ss.RadiusOutlierRemoval(0.8, 6)):
        if name == "proximity":
            assert np.count_nonzero(labels != expected) < 0.05 * len(points)
        else:
            assert np.array_equal(np.bincount(labels[labels > 0]), np.bincount(expected[expected > 0]))
            assert same(labels, expected)
    assert 0 < np.count_nonzero(expected == -1) < len(points)


def test_a_filter_after_voxels_looks_at_their_centers() -> None:
    points = houses(41, step=None)
    keys, voxel = np.unique(np.floor(points / 0.5).astype(int), axis=0, return_inverse=True)
    count = np.bincount(voxel)
    centers = np.column_stack([np.bincount(voxel, axis) / count for axis in points.T])
    kept = centers[:, 2] > 0.6
    pairs = near(centers, 0.9)
    pairs = pairs[kept[pairs].all(axis=1)]
    expected = np.where(kept, components(len(keys), pairs), -1)[voxel]
    segmentor = ss.Proximity(0.9, graph="radius", filter="Z > 0.6")
    for labels in both(points, segmentor, preprocess=[ss.VoxelGrid(0.5)]):
        assert same(labels, expected)


def test_a_file_with_all_options_at_once(measured: Path, tmp_path: Path) -> None:
    segmentor = ss.Dbscan(
        0.8, 5, filter="Class[2 3 4 5 6]", seed_filter="ReturnNumber == 1", min_segment_size=10, sort="descending"
    )
    stages = [ss.StatisticalOutlierRemoval(8, 3.0), ss.VoxelGrid(0.25)]
    static, streamed = both(measured, segmentor, preprocess=stages)
    assert same(static, streamed)
    ss.segment_file(measured, tmp_path / "out.laz", segmentor, preprocess=stages, spans=SPANS)
    np.testing.assert_array_equal(laspy.read(tmp_path / "out.laz")["SegmentID"], streamed)
    sizes = np.bincount(static[static > 0])[1:]
    assert sizes.min() >= 10
    assert np.all(np.diff(sizes) <= 0)
