"""Outlier removal and voxel grids against slow twins, and as streams against the whole cloud."""

from __future__ import annotations

import doctest
import pickle
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import streamseg as ss
from reference.clouds import LatticeCloud
from reference.preprocessing import centroids, nearest_to, radius_inliers, statistical_inliers, voxels
from streamseg._core import _halo_of
from streamseg.source import open_source

KITTI = "spinning/kitti_a.bin"
LAZ = ["als/lidarhd_77050_627755.laz", "isprs/CSite3.laz"]
DIALECTS = ["pcl", "pdal", "open3d"]
WHOLE = ss.SpanByWidth(1e7)

Read = Callable[[str], LatticeCloud]


def kitti(data: Path) -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.fromfile(data / KITTI, np.float32).reshape(-1, 4)[:, :3].astype(np.float64)


def small(count: int = 3000) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Clusters, duplicates and points far away, in centimeters."""
    random = np.random.default_rng(7)
    cluster = random.normal(random.integers(0, 60, (count, 1)), 1.0, (count, 3))
    points = np.concatenate([cluster, cluster[: count // 20], random.uniform(-300, 300, (count // 100, 3))])
    return np.round(points, 2)


def thinned(source: Any, stages: Any, **how: Any) -> tuple[Any, Any]:
    parts = list(ss.preprocess(source, stages, **how))
    ids = np.concatenate([part.point_ids for part in parts])
    order = np.argsort(ids)
    assert len(np.unique(ids)) == len(ids), "each comes out once"
    return ids[order], np.concatenate([part.points for part in parts])[order]


def assert_same(one: Iterable[Any], other: Iterable[Any]) -> None:
    for a, b in zip(one, other, strict=True):
        assert np.array_equal(a, b)


@pytest.mark.parametrize("dialect", DIALECTS)
def test_statistical_outliers_are_those_of_the_twin(dialect: Any, data: Path) -> None:
    for points in (small(), kitti(data)[::3]):
        stays, mean, deviation = statistical_inliers(points, 8, 1.0, dialect)
        stage = ss.prepare(ss.StatisticalOutlierRemoval(8, 1.0, dialect), points)[0]
        count, measured_mean, measured_deviation = stage.statistics[:3]
        assert count == len(points)
        assert measured_mean == pytest.approx(mean, rel=1e-12)
        assert measured_deviation == pytest.approx(deviation, rel=1e-9)
        ids, kept = thinned(points, stage)
        assert np.array_equal(ids, np.flatnonzero(stays))
        assert np.array_equal(kept, points[ids])


@pytest.mark.parametrize("dialect", DIALECTS)
def test_a_stray_point_far_away_does_not_widen_the_windows(dialect: Any) -> None:
    street = np.random.default_rng(0).uniform(0, (400, 20, 1), (12_000, 3))
    points = np.concatenate([street, [[1e6, 0, 0]]])
    stays, _, _ = statistical_inliers(points, 8, 1.0, dialect)
    stage = ss.prepare(ss.StatisticalOutlierRemoval(8, 1.0, dialect), points)[0]
    assert stage.threshold > 1000
    assert _halo_of([stage]) < 10
    ids, _ = thinned(points, stage, spans=ss.SpanByWidth(10.0))
    assert np.array_equal(ids, np.flatnonzero(stays))
    three = ss.StatisticalOutlierRemoval(8, 1.0, dialect, stage.statistics[:3])
    assert _halo_of([three]) > 8000


def test_more_neighbors_than_points_are_those_there_are() -> None:
    points = small(100)
    stays, mean, _ = statistical_inliers(points, 100_000, 1.0, "pcl")
    stage = ss.prepare(ss.StatisticalOutlierRemoval(100_000, 1.0), points)[0]
    assert stage.statistics[1] == pytest.approx(mean, rel=1e-12)
    assert np.array_equal(thinned(points, stage)[0], np.flatnonzero(stays))


def test_radius_outliers_are_those_of_the_twin(data: Path) -> None:
    for points in (small(), kitti(data)):
        ids, _ = thinned(points, ss.RadiusOutlierRemoval(0.503, 4))
        assert np.array_equal(ids, np.flatnonzero(radius_inliers(points, 0.503, 4)))


@pytest.mark.parametrize("name", LAZ)
def test_voxels_are_those_of_the_twin_bit_for_bit(name: str, cloud: Read) -> None:
    path, points, scale = cloud(name)
    offset = np.array(open_source(path, None).offset)
    voxel = voxels(points + np.round(offset / scale).astype(np.int64), round(1.5 / scale))
    centers, of = centroids(points, voxel)
    first = np.full(len(centers), len(points))
    np.minimum.at(first, of, np.arange(len(points)))
    order = np.argsort(first)
    ids, kept = thinned(path, ss.VoxelGrid(1.5))
    assert np.array_equal(ids, first[order])
    assert np.array_equal(kept, centers[order] * scale + offset)
    nearest = np.sort(nearest_to(points, centers, of, scale))
    assert np.array_equal(thinned(path, ss.VoxelGrid(1.5, "nearest"))[0], nearest)


def test_voxels_of_real_coordinates_are_those_of_the_twin(data: Path) -> None:
    points = kitti(data)
    centers, of = centroids(points, np.floor(points / 0.3).astype(np.int64))
    first = np.full(len(centers), len(points))
    np.minimum.at(first, of, np.arange(len(points)))
    order = np.argsort(first)
    ids, kept = thinned(points, ss.VoxelGrid(0.3))
    assert np.array_equal(ids, first[order])
    assert np.array_equal(kept, centers[order])


STAGES = [
    [ss.StatisticalOutlierRemoval(8, 1.0, "open3d")],
    [ss.RadiusOutlierRemoval(1.0, 3)],
    [ss.VoxelGrid(0.7), ss.StatisticalOutlierRemoval(6, 1.5), ss.VoxelGrid(2.0, "nearest")],
]


@pytest.mark.parametrize("stages", STAGES, ids=["statistical", "radius", "all"])
@pytest.mark.parametrize(
    ("name", "widths"),
    [(LAZ[0], (7, 20, 40)), ("als/topography.laz", (60, 130, 250)), (KITTI, (9, 23.3, 60))],
    ids=["hd", "topography", "kitti"],
)
def test_streamed_is_static(name: str, widths: tuple[float, ...], stages: list[Any], data: Path) -> None:
    source = kitti(data) if name == KITTI else data / name
    ready = ss.prepare(stages, source)
    static = thinned(source, ready, spans=WHOLE)
    for width, direction in zip(widths, ("x", "y", 30.0), strict=True):
        assert_same(thinned(source, ready, spans=ss.SpanByWidth(width, direction), threads=2), static)


def test_a_cloud_is_measured_the_same_in_any_order() -> None:
    points = small(400)
    stages = [ss.VoxelGrid(0.5, "nearest"), ss.StatisticalOutlierRemoval(5)]
    measured = ss.prepare(ss.StatisticalOutlierRemoval(5), points)[0]
    shuffled = points[np.random.default_rng(3).permutation(len(points))]
    assert ss.prepare(ss.StatisticalOutlierRemoval(5), shuffled)[0] == measured
    assert measured.threshold is not None
    assert ss.prepare(stages, points)[1].statistics[0] < len(points)
    assert ss.prepare([measured], points) == [measured]


def test_live_sources_take_running_statistics() -> None:
    live = (small(200) + np.array([i * 1000, 0, 0]) for i in range(4))
    with pytest.raises(ss.InvalidParameter, match="which a live source cannot give; use statistics='running'"):
        ss.preprocess(live, ss.StatisticalOutlierRemoval())
    spans = list(ss.preprocess(live, ss.StatisticalOutlierRemoval(statistics="running")))
    assert [span.index for span in spans] == [0, 1, 2, 3]
    assert all(0 < len(span) < span.count for span in spans)


def test_damaged_and_invalid_points() -> None:
    points = small(200)
    points[17] = np.nan
    with pytest.raises(ss.InvalidInput, match="point 17"):
        list(ss.preprocess(points, ss.VoxelGrid(1.0)))
    ids, _ = thinned(points, ss.StatisticalOutlierRemoval(), drop_invalid=True)
    assert 17 not in ids


def test_empty_and_tiny_clouds() -> None:
    for points in (np.zeros((0, 3)), np.zeros((1, 3)), np.ones((20, 3))):
        parts = list(
            ss.preprocess(points, [ss.StatisticalOutlierRemoval(), ss.RadiusOutlierRemoval(1.0), ss.VoxelGrid(1.0)])
        )
        assert sum(map(len, parts)) == (len(points) > 1)


@pytest.mark.parametrize(
    "stage",
    [
        ss.StatisticalOutlierRemoval(9, 1.5, "pdal", (5, 1.0, 0.5)),
        ss.StatisticalOutlierRemoval(9, 1.5, "pdal", (5, 1.0, 0.5, (1.75, 6.0))),
        ss.RadiusOutlierRemoval(2.0, 7),
        ss.VoxelGrid(2.0, "nearest"),
    ],
)
def test_stages_are_values(stage: Any) -> None:
    assert pickle.loads(pickle.dumps(stage)) == stage
    assert eval(repr(stage), vars(ss)) == stage
    with pytest.raises(AttributeError):
        stage.size = stage.radius = stage.k = 3


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ss.StatisticalOutlierRemoval(0), "k is 0, allowed"),
        (lambda: ss.StatisticalOutlierRemoval(-1), "k is -1, allowed"),
        (lambda: ss.StatisticalOutlierRemoval(10**12), "k is 1000000000000, allowed: at most 100000"),
        (lambda: ss.StatisticalOutlierRemoval(statistics=(5, 1.0, 0.5, (1.0, -1.0))), "statistics is (5, 1.0, 0.5, (1"),
        (lambda: ss.StatisticalOutlierRemoval(dialect="cgal"), "dialect is 'cgal', allowed: 'pcl', 'pdal' or 'open3d'"),
        (lambda: ss.StatisticalOutlierRemoval(statistics="windowed"), "statistics is 'windowed', allowed: 'global'"),
        (lambda: ss.StatisticalOutlierRemoval(multiplier=-1.0), "multiplier is -1, allowed"),
        (lambda: ss.RadiusOutlierRemoval(0.0), "radius is 0, allowed"),
        (lambda: ss.VoxelGrid(1.0, "mean"), "representative is 'mean', allowed: 'centroid' or 'nearest'"),
        (lambda: ss.preprocess(small(20), ss.Proximity(1.0)), "preprocess is Proximity"),
        (lambda: ss.preprocess(small(20), [ss.Proximity(1.0)]), "preprocess has Proximity"),
    ],
)
def test_what_is_wrong_is_said(make: Callable[[], Any], message: str) -> None:
    with pytest.raises(ss.InvalidParameter) as error:
        make()
    assert message in str(error.value)


@pytest.mark.parametrize("name", ["StatisticalOutlierRemoval", "RadiusOutlierRemoval", "VoxelGrid"])
def test_examples_of_the_stages(name: str) -> None:
    tests = doctest.DocTestFinder(recurse=False).find(getattr(ss, name), name, module=False, globs=dict(vars(ss)))
    assert sum(len(test.examples) for test in tests) > 0
    assert sum(doctest.DocTestRunner().run(test).failed for test in tests) == 0
