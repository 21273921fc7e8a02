"""The same partition whichever way the spans run, for everything that promises to be the static result."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import streamseg as ss
from reference.consumer import ids_of
from reference.partition import same
from reference.roster import OURS, Promise, houses

EXACT = {name: promise for name, promise in OURS.items() if promise.is_identical}
every_exact = pytest.mark.parametrize("promise", EXACT.values(), ids=EXACT)

# East, north, against them, and slantwise into all quarters, once around and more.
DIRECTIONS: list[str | float] = ["x", "y", 270.0, -180.0, 30.0, -30.0, 135.0, 211.3, 719.0]


@every_exact
def test_every_direction_gives_the_same_partition(promise: Promise) -> None:
    points = houses(60, 900)
    first, *others = (
        ss.segment(points, promise.segmentor, spans=ss.SpanByWidth(3.0, direction)) for direction in DIRECTIONS
    )
    assert len(np.unique(first)) > 3
    for direction, labels in zip(DIRECTIONS[1:], others, strict=True):
        assert same(first, labels), direction


@settings(max_examples=max(1, settings.get_profile("default").max_examples // 2))
@given(
    st.integers(0, 10**6),
    st.sampled_from([None, 0.125, 0.5]),
    st.floats(-400, 400),
    st.floats(-400, 400),
    st.floats(2.1, 12.0),
)
@every_exact
def test_any_two_directions_agree(
    promise: Promise, seed: int, step: float | None, one: float, other: float, width: float
) -> None:
    # A coarse lattice is full of points at one place, in line, on one circle and at exactly the distance.
    points = houses(seed, 400, step)
    labels = [ss.segment(points, promise.segmentor, spans=ss.SpanByWidth(width, azimuth)) for azimuth in (one, other)]
    assert same(*labels)


# Parameters for a forest of a few points per square meter.
FOREST: dict[str, Any] = {
    "delaunay xyz": ss.Proximity(1.0),
    "delaunay xy": ss.Proximity(0.4, metric="xy"),
    "radius xyz": ss.Proximity(1.0, graph="radius"),
    "dbscan": ss.Dbscan(1.2, 6),
    "heights": ss.ConditionalClustering("abs(Z - n[0].Z) < 0.3", search_radius=1.0, min_segment_size=1),
    "growing": ss.RegionGrowing(20, search_radius=2.0, angle_deg=15.0),
    "planes": ss.PlaneExtraction(1.5, max_distance=0.2, max_sigma=0.2, min_segment_size=20),
}


@pytest.fixture(scope="module")
def forest(data: Path) -> Path:
    return data / "als" / "mixed_conifer.laz"


@pytest.mark.parametrize("name", FOREST)
def test_a_measured_cloud_too(forest: Path, name: str) -> None:
    def run(direction: str | float) -> NDArray[np.int64]:
        with ss.stream(
            forest, FOREST[name], spans=ss.SpanByWidth(15.0, direction), result="final", with_points=False
        ) as run:
            assert run.is_identical
            labels = ids_of(run)
        assert len(labels) == 37_657
        return labels

    first, *others = map(run, ("x", "y", 30.0, -65.0, 180.0))
    assert len(np.unique(first)) > 10
    assert all(same(first, labels) for labels in others)
