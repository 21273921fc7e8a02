"""Region growing against its twins and against itself, streamed, on measured clouds.

The twins take their time, so they see a part of each cloud; with `STREAMSEG_WHOLE=1` they see all of it.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

import streamseg as ss
from reference import region_growing as twin
from reference.clouds import LatticeCloud
from reference.consumer import ids_of
from reference.partition import agreement, same

NORMALS = ["NormalX", "NormalY", "NormalZ"]
MOST_POINTS = None if os.environ.get("STREAMSEG_WHOLE") else 25_000


class Cloud(NamedTuple):
    """A cloud to segment, and the same in steps for the twin."""

    source: Any
    points: NDArray[np.float64]
    scale: float

    def part(self) -> Cloud:
        """The points with the smallest x, in steps."""
        chosen = np.sort(np.argsort(self.points[:, 0], kind="stable")[:MOST_POINTS])
        return Cloud(self.points[chosen], self.points[chosen], 1.0)


@pytest.fixture(scope="module")
def measured(data: Path, cloud: Callable[[str], LatticeCloud]) -> Callable[[str], Cloud]:
    def read(name: str) -> Cloud:
        if name.endswith(".bin"):
            points = np.fromfile(data / name, np.float32).reshape(-1, 4)[:, :3].astype(float)
            return Cloud(points, points, 1.0)
        path, steps, scale = cloud(name)
        return Cloud(path, steps.astype(float), scale)

    return read


def surface(cloud: Cloud, k: int, curvature: str = "SurfaceVariation", **limits: float) -> twin.Surface:
    found = ss.features(cloud.source, [*NORMALS, curvature], k=k)
    normals = np.column_stack([found[name] for name in NORMALS])
    return twin.Surface(cloud.points, cloud.scale, twin.nearest(cloud.points, k), normals, found[curvature], **limits)


SMALL = st.integers(-4, 4)
CLOUDS = st.one_of(
    st.lists(st.tuples(SMALL, SMALL, SMALL), max_size=40),
    st.lists(st.tuples(SMALL, SMALL, st.integers(0, 1)), max_size=60),
)


@given(CLOUDS, st.integers(1, 12), st.sampled_from([5.0, 30.0]), st.sampled_from([0.001, 0.05]), st.booleans())
def test_small_clouds(
    rows: list[tuple[int, int, int]], k: int, angle: float, max_curvature: float, smooth: bool
) -> None:
    points = np.array(rows, float).reshape(-1, 3)
    expected = surface(Cloud(points, points, 1.0), k, angle_deg=angle, max_curvature=max_curvature)
    growing = ss.RegionGrowing(k, angle_deg=angle, max_curvature=max_curvature)
    assert same(ss.segment_static(points, growing), twin.order_free(expected))
    literal = ss.RegionGrowing(k, angle_deg=angle, max_curvature=max_curvature, literal=True, smooth=smooth)
    assert same(ss.segment_static(points, literal), twin.literal(expected, smooth_mode=smooth))


@pytest.mark.parametrize(
    ("name", "residual"),
    [
        ("isprs/CSite3.laz", None),
        ("als/delft_ahn3.laz", 0.2),
        ("als/lidarhd_77050_627755.laz", None),
        ("spinning/kitti_a.bin", 0.05),
    ],
)
def test_measured_clouds(measured: Callable[[str], Cloud], name: str, residual: float | None) -> None:
    whole = measured(name)
    residual = None if residual is None else residual / whole.scale
    cloud = whole.part()
    expected = surface(cloud, 30, angle_deg=20.0, residual=np.inf if residual is None else residual)
    found = ss.segment_static(cloud.source, ss.RegionGrowing(angle_deg=20.0, residual=residual))
    assert same(found, twin.order_free(expected))
    literal = ss.segment_static(cloud.source, ss.RegionGrowing(angle_deg=20.0, residual=residual, literal=True))
    assert same(literal, twin.literal(expected))
    smooth = expected.smooth()
    print(
        f"{name}: {len(np.unique(found[found > 0]))} segments, literal {len(np.unique(literal))}; adjusted Rand index "
        f"{agreement(found, literal):.4f}, over smooth points {agreement(found[smooth], literal[smooth]):.4f}"
    )


# Per step of a centimeter: a radius of 2 m.
LIMIT = 0.005


def test_principal_curvature(measured: Callable[[str], Cloud]) -> None:
    cloud = measured("als/lidarhd_77050_627755.laz").part()
    curvature = ss.features(cloud.source, ["MaxCurvature", "MinCurvature"], k=30)
    expected = surface(cloud, 30, max_curvature=LIMIT)
    expected = twin.Surface(**{**vars(expected), "curvature": np.maximum(*map(np.abs, curvature.values()))})
    growing = ss.RegionGrowing(curvature="principal", max_curvature=LIMIT)
    assert same(ss.segment_static(cloud.source, growing), twin.order_free(expected))


@pytest.mark.parametrize(
    ("name", "radius", "widths"),
    [
        ("isprs/CSite3.laz", 3.0, [3.0, 10.0, 60.0]),
        ("als/lidarhd_77050_627755.laz", 1.0, [1.0, 4.0, 15.0]),
        ("spinning/kitti_a.bin", 0.5, [0.6, 3.0, 20.0]),
    ],
)
def test_streamed_is_static(measured: Callable[[str], Cloud], name: str, radius: float, widths: list[float]) -> None:
    source = measured(name).source
    growing = ss.RegionGrowing(search_radius=radius, angle_deg=20.0)
    static = ss.segment_static(source, growing)
    for width, direction in zip(widths, ("x", "y", 30.0), strict=True):
        spans = ss.SpanByWidth(width if direction != 30.0 else width * 1.01, direction)
        assert same(ss.segment(source, growing, spans=spans, threads=2), static), f"width {width} along {direction}"


@pytest.mark.parametrize("width", [10.0, 60.0])
def test_without_a_radius_the_literal_form_is_near_to_static(data: Path, width: float) -> None:
    growing = ss.RegionGrowing(angle_deg=20.0, literal=True)
    static = ss.segment_static(data / "als/lidarhd_77050_627755.laz", growing)
    labels = ss.segment(data / "als/lidarhd_77050_627755.laz", growing, spans=ss.SpanByWidth(width))
    index = agreement(labels, static)
    print(f"width {width}: adjusted Rand index {index:.6f}")
    assert index > 0.99


@pytest.mark.parametrize(
    ("name", "widths"),
    [
        ("als/lidarhd_77050_627755.laz", [2.0, 7.0]),
        ("als/topography.laz", [5.0, 20.0]),
        ("als/autzen_trim.laz", [12.0, 40.0]),
        ("spinning/kitti_a.bin", [0.7, 5.0]),
    ],
)
def test_without_a_radius_streamed_is_static(measured: Callable[[str], Cloud], name: str, widths: list[float]) -> None:
    source = measured(name).source
    growing = ss.RegionGrowing(angle_deg=20.0)
    static = ss.segment_static(source, growing)
    again = []
    for width, direction in zip(widths, ("x", 30.0), strict=True):
        spans = ss.SpanByWidth(width, direction)
        with ss.stream(source, growing, spans=spans, threads=2, result="final", with_points=False) as run:
            found = ids_of(run)
        assert same(found, static), f"width {width} along {direction}"
        assert run.is_proven
        again.append(run.certificate.returned_points)
        print(f"{name}, width {width}: {run.certificate}")
    assert again[0] > 0, "nothing was looked at again, so nothing was tried"


def far_apart() -> NDArray[np.float64]:
    """Flat patches of 4 x 4 points, each 1 wide, that lie 50 from each other and a little higher each."""
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(4.0), np.arange(4.0)))
    return np.concatenate([np.column_stack([x + 50 * i, y + 5 * i, np.full(16, 0.01 * i)]) for i in range(12)])


def test_neighbors_that_share_no_window_are_joined_in_the_history_too(tmp_path: Path) -> None:
    points = far_apart()
    growing = ss.RegionGrowing(20, max_curvature=None)
    static = ss.segment_static(points, growing)
    with ss.stream(
        points, growing, spans=ss.SpanByWidth(0.5), window=ss.Window(2, 0), history=tmp_path / "run", result="carry"
    ) as run:
        spans = list(run)
    assert run.warning is None
    assert run.is_proven
    ids = np.concatenate([span.segment_ids for span in spans])
    order = np.concatenate([span.point_ids for span in spans])
    assert same(run.resolve(ids)[np.argsort(order)], static)
    resolved = list(ss.History(tmp_path / "run").resolve())
    order, ids = (np.concatenate(column) for column in zip(*resolved, strict=True))
    assert same(ids[np.argsort(order)], static)
    one, two = static[:16], static[16:32]
    assert set(one) & set(two), "no neighbors far apart, so nothing was tried"


def test_points_that_a_live_source_leaves_undecided_are_warned_of() -> None:
    points = far_apart()
    growing = ss.RegionGrowing(20)
    order = np.argsort(points[:, 0], kind="stable")
    columns = (points[order[i : i + 5]] for i in range(0, len(points), 5))
    with ss.stream(columns, growing, spans=ss.SpanByWidth(3.0), result="final") as run:
        assert not run.is_identical
        with pytest.warns(ss.StreamsegWarning, match="points were left undecided.*give a search_radius") as caught:
            ids = np.concatenate([span.segment_ids for span in run])
    assert len(caught) == 1
    assert not run.is_proven
    undecided = run.certificate.undecided_points
    assert 0 < undecided <= len(points)
    assert str(caught[0].message).startswith(f"{undecided} points")
    assert np.count_nonzero(ids == -1) <= undecided


def test_normals_of_the_cloud_are_used() -> None:
    """A cloud that says of itself that it is a fold."""
    x, y = (axis.ravel().astype(float) for axis in np.meshgrid(np.arange(20), np.arange(20)))
    points = np.column_stack([x, y, np.zeros(400)])
    tilt = np.where(x < 10, 0.0, 1.0)
    attributes = {"NormalX": tilt, "NormalY": np.zeros(400), "NormalZ": 1 - tilt}
    growing = ss.RegionGrowing(9)
    assert len(np.unique(ss.segment_static(points, growing))) == 1
    labels = ss.segment_static(points, growing, attributes=attributes)
    assert same(labels, tilt)


BAD: dict[str, tuple[dict[str, Any], str]] = {
    "angle": ({"angle_deg": 120.0}, "angle_deg is 120, allowed: degrees from 0 to 90"),
    "curvature": ({"curvature": "gauss"}, "curvature is 'gauss', allowed: 'surface_variation' or 'principal'"),
    "threshold": ({"max_curvature": -1.0}, "max_curvature is -1, allowed: a finite number of at least 0, or None"),
    "residual": ({"residual": float("nan")}, "residual is NaN, allowed: a finite number of at least 0, or None"),
    "k": ({"k": 0}, "k is 0, allowed: a whole number of at least 1"),
    "nothing": ({"k": None}, "search_radius and k are both None"),
}


@pytest.mark.parametrize("case", BAD)
def test_what_is_wrong_is_said(case: str) -> None:
    given_, message = BAD[case]
    with pytest.raises(ss.InvalidParameter, match=message):
        ss.RegionGrowing(**given_)
