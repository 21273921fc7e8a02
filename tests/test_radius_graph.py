"""The radius graph equals scipy's, decided on the lattice; streamed equals static."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

import streamseg as ss
from reference import density as twin
from reference.clouds import LatticeCloud
from reference.consumer import ids_of
from reference.partition import same

CLOUDS = [
    ("isprs/CSite3.laz", 2.5, 2_770),
    ("als/delft_ahn3.laz", 0.3, None),
    ("als/lidarhd_77050_627755.laz", 1.0, None),
]


def kitti(data: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """A turn of a spinning scanner, float32, rounded to millimeters; and in millimeters."""
    xyz = np.fromfile(data / "spinning" / "kitti_a.bin", np.float32).reshape(-1, 4)[:, :3].astype(float)
    steps = np.rint(xyz * 1000).astype(np.int64)
    return steps * 0.001, steps


@pytest.mark.parametrize(("name", "distance", "segments"), CLOUDS)
def test_the_radius_graph_is_scipys(
    cloud: Callable[[str], LatticeCloud], name: str, distance: float, segments: int | None
) -> None:
    path, points, scale = cloud(name)
    labels = ss.segment_static(path, ss.Proximity(distance, graph="radius"))
    print(f"{name} at {distance}: {labels.max()} segments")
    assert labels.max() == len(np.unique(labels)) == (segments or labels.max())
    assert same(labels, twin.radius(points, distance, scale))


@pytest.mark.parametrize(("distance", "metric"), [(0.2, "xyz"), (0.05, "xy")])
def test_of_an_array_too(data: Path, distance: float, metric: str) -> None:
    points, steps = kitti(data)
    labels = ss.segment_static(points, ss.Proximity(distance, graph="radius", metric=metric))
    assert same(labels, twin.radius(steps, distance, 0.001, metric))


def test_on_the_map_it_is_what_the_triangulation_gives(data: Path) -> None:
    path = data / "isprs" / "CSite3.laz"
    labels = ss.segment_static(path, ss.Proximity(0.6, graph="radius", metric="xy"))
    assert np.array_equal(labels, ss.segment_static(path, ss.Proximity(0.6, metric="xy")))


@pytest.mark.parametrize(("name", "distance", "segments"), CLOUDS)
def test_streamed_is_static(data: Path, name: str, distance: float, segments: int | None) -> None:
    segmentor = ss.Proximity(distance, graph="radius")
    static = ss.segment_static(data / name, segmentor)
    for width, direction in ((distance, "x"), (7.3, "y"), (40.0, 30.0)):
        with ss.stream(data / name, segmentor, spans=ss.SpanByWidth(width, direction), result="final") as run:
            assert "equal to the static result" in run.promise
            labels = ids_of(run)
        assert same(labels, static), f"width {width} along {direction}"
        assert segments is None or len(np.unique(labels)) == segments


@given(st.integers(0, 10**6), st.integers(0, 300), st.sampled_from(["xyz", "xy"]), st.sampled_from([1, 2, 3, 5]))
def test_any_small_cloud(seed: int, count: int, metric: str, distance: int) -> None:
    points = np.random.default_rng(seed).integers(0, 30, (count + 1, 3))
    labels = ss.segment_static(points.astype(float), ss.Proximity(distance, graph="radius", metric=metric))
    assert same(labels, twin.radius(points, distance, 1.0, metric))


def test_the_graph_is_part_of_what_a_proximity_is() -> None:
    near = ss.Proximity(1.0, graph="radius")
    assert near.graph == "radius"
    assert repr(near) == "Proximity(1.0, graph='radius', metric='xyz')"
    assert near != ss.Proximity(1.0)
    assert len({near, ss.Proximity(1.0, "radius"), ss.Proximity(1.0)}) == 2
