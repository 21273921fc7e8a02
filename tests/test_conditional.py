"""Conditional clustering beside NumPy: criteria on measured clouds, search modes, seeds, any text as a criterion."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import cKDTree

import streamseg as ss
from reference.clouds import LatticeCloud
from reference.conditional import clusters, components, near
from reference.partition import agreement, same
from reference.roster import SAME_NORMAL, Positions, houses

NORMALS = ("NormalX", "NormalY", "NormalZ")


def every(criterion: str, search_radius: Any = 1.0, **more: Any) -> ss.ConditionalClustering:
    """Clusters of any size."""
    return ss.ConditionalClustering(criterion, search_radius=search_radius, min_segment_size=1, **more)


# Beside NumPy.


def test_heights_on_csite3(cloud: Callable[[str], LatticeCloud]) -> None:
    stored = cloud("isprs/CSite3.laz")
    heights = np.asarray(laspy.read(stored.path).z, float)
    expected = clusters(
        len(heights),
        near(stored.points, 1.5 / stored.scale),
        {"z": heights},
        lambda p, n: abs(p["z"] - n["z"]) < 0.15,
    )
    labels = ss.segment_static(stored.path, every("abs(Z-n[0].Z)<0.15", 1.5))
    assert same(labels, expected)
    print(f"{len(labels)} points, {labels.max()} segments")


@pytest.fixture(scope="module")
def delft(data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A fifth of the row houses of Delft."""
    las = laspy.read(data / "als" / "delft_ahn3.laz")
    las.points = las.points[las.x < las.x.min() + 40]
    piece = tmp_path_factory.mktemp("delft") / "piece.laz"
    las.write(piece)
    return piece


def test_normals_on_delft(delft: Path) -> None:
    las = laspy.read(delft)
    steps = np.column_stack([las.X, las.Y, las.Z]).astype(np.int64)
    normals = ss.features(delft, NORMALS, search_radius=0.6)
    expected = clusters(
        len(steps),
        near(steps, 600),
        normals,
        lambda p, n: p["NormalX"] * n["NormalX"] + p["NormalY"] * n["NormalY"] + p["NormalZ"] * n["NormalZ"] > 0.996,
    )
    criterion = "normalX*n[0].normalX+normalY*n[0].normalY+normalZ*n[0].normalZ>0.996"
    labels = ss.segment_static(delft, every(criterion, 0.6))
    assert same(labels, expected)
    # The pair variable looks at the normals too, and does not mind which way they point.
    turned = clusters(
        len(steps),
        near(steps, 600),
        normals,
        lambda p, n: abs(sum(p[name] * n[name] for name in NORMALS)) > np.cos(np.radians(5.0)),
    )
    assert agreement(ss.segment_static(delft, every("angle < 5", 0.6)), turned) > 0.9999


def test_a_spinning_scan(data: Path) -> None:
    points = np.fromfile(data / "spinning" / "kitti_a.bin", np.float32).reshape(-1, 4).astype(float)
    attributes = {"Intensity": points[:, 3]}
    expected = clusters(
        len(points),
        near(points[:, :3], 0.3),
        {"z": points[:, 2], **attributes},
        lambda p, n: (abs(p["Intensity"] - n["Intensity"]) < 0.1) & (abs(p["z"] - n["z"]) < 0.05),
    )
    segmentor = every("abs(Intensity - n[0].Intensity) < 0.1 and abs(Z - n[0].Z) < 0.05", 0.3)
    assert same(ss.segment_static(points[:, :3], segmentor, attributes=attributes), expected)


# Search modes.

# radii, the twin's arguments, and whether p is n's neighbor if n is p's.
CYLINDERS: dict[str, tuple[dict[str, Any], dict[str, Any], bool]] = {
    "ball": ({"search_radius": 0.75}, {"radius": 0.75}, True),
    "disc": ({"search_radius": 0.25, "search_mode": "2d"}, {"radius": 0.25, "flat": True}, True),
    "one": ({"search_radius": 0.5, "search_mode": "2.5d"}, {"radius": 0.5, "low": -0.5, "high": 0.5}, True),
    "two": ({"search_radius": (0.5, 0.25), "search_mode": "2.5d"}, {"radius": 0.5, "low": -0.25, "high": 0.25}, True),
    "three, even": (
        {"search_radius": (0.5, -1.0, 1.0), "search_mode": "2.5d"},
        {"radius": 0.5, "low": -1.0, "high": 1.0},
        True,
    ),
    "three": (
        {"search_radius": (0.75, -0.25, 1.0), "search_mode": "2.5d"},
        {"radius": 0.75, "low": -0.25, "high": 1.0},
        False,
    ),
}


@pytest.mark.parametrize("name", CYLINDERS)
@pytest.mark.parametrize("seed", range(3))
def test_search_modes(name: str, seed: int) -> None:
    points = houses(50 + seed, 600, step=0.25)
    search, twin, is_symmetric = CYLINDERS[name]
    segmentor = every("true", **search)
    assert segmentor.is_symmetric == is_symmetric
    labels = ss.segment_static(points, segmentor)
    if is_symmetric:
        assert same(labels, components(len(points), near(points, **twin)))
        assert same(ss.segment(points, segmentor, spans=ss.SpanByWidth(2.5)), labels)
    else:
        low, high = search["search_radius"][1:]
        expected = grown(points, twin["radius"], lambda p, n: (low <= n[:, 2] - p[2]) & (n[:, 2] - p[2] <= high), 2)
        assert same(labels, expected)


def grown(
    points: Positions, radius: float, hold: Callable[[NDArray[Any], NDArray[Any]], NDArray[np.bool_]], axes: int = 3
) -> NDArray[np.int64]:
    """Seeded growing as the paper tells it: the first point without a segment is a seed, and takes all it can reach."""
    near_to = cKDTree(points[:, :axes]).query_ball_point(points[:, :axes], radius)
    labels = np.full(len(points), -1, np.int64)
    for seed in range(len(points)):
        if labels[seed] != -1:
            continue
        labels[seed], stack = seed, [seed]
        while stack:
            point = stack.pop()
            free = np.array([other for other in near_to[point] if labels[other] == -1], int)
            taken = free[hold(points[point], points[free])] if len(free) else free
            labels[taken] = seed
            stack.extend(taken)
    return labels


@pytest.mark.parametrize("seed", range(3))
def test_what_is_not_symmetric_grows_from_seeds(seed: int) -> None:
    points = houses(60 + seed, 600)
    segmentor = every("n[0].Z <= Z + 0.03", 0.75)
    assert not segmentor.is_symmetric
    expected = grown(points, 0.75, lambda p, n: n[:, 2] <= p[2] + 0.03)
    assert same(ss.segment_static(points, segmentor), expected)


def test_what_is_not_symmetric_promises_nothing_and_says_so() -> None:
    run = ss.stream(houses(70), every("n[0].Z <= Z", 0.75), spans=ss.SpanByWidth(5.0))
    assert (run.exactness, run.is_identical) == ("C", False)
    assert run.promise.startswith("no promise of equality with the static result")


@pytest.mark.parametrize(
    ("criterion", "is_symmetric"),
    [
        ("true", True),
        ("false", True),
        ("abs(Z-n[0].Z)<0.15", True),
        (SAME_NORMAL, True),
        ("dist < 0.5 and angle < 5", True),
        ("dz < 0.1 and dz > -0.1", True),
        ("Class[2] and n[0].Class[2]", True),
        ("Z < 3 ? n[0].Z < 3 : n[0].Z >= 3", True),
        ("Z-n[0].Z<0.15", False),
        ("dz < 0.1", False),
        ("Class[2]", False),
        ("n[0].Region[0 0 5 0 5 5]", False),
        ("Z / n[0].Z < 1.1", False),
    ],
)
def test_symmetry(criterion: str, is_symmetric: bool) -> None:
    # What is symmetric may remain unproven; what is not must never pass for it.
    found = every(criterion).is_symmetric
    assert found == is_symmetric or (is_symmetric and "?" in criterion)


# Streamed.


@pytest.mark.parametrize(
    ("name", "criterion", "radius"),
    [
        ("isprs/CSite3.laz", "abs(Z-n[0].Z)<0.15", 1.5),
        ("als/lidarhd_77050_627755.laz", SAME_NORMAL, 1.0),
        ("als/autzen_trim.laz", "abs(Intensity-n[0].Intensity) < 20 and abs(dz) < 1", 4.0),
    ],
)
def test_streamed_is_static_on_measured_clouds(data: Path, name: str, criterion: str, radius: float) -> None:
    segmentor = ss.ConditionalClustering(criterion, search_radius=radius, min_segment_size=2)
    static = ss.segment_static(data / name, segmentor)
    for times, direction in [(3, "x"), (10, 30.0), (25, "y")]:
        with ss.stream(
            data / name, segmentor, spans=ss.SpanByWidth(times * radius, direction), result="final", with_points=False
        ) as run:
            labels = np.full(len(static), -1)
            for span in run:
                labels[span.point_ids] = span.segment_ids
        assert run.is_identical
        assert same(labels, static)
    print(f"{name}: {static.max()} segments, {np.count_nonzero(static == -1)} of {len(static)} points alone")


# Any text.

WORDS = [
    "Z",
    "n[0].Z",
    "[Pulse",
    "width]",
    "n[0].",
    "n[1].Z",
    "dist",
    "angle",
    "dz",
    "0.15",
    "1e308",
    "1e999",
    "0",
    "pi",
    "invalid",
    "true",
    "and",
    "or",
    "not",
    "AND",
    "||",
    "&&",
    "!",
    "(",
    ")",
    "<",
    "<=",
    "==",
    "!=",
    "<>",
    "=",
    "+",
    "-",
    "*",
    "/",
    "%",
    "^",
    "?",
    ":",
    ",",
    "abs(",
    "min(",
    "max(",
    "sqrt(",
    "Class[2]",
    "Class[",
    "Region[0",
    "0",
    "1",
    "0",
    "1",
    "1]",
    "Region[0",
    "Generic[",
    "]",
    "[",
    "É",
    "\n",
    "\x00",
    "valid(",
    "Intensity",
    "atan2(",
]


def texts(random: np.random.Generator) -> list[str]:
    """A text of each kind, from noise to what is nearly a criterion."""
    noise = random.integers(0, 256, 200, np.uint8).tobytes()
    printable = bytes(random.integers(32, 127, 200, np.uint8)).decode()
    sentence = " ".join(random.choice(WORDS, random.integers(1, 12)))
    nearly = list("abs(Z-n[0].Z)<0.15 and Class[2] or Region[0 0 9 0 9 9]")
    nearly[random.integers(len(nearly))] = random.choice(WORDS)
    return [noise.decode("latin-1"), noise.decode("utf-8", "replace"), printable, sentence, "".join(nearly)]


def is_understood(text: str, points: Positions) -> bool:
    """Whether a text is a criterion; runs it, and runs it as a filter, and takes any refusal."""
    try:
        segmentor = every(text)
    except ss.InvalidParameter:
        return False
    with contextlib.suppress(ss.StreamsegError):
        assert ss.segment_static(points, segmentor).shape == (len(points),)
        ss.segment_static(points, ss.Proximity(1.0, filter=text))
    return True


def test_no_text_is_too_much() -> None:
    random = np.random.default_rng(9)
    points = houses(80, 40)
    understood = sum(is_understood(text, points) for _ in range(800) for text in texts(random))
    print(f"{understood} of 4000 texts are criteria")
    assert understood > 20


@pytest.mark.parametrize(
    "text", ["\0", "", " ", "\ud800", "(" * 5000, "not " * 2000 + "true", "Z<1 or " * 2000, "é" * 300]
)
def test_odd_texts_are_refused(text: str) -> None:
    with pytest.raises((ss.InvalidParameter, UnicodeEncodeError)):
        every(text)
