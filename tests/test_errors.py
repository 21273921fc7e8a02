"""Everything that can be given wrongly: which exception, and whether it names the value given and the value allowed."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import streamseg as ss
from streamseg.source import open_source

POINTS = np.column_stack([np.arange(50.0), np.zeros((50, 2))])
NEAR = ss.Proximity(1.5)

Call = Callable[[], object]

PARAMETERS: dict[str, tuple[Call, str]] = {
    "distance 0": (lambda: ss.Proximity(0), "distance is 0, allowed: a finite number above 0"),
    "distance negative": (lambda: ss.Proximity(-2.5), "distance is -2.5, allowed: a finite number above 0"),
    "distance NaN": (lambda: ss.Proximity(float("nan")), "distance is NaN, allowed: a finite number above 0"),
    "distance inf": (lambda: ss.Proximity(float("inf")), "distance is inf, allowed: a finite number above 0"),
    "metric": (lambda: ss.Proximity(1.0, metric="xz"), "metric is 'xz', allowed: 'xyz' or 'xy'"),
    "graph": (lambda: ss.Proximity(1.0, graph="knn"), "graph is 'knn', allowed: 'delaunay' or 'radius'"),
    "width 0": (lambda: ss.SpanByWidth(0.0), "width is 0, allowed: a finite number above 0"),
    "width negative": (lambda: ss.SpanByWidth(-5.0), "width is -5, allowed: a finite number above 0"),
    "width NaN": (lambda: ss.SpanByWidth(float("nan")), "width is NaN, allowed: a finite number above 0"),
    "width inf": (lambda: ss.SpanByWidth(float("inf")), "width is inf, allowed: a finite number above 0"),
    "direction": (lambda: ss.SpanByWidth(1.0, "z"), "direction is 'z', allowed: 'x', 'y' or an azimuth in degrees"),
    "direction of a list": (
        lambda: ss.SpanByWidth(1.0, [1, 0]),
        r"direction is \[1, 0\], allowed: 'x', 'y' or an azim",
    ),
    "direction NaN": (lambda: ss.SpanByWidth(1.0, float("nan")), "direction is NaN, allowed: 'x', 'y' or an azimuth"),
    "count 0": (lambda: ss.SpanByCount(0), "points is 0, allowed: a whole number of at least 1"),
    "count negative": (lambda: ss.SpanByCount(-3), "points is -3, allowed: a whole number of at least 1"),
    "seconds 0": (lambda: ss.SpanByTime(0), "seconds is 0, allowed: a finite number above 0"),
    "seconds NaN": (lambda: ss.SpanByTime(float("nan")), "seconds is NaN, allowed: a finite number above 0"),
    "lines 0": (lambda: ss.SpanByScanLine(0), "lines is 0, allowed: a whole number of at least 1"),
    "lines negative": (lambda: ss.SpanByScanLine(-1), "lines is -1, allowed: a whole number of at least 1"),
    "window of no spans": (lambda: ss.Window(0, 0), "spans is 0, allowed: a whole number of at least 1"),
    "window of fewer": (lambda: ss.Window(-1), "spans is -1, allowed: a whole number of at least 1"),
    "overlap all": (lambda: ss.Window(3, 3), "overlap is 3 of 3 spans, allowed: fewer spans than the window has"),
    "overlap more": (lambda: ss.Window(3, 7), "overlap is 7 of 3 spans, allowed: fewer spans than the window has"),
    "overlap negative": (lambda: ss.Window(3, -1), "overlap is -1, allowed: a whole number of at least 0"),
    "threads 0": (lambda: ss.segment(POINTS, NEAR, threads=0), "threads is 0, allowed: a whole number of at least 1"),
    "threads negative": (lambda: ss.stream(POINTS, NEAR, threads=-2), "threads is -2, allowed: a whole number of at"),
    "result": (
        lambda: ss.stream(POINTS, NEAR, result="raw"),  # type: ignore[arg-type]
        "result is 'raw', allowed: 'history', 'carry', 'final'",
    ),
    "spans": (
        lambda: ss.stream(POINTS, NEAR, spans=50.0),  # type: ignore[arg-type]
        "spans is 50.0, allowed: 'auto', SpanByWidth, SpanByCount, SpanByTime, SpanByScanLine or a Plan",
    ),
    "spans of a class": (
        lambda: ss.stream(POINTS, NEAR, spans=ss.SpanByCount),  # type: ignore[arg-type]
        "spans is <class 'streamseg.SpanByCount'>, allowed: 'auto', SpanByWidth, SpanByCount, SpanByTime, "
        "SpanByScanLine or a Plan",
    ),
}


@pytest.mark.parametrize("name", PARAMETERS)
def test_parameters_out_of_range(name: str) -> None:
    call, message = PARAMETERS[name]
    with pytest.raises(ss.InvalidParameter, match=f"^{message}") as caught:
        call()
    assert isinstance(caught.value, (ss.StreamsegError, ValueError))


@pytest.mark.parametrize(
    "call",
    [
        lambda: ss.Proximity("far"),  # type: ignore[arg-type]
        lambda: ss.Proximity(),  # type: ignore[call-arg]
        lambda: ss.Proximity(1.0, d=3),  # type: ignore[call-arg]
        lambda: ss.SpanByCount(2.5),  # type: ignore[arg-type]
        lambda: ss.stream(POINTS, NEAR, window=3),  # type: ignore[arg-type]
        lambda: ss.stream(POINTS, NEAR, width=3),  # type: ignore[call-arg]
    ],
)
def test_arguments_of_a_wrong_type_are_a_type_error_at_once(call: Call) -> None:
    with pytest.raises(TypeError):
        call()


def generator(*items: Any) -> Iterator[Any]:
    yield from items


SOURCES: dict[str, tuple[Call, str]] = {
    "a number": (lambda: 5, "source is int, allowed: a path, several paths, an .n, 3. array, or an iterable of arrays"),
    "None": (lambda: None, "source is NoneType, allowed: a path, several paths"),
    "bytes": (lambda: b"cloud.laz", "allowed|expected"),
    "two columns": (lambda: np.zeros((7, 2)), r"points has shape \(7, 2\), expected \(n, 3\): x, y and z"),
    "four columns": (lambda: np.zeros((7, 4)), r"points has shape \(7, 4\), expected \(n, 3\)"),
    "transposed": (lambda: np.zeros((3, 7)), r"points has shape \(3, 7\), expected \(n, 3\)"),
    "one point flat": (lambda: np.zeros(3), r"points has shape \(3,\), expected \(n, 3\)"),
    "a stack": (lambda: np.zeros((2, 4, 3)), r"points has shape \(2, 4, 3\), expected \(n, 3\)"),
    "ragged list": (lambda: [[1, 2, 3], [1, 2]], r"expected (shape )?\(n, 3\)"),
    "words": (lambda: [["a", "b", "c"]], r"no array of numbers .*, expected shape \(n, 3\)"),
    "array of words": (lambda: np.array([["a", "b", "c"]]), r"no array of numbers .*, expected shape \(n, 3\)"),
    "objects": (lambda: np.array([[{}, 1, 2]], object), r"no array of numbers .*, expected shape \(n, 3\)"),
    "complex": (lambda: np.array([[1 + 2j, 0, 0]]), r"no array of numbers .*, expected shape \(n, 3\)"),
    "records": (lambda: np.zeros(4, "f8, f8, f8"), r"points has shape \(4,\), expected \(n, 3\)"),
    "live two columns": (lambda: generator(POINTS, np.zeros((7, 2))), r"points has shape \(7, 2\), expected \(n, 3\)"),
    "live flat": (lambda: generator(POINTS, np.zeros(3)), r"points has shape \(3,\), expected \(n, 3\)"),
    "live None": (lambda: generator(POINTS, None), r"expected (shape )?\(n, 3\)"),
    "live numbers": (lambda: generator(1.0, 2.0, 3.0), r"expected (shape )?\(n, 3\)"),
    "live words": (lambda: generator("abc"), r"no array of numbers .*, expected shape \(n, 3\)"),
    "a path among arrays": (lambda: ["a.laz", POINTS], r"no array of numbers .*, expected shape \(n, 3\)"),
    "a mapping": (lambda: {"x": POINTS[:, 0]}, r"no array of numbers .*, expected shape \(n, 3\)"),
}


@pytest.mark.parametrize("name", SOURCES)
def test_sources_that_are_no_points(name: str) -> None:
    make, message = SOURCES[name]
    for call in (ss.segment, ss.segment_static, lambda *given: list(ss.stream(*given))):
        with pytest.raises(ss.InvalidInput, match=message) as caught:
            call(make(), NEAR)
        assert isinstance(caught.value, ValueError)


FILES: dict[str, tuple[str, bytes | None, type[Exception], str]] = {
    "missing": ("nowhere.laz", None, ss.FileError, "nowhere.laz does not exist"),
    "empty": ("empty.laz", b"", ss.FileError, "empty.laz"),
    "not what it says": ("photo.las", b"\x89PNG\r\n\x1a\n" + bytes(500), ss.FileError, "photo.las"),
    "unknown": (
        "cloud.e57",
        b"ASTM-E57",
        ss.InvalidInput,
        "cloud.e57 ends in '.e57', which is not known; known are .las",
    ),
}


@pytest.mark.parametrize("name", FILES)
def test_files_that_are_no_clouds(tmp_path: Path, name: str) -> None:
    file, content, kind, message = FILES[name]
    if content is not None:
        (tmp_path / file).write_bytes(content)
    for source in (tmp_path / file, [str(tmp_path / file)]):
        with pytest.raises(kind, match=message) as caught:
            ss.segment(source, NEAR)
        assert isinstance(caught.value, OSError if kind is ss.FileError else ValueError)


BAD = [float("nan"), float("inf"), float("-inf"), 1e61]


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("bad", BAD, ids=str)
def test_the_first_point_that_is_not_finite_is_named(bad: float, axis: int) -> None:
    points = POINTS.copy()
    points[[37, 41], axis] = bad
    for call in (ss.segment, ss.segment_static):
        with pytest.raises(ss.InvalidInput, match=r"^point 37 has the coordinates \(.*\), which are not fin"):
            call(points, NEAR)


def note_points(spans: Iterator[ss.Span], points: list[int]) -> None:
    for span in spans:
        points += span.point_ids.tolist()


@pytest.mark.parametrize("spans", [None, ss.SpanByCount(4), ss.SpanByWidth(5.0)], ids=repr)
@pytest.mark.parametrize("threads", [1, 2])
def test_a_bad_point_in_a_later_chunk_is_named_by_its_place_in_the_stream(spans: Any, threads: int) -> None:
    bad = POINTS[20:30].copy()
    bad[4, 2] = np.nan
    chunks = generator(POINTS[:10], POINTS[10:20], bad, POINTS[30:])
    taken: list[int] = []
    run = ss.stream(chunks, NEAR, spans=spans, threads=threads)
    with pytest.raises(ss.InvalidInput, match=r"^point 24 has the coordinates \(24, 0, NaN\)"):
        note_points(run, taken)
    # All points before it are finished output.
    assert taken == list(range(24))


@pytest.mark.parametrize("bad", BAD, ids=str)
@pytest.mark.parametrize("spans", [ss.SpanByCount(7), ss.SpanByWidth(4.0), ss.SpanByWidth(4.0, 30.0)], ids=repr)
def test_dropped_points_come_out_in_their_place_with_no_segment(bad: float, spans: Any) -> None:
    points = POINTS.copy()
    dropped = [0, 13, 14, 49]
    points[dropped, [0, 1, 2, 0]] = bad
    points[30:] += 5
    for labels in (
        ss.segment(points, NEAR, spans=spans, drop_invalid=True),
        ss.segment_static(points, NEAR, drop_invalid=True),
    ):
        # 12 and 15 are 3 apart with nothing in between, 29 and 30 are 8.7.
        groups = [labels[1:13], labels[15:30], labels[30:49]]
        assert np.flatnonzero(labels == -1).tolist() == dropped
        assert [len(np.unique(group)) for group in groups] == [1, 1, 1]
        assert len(np.unique(labels)) == 4


def test_nothing_but_invalid_points() -> None:
    points = np.full((9, 3), np.nan)
    assert ss.segment(points, NEAR, drop_invalid=True).tolist() == [-1] * 9
    assert ss.segment_static(points, NEAR, drop_invalid=True).tolist() == [-1] * 9
    with pytest.raises(ss.InvalidInput, match=r"^point 0 has the coordinates \(NaN, NaN, NaN\)"):
        ss.segment(points, NEAR)


def test_a_live_source_that_goes_back_is_refused_by_width_and_named() -> None:
    chunks = generator(POINTS[:20], POINTS[[20, 21, 5, 22]], POINTS[23:])
    message = r"^point 22 goes back along the direction of the spans, from slab 4 to slab 1; a live source has"
    with pytest.raises(ss.InvalidInput, match=message):
        ss.segment(chunks, NEAR, spans=ss.SpanByWidth(5.0))
    stored = [POINTS[:20], POINTS[[20, 21, 5, 22]], POINTS[23:]]
    assert np.all(ss.segment(stored, NEAR, spans=ss.SpanByWidth(5.0)) == 1)


ATTRIBUTES: dict[str, tuple[Call, str]] = {
    "array, none": (
        lambda: ss.segment(POINTS, NEAR, spans=ss.SpanByTime(1.0)),
        r"^the attribute 'gps_time' is needed .*, given: none",
    ),
    "array, another": (
        lambda: ss.segment(POINTS, NEAR, spans=ss.SpanByTime(1.0), attributes={"time": np.zeros(50)}),
        r"the attribute 'gps_time' is needed .*, given: time",
    ),
    "array, too few": (
        lambda: ss.segment(POINTS, NEAR, spans=ss.SpanByTime(1.0), attributes={"gps_time": np.zeros(49)}),
        r"^gps_time has shape \(49,\), expected \(50,\): one value per point",
    ),
    "array, words": (
        lambda: ss.segment(POINTS, NEAR, spans=ss.SpanByTime(1.0), attributes={"gps_time": ["noon"] * 50}),
        r"^gps_time .*number",
    ),
    "scan lines, one of two": (
        lambda: ss.segment(POINTS, NEAR, spans=ss.SpanByScanLine(1), attributes={"scan_direction_flag": np.zeros(50)}),
        r"^the attribute 'edge_of_flight_line' is needed .*, given: scan_direction_flag",
    ),
    "live, none": (
        lambda: ss.segment(generator(POINTS), NEAR, spans=ss.SpanByTime(1.0)),
        r"the attribute 'gps_time' is needed .*, given: none",
    ),
    "live, too few": (
        lambda: ss.segment(generator((POINTS, {"gps_time": np.zeros(3)})), NEAR, spans=ss.SpanByTime(1.0)),
        r"^gps_time has shape \(3,\), expected \(50,\)",
    ),
}


@pytest.mark.parametrize("name", ATTRIBUTES)
def test_attributes_that_the_spans_need(name: str) -> None:
    call, message = ATTRIBUTES[name]
    with pytest.raises(ss.InvalidInput, match=message):
        call()


def test_a_file_without_the_time_that_the_spans_need(data: Path) -> None:
    message = r"CSite3.laz has no dimension 'gps_time'; there are: "
    with pytest.raises(ss.InvalidInput, match=message):
        ss.segment(data / "isprs" / "CSite3.laz", NEAR, spans=ss.SpanByTime(1.0))


def test_times_that_are_not_numbers_do_not_make_an_endless_span() -> None:
    time = np.arange(50.0)
    time[20::10] = np.nan
    run = ss.stream(POINTS, NEAR, spans=ss.SpanByTime(5.0), attributes={"gps_time": time})
    came = []
    with pytest.raises(ss.InvalidInput, match=r"^gps_time of point 20 is NaN, expected a finite number"):
        came.extend(len(span) for span in run)
    assert sum(came) == 20


@pytest.mark.parametrize("name", ["file/run", "x" * 300], ids=["below a file", "too long name"])
def test_a_history_that_cannot_be_made(tmp_path: Path, name: str) -> None:
    (tmp_path / "file").write_text("a file")
    with pytest.raises(ss.FileError, match=r"^the history .* cannot be made: |/x+ cannot be reached: ") as caught:
        ss.stream(POINTS, NEAR, history=tmp_path / name)
    assert isinstance(caught.value, OSError)


def test_every_error_derives_from_the_root_and_from_what_people_expect() -> None:
    expected = {
        ss.InvalidInput: ValueError,
        ss.InvalidParameter: ValueError,
        ss.InvalidType: TypeError,
        ss.SegmentorError: ValueError,
        ss.FileError: OSError,
        ss.OutputExists: FileExistsError,
        ss.MissingExtra: ImportError,
        ss.StreamInUse: RuntimeError,
    }
    errors = [thing for thing in vars(ss).values() if isinstance(thing, type) and issubclass(thing, ss.StreamsegError)]
    assert set(errors) == {ss.StreamsegError, *expected}
    assert all(issubclass(error, builtin) for error, builtin in expected.items())


def test_ids_that_are_no_ids_cannot_be_resolved() -> None:
    run = ss.stream(POINTS, NEAR)
    list(run)
    for ids in ([1.7], [[1, 2]], ["one"]):
        with pytest.raises((TypeError, ValueError)):
            run.resolve(ids)


def test_failures_come_once_and_then_the_stream_has_ended() -> None:
    bad = POINTS.copy()
    bad[30] = np.inf
    run = ss.stream(bad, NEAR, spans=ss.SpanByCount(5), result="final")
    taken: list[int] = []
    with pytest.raises(ss.InvalidInput):
        note_points(run, taken)
    assert taken == list(range(30))
    assert [list(run), list(run)] == [[], []]


@pytest.mark.parametrize(
    ("options", "error"),
    [
        ({"threads": "2"}, ss.InvalidType),
        ({"threads": 0}, ss.InvalidParameter),
        ({"threads": 5000}, ss.InvalidParameter),
        ({"spans": 3}, ss.InvalidParameter),
        ({"window": 3}, ss.InvalidType),
        ({"revisit": "yes"}, ss.InvalidType),
        ({"result": "carry", "sort": "ascending"}, ss.InvalidParameter),
        ({"history": "."}, ss.OutputExists),
    ],
    ids=str,
)
@pytest.mark.parametrize("more", [{"spans": "auto"}, {"revisit": True, "spans": ss.SpanByCount(3)}, {}], ids=str)
def test_what_cannot_be_is_refused_before_the_cloud_is_read(
    options: dict[str, Any],
    error: type[Exception],
    more: dict[str, Any],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "something").touch()
    asked = {**more, **options}
    segmentor = ss.Dbscan(1.0, sort=asked.pop("sort", "native"))
    source = open_source(POINTS)

    def chunks(names: Sequence[str]) -> Iterator[Any]:
        raise AssertionError("it was read")

    with pytest.raises(error):
        ss.stream(source._replace(chunks=chunks), segmentor, **asked)
