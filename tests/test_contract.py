"""What every segmentor keeps to, whatever it does: as a value, as a page, on the command line, and in its labels."""

from __future__ import annotations

import copy
import inspect
import pickle
import re
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import streamseg as ss
from reference.partition import agreement, same
from reference.roster import CLASSES, NEEDED, OURS, PAGES, ROSTER, Positions, Promise, houses

DOCS = Path(__file__).parents[1] / "docs"
OPTIONS = ("min_segment_size", "max_segment_size", "filter", "seed_filter", "sort", "normals")

every = pytest.mark.parametrize("promise", ROSTER.values(), ids=ROSTER)
every_of_ours = pytest.mark.parametrize("promise", OURS.values(), ids=OURS)
ORDER_FREE = {name: promise for name, promise in ROSTER.items() if promise.is_order_free}
order_free = pytest.mark.parametrize("promise", ORDER_FREE.values(), ids=ORDER_FREE)
every_class = pytest.mark.parametrize("method", CLASSES)


def quiet(points: Positions, segmentor: Any, **more: Any) -> NDArray[np.int64]:
    """Segment as a stream without a word on what may differ."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ss.StreamsegWarning)
        return ss.segment(points, segmentor, **more)


# As a value.


@every_of_ours
def test_a_segmentor_is_a_value(promise: Promise) -> None:
    segmentor = promise.segmentor
    for twin in (
        eval(repr(segmentor), vars(ss)),
        pickle.loads(pickle.dumps(segmentor)),
        copy.copy(segmentor),
        copy.deepcopy(segmentor),
    ):
        assert twin == segmentor
        assert hash(twin) == hash(segmentor)
        assert repr(twin) == repr(segmentor)
    others = [other.segmentor for other in OURS.values()]
    assert sum(segmentor == other for other in others) == 1
    assert segmentor != repr(segmentor)


@every_of_ours
def test_a_segmentor_is_frozen(promise: Promise) -> None:
    for name in [*parameters(type(promise.segmentor)), *OPTIONS, "something"]:
        with pytest.raises(AttributeError):
            setattr(promise.segmentor, name, 1)


@every_class
def test_every_parameter_can_be_read_again(method: str) -> None:
    made = CLASSES[method](**NEEDED.get(method, {}))
    given = {name: getattr(made, name) for name in parameters(CLASSES[method])}
    options = {name: getattr(made, name) for name in OPTIONS}
    again = CLASSES[method](**given, **options)
    assert {name: getattr(again, name) for name in [*given, *options]} == {**given, **options}


@every_class
def test_an_option_given_as_it_is_anyway_makes_no_difference(method: str) -> None:
    needed = NEEDED.get(method, {})
    plain = CLASSES[method](**needed)
    spelled = CLASSES[method](**needed, **{name: getattr(plain, name) for name in OPTIONS})
    assert spelled == plain
    assert hash(spelled) == hash(plain)
    assert CLASSES[method](**needed, min_segment_size=7) != plain


def parameters(kind: Any) -> list[str]:
    return [name for name in inspect.signature(kind).parameters if name != "options"]


# As a page.


@every_class
def test_the_docstring_tells_all(method: str) -> None:
    text = inspect.getdoc(CLASSES[method]) or ""
    for section in ("Parameters", "Raises", "Examples"):
        assert re.search(rf"^{section}\n-+$", text, re.M), section
    for name in parameters(CLASSES[method]):
        assert re.search(rf"^{name} : ", text, re.M), name
    for name in OPTIONS:
        assert name in text


@every_class
def test_the_page_tells_every_parameter_and_its_default(method: str) -> None:
    page = (DOCS / "segmentors" / f"{PAGES[method]}.md").read_text()
    kind = CLASSES[method]
    made = kind(**NEEDED.get(method, {}))
    # Nothing, as tables have it.
    dash = "\N{EN DASH}"
    rows = dict(re.findall(r"^\| `(\w+)` \|[^|]*\|([^|]*)\|", page, re.M))
    for name, parameter in inspect.signature(kind).parameters.items():
        if name == "options":
            continue
        assert name in rows, f"{page[:40]}… has no row for {name}"
        told = rows[name].strip().strip("`").strip('"')
        if name in NEEDED.get(method, {}):
            assert told in (dash, "needed", "required")
        elif parameter.default is None and getattr(made, name) is None:
            assert told.lower() in ("none", dash)
        elif isinstance(getattr(made, name), float):
            assert re.match(rf"{getattr(made, name):g}\b", told) or not re.match(r"[\d.]", told)
        else:
            assert told == str(getattr(made, name))


@every_class
def test_the_exactness_page_names_it(method: str) -> None:
    assert f"`{CLASSES[method].__name__}" in (DOCS / "exactness.md").read_text()


@pytest.fixture(scope="module")
def help_text() -> str:
    done = subprocess.run(
        [sys.executable, "-m", "streamseg", "segment", "--help"],
        capture_output=True,
        text=True,
        env={"COLUMNS": "200", "PYTHONPATH": ":".join(sys.path), "NO_COLOR": "1"},
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@every_class
def test_the_command_line_has_it(method: str, help_text: str) -> None:
    from streamseg.cli.methods import METHODS

    entry = METHODS[method]
    assert entry.make is CLASSES[method]
    assert re.search(rf"\b{method}\b", help_text)
    for option, parameter in entry.options.items():
        assert option in help_text
        assert parameter in parameters(CLASSES[method])


# What it refuses.

WRONG: list[tuple[str, dict[str, Any], str]] = [
    ("proximity", {"distance": 0}, "distance is 0, allowed: a finite number above 0"),
    ("proximity", {"distance": -1.5}, "distance is -1.5, allowed: a finite number above 0"),
    ("proximity", {"distance": float("inf")}, "distance is inf, allowed: a finite number above 0"),
    ("proximity", {"graph": "gabriel"}, "graph is 'gabriel', allowed: 'delaunay' or 'radius'"),
    ("proximity", {"metric": "z"}, "metric is 'z', allowed: 'xyz' or 'xy'"),
    ("dbscan", {"eps": float("nan")}, "eps is NaN, allowed: a finite number above 0"),
    ("dbscan", {"min_points": 0}, "min_points is 0, allowed: a whole number of at least 1"),
    ("conditional", {"criterion": "abs(Z"}, "criterion, column 6: "),
    ("conditional", {"criterion": ""}, "criterion, column 1: "),
    ("conditional", {"criterion": "Z"}, "criterion, column 1: "),
    ("conditional", {"search_radius": 0}, "search_radius is 0, allowed: a finite number above 0"),
    ("conditional", {"search_radius": (1.0, 2.0)}, "search_radius"),
    ("conditional", {"search_radius": (), "search_mode": "2.5d"}, "search_radius"),
    ("conditional", {"search_radius": (1, 2, 3, 4), "search_mode": "2.5d"}, "search_radius"),
    ("conditional", {"search_radius": (1, 2, -3), "search_mode": "2.5d"}, "search_radius"),
    ("conditional", {"search_radius": "wide"}, "search_radius is 'wide', allowed: a length, or up to three"),
    ("conditional", {"search_mode": "4d"}, "search_mode is '4d', allowed: '2d', '2.5d' or '3d'"),
    ("planes", {"search_radius": -1.0}, "search_radius is -1, allowed: a finite number above 0"),
    ("planes", {"max_distance": 0.0}, "max_distance is 0, allowed: a finite number above 0"),
    ("planes", {"max_sigma": -0.5}, "max_sigma is -0.5, allowed: a finite number above 0"),
    ("planes", {"min_angle_deg": 91.0}, "min_angle_deg is 91, allowed: "),
    ("planes", {"seed_calculator": "Z > 5"}, "calculator, column 1: "),
    ("planes", {"seed_calculator": "n[0].Z"}, "calculator, column 1: "),
    ("planes", {"tile_size": 0.5}, "tile_size is 0.5, allowed: "),
    ("planes", {"k": 0}, "k is 0, allowed: "),
    ("growing", {"k": 0}, "k is 0, allowed: "),
    ("growing", {"k": -3}, "k is -3, allowed: "),
    ("growing", {"k": None}, "search_radius and k are both None, allowed: "),
    ("growing", {"search_radius": 0.0}, "search_radius is 0, allowed: a finite number above 0"),
    ("growing", {"angle_deg": -1.0}, "angle_deg is -1, allowed: "),
    ("growing", {"angle_deg": 91.0}, "angle_deg is 91, allowed: "),
    ("growing", {"curvature": "mean"}, "curvature is 'mean', allowed: "),
    ("growing", {"max_curvature": float("nan")}, "max_curvature is NaN, allowed: "),
    ("growing", {"residual": -0.1}, "residual is -0.1, allowed: "),
    *[
        (method, wrong, sentence)
        for method in CLASSES
        for wrong, sentence in [
            ({"min_segment_size": 0}, "min_segment_size is 0, allowed: "),
            ({"min_segment_size": -5}, "min_segment_size is -5, allowed: "),
            ({"max_segment_size": 0}, "max_segment_size is 0 with a min_segment_size of "),
            (
                {"min_segment_size": 200, "max_segment_size": 150},
                "max_segment_size is 150 with a min_segment_size of 200, allowed: ",
            ),
            ({"sort": "upward"}, "sort is 'upward', allowed: 'native', 'ascending' or 'descending'"),
            ({"normals": "best"}, "normals is 'best', allowed: 'least_squares' or 'robust'"),
            ({"filter": "Z >"}, "filter, column 4: "),
            ({"seed_filter": "n[0].Z > 1"}, "filter, column 1: "),
        ]
    ],
]


@pytest.mark.parametrize(("method", "wrong", "sentence"), WRONG, ids=lambda value: str(value)[:40])
def test_a_wrong_value_is_told_with_what_is_allowed(method: str, wrong: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ss.InvalidParameter) as refused:
        CLASSES[method](**{**NEEDED.get(method, {}), **wrong})
    assert str(refused.value).startswith(sentence)


@every_class
def test_a_value_of_the_wrong_type_is_refused(method: str) -> None:
    for name in [*parameters(CLASSES[method]), *OPTIONS]:
        with pytest.raises((TypeError, ValueError)):
            CLASSES[method](**{**NEEDED.get(method, {}), name: object()})
    with pytest.raises(TypeError, match="unheard_of"):
        CLASSES[method](**NEEDED.get(method, {}), unheard_of=1)


# Its labels.

DEGENERATE: dict[str, Positions] = {
    "empty": np.zeros((0, 3)),
    "one point": np.array([[5.0, 6, 7]]),
    "two equal points": np.full((2, 3), 4.5),
    "all points equal": np.full((300, 3), -7.25),
    "collinear": np.column_stack([np.arange(200.0) / 4, np.arange(200.0) / 2, np.zeros(200)]),
    "coplanar, vertical": np.array([[0.0, y / 2, z / 2] for y in range(15) for z in range(15)]),
    "three corners": np.array([[0.0, 0, 0], [0.25, 0, 0], [0, 0.25, 0]]),
    "far away": np.array([[0.0, 0, 0], [1e9, 0, 0], [1e9, -1e9, 0], [1e9, -1e9, 1e9]]),
}


@pytest.mark.parametrize("name", DEGENERATE)
@every
def test_degenerate_clouds_get_labels(promise: Promise, name: str) -> None:
    points = DEGENERATE[name]
    static = ss.segment_static(points, promise.segmentor)
    check_labels(static, points)
    width = max(5.0, np.ptp(points, axis=0).max() / 9) if len(points) else 5.0
    streamed = quiet(points, promise.segmentor, spans=ss.SpanByWidth(width))
    check_labels(streamed, points)
    if promise.is_identical:
        assert same(static, streamed)


@every_class
def test_the_defaults_can_be_used(method: str) -> None:
    points = houses(3)
    segmentor = CLASSES[method](**NEEDED.get(method, {}))
    check_labels(ss.segment_static(points, segmentor), points)
    check_labels(quiet(points, segmentor), points)


@every
def test_points_without_coordinates_get_no_segment(promise: Promise) -> None:
    points = houses(4)
    valid = np.random.default_rng(0).random(len(points)) > 0.1
    holed = np.where(valid[:, None], points, np.nan)
    with pytest.raises(ss.InvalidInput, match="drop_invalid"):
        ss.segment_static(holed, promise.segmentor)
    labels = ss.segment_static(holed, promise.segmentor, drop_invalid=True)
    check_labels(labels, holed)
    assert np.all(labels[~valid] == -1)
    assert same(labels[valid], ss.segment_static(points[valid], promise.segmentor))


@every
def test_labels_mean_something(promise: Promise) -> None:
    labels = ss.segment_static(houses(5), promise.segmentor)
    assert labels.max() > 1
    assert np.count_nonzero(labels > 0) > len(labels) / 3


def check_labels(labels: NDArray[np.int64], points: Positions) -> None:
    assert labels.dtype == np.int64
    assert labels.shape == (len(points),)
    assert np.all((labels == -1) | (labels >= 1))


@every
def test_threads_and_chunks_change_nothing(promise: Promise) -> None:
    points = houses(6)
    spans = ss.SpanByWidth(4.0)
    first = quiet(points, promise.segmentor, spans=spans, threads=1)
    for threads in (2, 4):
        np.testing.assert_array_equal(quiet(points, promise.segmentor, spans=spans, threads=threads), first)
    for size in (97, 1000):
        chunks = [points[start : start + size] for start in range(0, len(points), size)]
        np.testing.assert_array_equal(quiet(chunks, promise.segmentor, spans=spans), first)  # type: ignore[arg-type]


@order_free
def test_the_order_of_the_points_changes_nothing(promise: Promise) -> None:
    # In general position: the nearest of equally near points are told apart by their number.
    points = houses(7, step=None)
    labels = ss.segment_static(points, promise.segmentor)
    order = np.random.default_rng(1).permutation(len(points))
    assert same(ss.segment_static(points[order], promise.segmentor), labels[order])


@pytest.mark.parametrize("direction", ["x", "y", 30.0])
@every
def test_streamed_is_static(promise: Promise, direction: str | float) -> None:
    for seed, width in [(8, 2.5), (9, 4.0), (10, 7.5)]:
        points = houses(seed)
        static = ss.segment_static(points, promise.segmentor)
        with ss.stream(
            points, promise.segmentor, spans=ss.SpanByWidth(width, direction), result="final", with_points=False
        ) as run:
            labels = np.full(len(points), -1)
            for span in run:
                labels[span.point_ids] = span.segment_ids
        assert run.exactness == promise.exactness
        assert run.is_identical == promise.is_identical
        if run.is_identical:
            assert same(labels, static)
        else:
            agreed = agreement(labels, static)
            print(f"{promise.segmentor}: spans of {width} along {direction}: adjusted Rand index {agreed:.4f}")
            assert agreed > 0.5


@every
def test_an_overlap_below_the_reach_is_warned_of(promise: Promise) -> None:
    points = houses(11)
    if promise.reach is None:
        assert ss.stream(points, promise.segmentor, spans=ss.SpanByWidth(0.2)).warning is None
        return
    with pytest.warns(ss.StreamsegWarning, match=f"overlap by 0.2, less than the distance {promise.reach:g}:"):
        run = ss.stream(points, promise.segmentor, spans=ss.SpanByWidth(0.2))
    assert not run.is_identical


@every
def test_spans_in_stream_order_promise_nothing(promise: Promise) -> None:
    run = ss.stream(houses(12), promise.segmentor, spans=ss.SpanByCount(500))
    assert not run.is_identical
    assert run.exactness == ("A" if promise.exactness == "A" else "C")
