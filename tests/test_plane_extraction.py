"""Planes, beside a twin that adjusts each of them from scratch, on made-up roofs, and streamed beside static."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

import streamseg as ss
from reference.clouds import LatticeCloud
from reference.consumer import ids_of
from reference.partition import agreement, same
from reference.plane_extraction import Extraction, adjust

Floats = NDArray[np.float64]

NORMALS = ["NormalX", "NormalY", "NormalZ", "NormalSigma0"]
# Fractions of two, so that nothing is rounded and pairs lie at exactly the radius.
STEP = 1 / 64


def gable(seed: int, points: int, noise: float) -> Floats:
    """Two slopes that meet in a ridge, a flat roof 0.2 m above their eaves, and ground."""
    random = np.random.default_rng(seed)
    x, y = random.uniform(0, 12, points), random.uniform(0, 6, points)
    z = np.select([x < 4, x < 8, x < 10], [2 + 0.5 * x, 2 + 0.5 * (8 - x), np.full(points, 2.2)], 0.0)
    cloud = np.column_stack([x, y, z + random.normal(0, noise, points)])
    return np.asarray(np.round(cloud / STEP) * STEP)


def twin_labels(
    points: Floats, segmentor: ss.PlaneExtraction, weights: Callable[[Floats], Floats]
) -> NDArray[np.int64]:
    """What the definition says, for a segmentor without options whose seeds have the `weights` of their σ0."""
    assert isinstance(segmentor.search_radius, float)
    columns = ss.features(points, NORMALS, search_radius=segmentor.search_radius)
    sigmas = columns["NormalSigma0"]
    normals = np.column_stack([columns[name] for name in NORMALS[:3]])
    limits = (segmentor.max_distance, segmentor.max_sigma, segmentor.min_angle_deg, segmentor.tile_size)
    return Extraction(points, normals, sigmas, weights(sigmas), segmentor.search_radius, *limits).labels()


def below(limit: float) -> Callable[[Floats], Floats]:
    """Seeds are what is even enough, the most even first."""

    def weights(sigmas: Floats) -> Floats:
        with np.errstate(invalid="ignore"):
            return np.where(sigmas < limit, sigmas, np.nan)

    return weights


def extraction(seed_sigma: float, **parameters: float) -> ss.PlaneExtraction:
    calculator = f"NormalSigma0 < {seed_sigma} ? NormalSigma0 : invalid"
    return ss.PlaneExtraction(1.0, seed_calculator=calculator, min_segment_size=1, **parameters)  # type: ignore[arg-type]


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("tile_size", [20.0, 5.0])
def test_roofs_are_those_of_the_definition(seed: int, tile_size: float) -> None:
    points = gable(seed, 450, noise=0.02)
    segmentor = extraction(0.04, max_distance=0.08, tile_size=tile_size)
    labels = ss.segment_static(points, segmentor)
    assert same(labels, twin_labels(points, segmentor, below(0.04)))


@given(
    st.lists(st.tuples(st.integers(-12, 12), st.integers(-12, 12), st.integers(-2, 2)), max_size=60),
    st.sampled_from([2.0, 3.0, 20.0]),
    st.sampled_from([0.05, 0.3]),
)
def test_any_small_cloud_is_as_defined(
    cloud: list[tuple[int, int, int]], tile_size: float, max_distance: float
) -> None:
    points = np.array(cloud, dtype=np.float64).reshape(-1, 3) / 4
    # Off the axes a little, so that the last digit does not decide which of two planes is nearer.
    points[:, 2] += np.round((points[:, 0] * 0.37 + points[:, 1] ** 2 * 0.011) / STEP) * STEP
    segmentor = extraction(0.2, max_distance=max_distance, max_sigma=0.2, tile_size=tile_size)
    labels = ss.segment_static(points, segmentor)
    assert same(labels, twin_labels(points, segmentor, below(0.2)))


@pytest.mark.parametrize(
    "points",
    [
        np.empty((0, 3)),
        np.zeros((1, 3)),
        np.zeros((30, 3)),
        np.linspace(0, 5, 40)[:, None] * [[1.0, 2.0, 0.5]],
        np.array([[1e59, -1e59, 0.0], [0.0, 0.0, 0.0]]),
    ],
    ids=["empty", "one", "coincident", "collinear", "huge"],
)
def test_without_a_plane_there_is_none(points: Floats) -> None:
    assert (ss.segment_static(points, extraction(1.0)) == -1).all()


def test_slopes_and_steps_are_planes_of_their_own() -> None:
    points = gable(7, 6000, noise=0.01)
    labels = ss.segment_static(points, ss.PlaneExtraction(0.7, max_distance=0.06))
    x = points[:, 0]
    # Near an edge normals are those of neither side.
    faces = [x < 3.4, (x > 4.6) & (x < 7.4), (x > 8.6) & (x < 9.4), x > 10.6]
    main = [np.bincount(labels[face] + 1).argmax() - 1 for face in faces]
    assert len(set(main)) == 4
    assert -1 not in main
    assert all((labels[face] == label).mean() > 0.99 for face, label in zip(faces, main, strict=True))
    for label in set(labels) - {-1}:
        plane = adjust(points[labels == label])
        assert plane is not None
        assert plane.sigma0 < 0.02


def test_a_vertical_wall_is_one_plane_whatever_the_signs_of_its_normals() -> None:
    random = np.random.default_rng(3)
    wall = np.column_stack([random.normal(0, 0.004, 2000), random.uniform(0, 8, 2000), random.uniform(0, 5, 2000)])
    labels = ss.segment_static(wall, ss.PlaneExtraction())
    assert (labels == labels[0]).mean() > 0.99
    assert labels[0] != -1


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"max_distance": 0.0}, "max_distance is 0"),
        ({"max_sigma": -1.0}, "max_sigma is -1"),
        ({"min_angle_deg": 91.0}, "min_angle_deg is 91"),
        ({"tile_size": 1.0}, "tile_size is 1, allowed: at least twice the search radius"),
        ({"seed_calculator": "NormalSigma0 <"}, "calculator"),
    ],
)
def test_errors_say_what_is_allowed(parameters: dict[str, float], message: str) -> None:
    with pytest.raises(ss.InvalidParameter, match=message):
        ss.PlaneExtraction(1.0, **parameters)  # type: ignore[arg-type]


def test_streamed_is_static_on_a_city(cloud: Callable[[str], LatticeCloud]) -> None:
    city = cloud("als/delft_ahn3.laz")
    low = city.points.min(axis=0)
    # A strip along the spans' direction; benches/planes.py takes the whole.
    part = city.points[(city.points[:, 1] - low[1]) * city.scale < 30]
    points = (part - low) * city.scale
    segmentor = ss.PlaneExtraction(1.0, max_distance=0.1)
    labels = ss.segment_static(points, segmentor)
    in_planes = labels != -1
    for width in (10.0, 20.0, 50.0):
        streamed = ss.segment(points, segmentor, spans=ss.SpanByWidth(width), window=ss.Window(3, 1))
        found = agreement(labels[in_planes], streamed[in_planes])
        print(f"spans of {width} m: adjusted Rand index {found:.4f} over {in_planes.sum()} points of planes")
        assert found >= 0.95
        assert same(labels, streamed)


def wave(seed: int) -> tuple[Floats, float]:
    """A strip that bends gently about one plane, and where its first plane starts: far ends are released."""
    random = np.random.default_rng(seed)
    bends = int(random.integers(4, 9))
    places, heights = np.sort(random.uniform(0, 19, bends)), random.uniform(-0.06, 0.06, bends)
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(0.05, 19.5, 0.25), np.arange(0.05, 1.5, 0.25)))
    return np.column_stack([x, y, np.interp(x, places, heights)]), float(random.uniform(0, 19))


@pytest.mark.parametrize("seed", [394, 1411, 1601, 2502])
def test_a_plane_whose_middle_is_released_is_one_segment_per_piece(seed: int) -> None:
    points, start = wave(seed)
    calculator = f"NormalSigma0 + 0.001 * abs(X - {start!r})"
    limits = {"tile_size": 20.0, "min_angle_deg": 30.0}
    segmentor = ss.PlaneExtraction(0.5, seed_calculator=calculator, min_segment_size=1, **limits)  # type: ignore[arg-type]
    labels = ss.segment_static(points, segmentor)
    for label in set(labels) - {-1}:
        assert np.diff(np.unique(points[labels == label, 0])).max(initial=0.0) <= 0.5
    assert same(labels, twin_labels(points, segmentor, lambda sigmas: sigmas + 0.001 * abs(points[:, 0] - start)))
    for width, window in [(0.51, ss.Window(3, 1)), (0.6, ss.Window(2, 1))]:
        with ss.stream(points, segmentor, spans=ss.SpanByWidth(width), window=window, result="final") as run:
            streamed = ids_of(run)
        assert run.is_identical
        assert same(labels, streamed)


def test_in_stream_order_planes_of_two_windows_have_to_agree() -> None:
    # Two slopes, told row by row: windows cut across them, and the ridge is never crossed.
    points = gable(11, 8000, noise=0.005)
    points = points[(points[:, 0] < 8)]
    points = points[np.argsort(points[:, 1])]
    segmentor = ss.PlaneExtraction(0.7, max_distance=0.05)
    labels = ss.segment(points, segmentor, spans=ss.SpanByCount(1500))
    x = points[:, 0]
    left, right = (np.bincount(labels[face] + 1).argmax() - 1 for face in (x < 3.8, x > 4.2))
    assert left != right
    assert -1 not in (left, right)
    assert (labels[x < 3.8] == left).mean() > 0.9
    assert (labels[x > 4.2] == right).mean() > 0.9
