"""DBSCAN: core partition and noise are scikit-learn's, border points follow our rule; streamed equals static."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from sklearn.cluster import DBSCAN

import streamseg as ss
from reference import density as twin
from reference.clouds import LatticeCloud
from reference.partition import same
from reference.segmentor import Steps, squared_limit

CLOUDS = [
    ("isprs/CSite3.laz", 1.0, 6),
    ("als/delft_ahn3.laz", 0.3, 8),
    ("als/lidarhd_77050_627755.laz", 0.8, 10),
]
# More would take scikit-learn too long.
MOST = 60_000


def check(labels: NDArray[np.int64], points: Steps, eps: float, min_points: int, scale: float, metric: str) -> None:
    """Compare static labels with scikit-learn's and with the twin's."""
    steps = (points - points.min(axis=0))[:, : 3 if metric == "xyz" else 2]
    # Whole squares: nothing lies between the limit and this radius.
    radius = (squared_limit(eps, scale) + 0.5) ** 0.5
    sklearn = DBSCAN(eps=radius, min_samples=min_points).fit(steps.astype(float))
    core = sklearn.core_sample_indices_
    assert same(labels[core], sklearn.labels_[core])
    assert np.array_equal(labels == -1, sklearn.labels_ == -1)
    expected = twin.dbscan(points, eps, min_points, scale, metric)
    assert np.array_equal(np.flatnonzero(expected.is_core), core)
    assert same(labels, expected.labels)


@pytest.mark.parametrize("metric", ["xyz", "xy"])
@pytest.mark.parametrize(("name", "eps", "min_points"), CLOUDS)
def test_the_core_partition_is_scikit_learns(
    cloud: Callable[[str], LatticeCloud], name: str, eps: float, min_points: int, metric: str
) -> None:
    _, points, scale = cloud(name)
    # A part of the map, so that it stays as dense as it is.
    points = points[np.argsort(points[:, 0], kind="stable")[:MOST]]
    labels = ss.segment_static(points * scale, ss.Dbscan(eps, min_points, metric))
    check(labels, points, eps, min_points, scale, metric)


def test_also_of_a_turn_of_a_spinning_scanner(data: Path) -> None:
    xyz = np.fromfile(data / "spinning" / "kitti_a.bin", np.float32).reshape(-1, 4)[:, :3].astype(float)
    steps = np.rint(xyz * 1000).astype(np.int64)
    # Every second point, which scikit-learn takes a second for.
    steps = steps[::2]
    check(ss.segment_static(steps * 0.001, ss.Dbscan(0.2, 10)), steps, 0.2, 10, 0.001, "xyz")


@pytest.mark.parametrize(("name", "eps", "min_points"), [*CLOUDS[::2], ("mls/amsterdam_street.laz", 0.1, 8)])
def test_streamed_is_static(data: Path, name: str, eps: float, min_points: int) -> None:
    segmentor = ss.Dbscan(eps, min_points)
    static = ss.segment_static(data / name, segmentor)
    assert -1 in static
    for width, direction in ((4 * eps, "x"), (9.7, "y"), (40.0, 30.0)):
        labels = ss.segment(data / name, segmentor, spans=ss.SpanByWidth(width, direction))
        assert same(labels, static), f"width {width} along {direction}"


@given(
    st.integers(0, 10**6),
    st.integers(1, 300),
    st.sampled_from([1.0, 2.0, 3.0]),
    st.integers(1, 12),
    st.sampled_from(["xyz", "xy"]),
)
def test_any_small_cloud(seed: int, count: int, eps: float, min_points: int, metric: str) -> None:
    points = np.random.default_rng(seed).integers(0, 12, (count, 3))
    labels = ss.segment_static(points.astype(float), ss.Dbscan(eps, min_points, metric))
    check(labels, points, eps, min_points, 1.0, metric)


def test_a_border_point_follows_its_nearest_core_point_and_then_the_smaller_id() -> None:
    left, right, between = [0.0, 0, 0, 1, 1, 2], [10.0, 11, 11, 12, 12, 12], [5.5, 6.5, 6, 30]
    dbscan = ss.Dbscan(4.0, min_points=6)
    for x, nearest in (([*left, *right, *between], [1, 2, 1, -1]), ([*right, *left, *between], [2, 1, 1, -1])):
        points = np.column_stack([x, np.zeros((len(x), 2))])
        assert ss.segment_static(points, dbscan).tolist() == [1] * 6 + [2] * 6 + nearest


def test_no_point_and_one_point() -> None:
    assert ss.segment_static(np.empty((0, 3)), ss.Dbscan(1.0)).tolist() == []
    assert ss.segment_static(np.zeros((1, 3)), ss.Dbscan(1.0)).tolist() == [-1]
    assert ss.segment_static(np.zeros((1, 3)), ss.Dbscan(1.0, min_points=1)).tolist() == [1]
    assert ss.segment_static(np.zeros((1000, 3)), ss.Dbscan(1e-6, min_points=1000)).tolist() == [1] * 1000


def test_it_is_a_value() -> None:
    dbscan = ss.Dbscan(0.5, 7, "xy")
    assert (dbscan.eps, dbscan.min_points, dbscan.metric) == (0.5, 7, "xy")
    assert repr(dbscan) == "Dbscan(0.5, min_points=7, metric='xy')"
    assert pickle.loads(pickle.dumps(dbscan)) == dbscan == copy.copy(dbscan)
    assert len({dbscan, ss.Dbscan(0.5, 7, "xy"), ss.Dbscan(0.5)}) == 2
    assert ss.Dbscan(0.5).min_points == 5


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: ss.Dbscan(0), "eps is 0, allowed: a finite number above 0"),
        (lambda: ss.Dbscan(float("nan")), "eps is NaN, allowed: a finite number above 0"),
        (lambda: ss.Dbscan(1.0, 0), "min_points is 0, allowed: a whole number of at least 1"),
        (lambda: ss.Dbscan(1.0, -4), "min_points is -4, allowed: a whole number of at least 1"),
        (lambda: ss.Dbscan(1.0, metric="z"), "metric is 'z', allowed: 'xyz' or 'xy'"),
    ],
)
def test_what_is_not_allowed_is_told(make: Callable[[], object], sentence: str) -> None:
    with pytest.raises(ss.InvalidParameter, match=sentence):
        make()
