"""Damaged histories are refused in one sentence; long parts are read in batches, and huge spans written in parts."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from numpy.typing import NDArray

import streamseg as ss
from reference import history
from streamseg import history_tables
from streamseg.description import describe
from streamseg.history import HistoryWriter

POINTS = np.column_stack([np.arange(800.0) + np.arange(800) // 7 * 3, np.zeros((800, 2))])

# How many times as many damaged histories are tried.
TIMES = int(os.environ.get("STREAMSEG_TORTURE", "1"))


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A history in several parts, and the cloud that it is of."""
    folder = tmp_path_factory.mktemp("sound")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("streamseg.history._ROWS_PER_PART", 300)
        np.save(folder / "in.npy", POINTS)
        spans = ss.SpanByWidth(10.0)
        list(ss.stream(folder / "in.npy", ss.Proximity(1.0), spans=spans, history=folder / "run"))
    assert ss.History(folder / "run").manifest["parts"] > 3
    return folder


@pytest.fixture
def folder(sound: Path, tmp_path: Path) -> Path:
    return shutil.copytree(sound / "run", tmp_path / "run")


def resolved(folder: Path) -> dict[int, int]:
    ids: dict[int, int] = {}
    for points, segments in ss.History(folder).resolve():
        ids.update(zip(points.tolist(), segments.tolist(), strict=True))
    return ids


def part(folder: Path, table: str = "point_segment", number: int = 1) -> Path:
    return folder / table / f"part-{number:06}.parquet"


def change(name: str, values: Any, table: str = "point_segment") -> Callable[[Path], object]:
    """Put other values into a column of a part: an array, or what a function makes of those that are there."""

    def damage(folder: Path) -> None:
        rows = pq.read_table(part(folder, table))
        before = rows[name].to_numpy().copy()
        after = values(before) if callable(values) else values
        at = rows.column_names.index(name)
        pq.write_table(rows.set_column(at, name, pa.array(after)), part(folder, table))

    return damage


def at_first(value: int) -> Callable[[NDArray[np.int64]], NDArray[np.int64]]:
    def changed(values: NDArray[np.int64]) -> NDArray[np.int64]:
        values[0] = value
        return values

    return changed


def manifest(**values: object) -> Callable[[Path], object]:
    def damage(folder: Path) -> None:
        path = folder / "manifest.json"
        path.write_text(json.dumps({**json.loads(path.read_text()), **values}))

    return damage


def raw_manifest(text: str | bytes) -> Callable[[Path], object]:
    def damage(folder: Path) -> None:
        (folder / "manifest.json").write_bytes(text.encode() if isinstance(text, str) else text)

    return damage


def to_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


def double(folder: Path) -> None:
    rows = pq.read_table(part(folder))
    pq.write_table(pa.concat_tables([rows, rows]), part(folder))


# What is the matter, and whether the manifest alone tells, so that `info` refuses it too.
MANIFESTS: dict[str, Callable[[Path], object]] = {
    "nested lists": raw_manifest("[" * 200_000),
    "nested objects": raw_manifest('{"a":' * 200_000),
    "not UTF-8": raw_manifest(b'{"format": "\xff"}'),
    "a number of 10,000 digits": raw_manifest('{"format": "streamseg history", "version": ' + "9" * 10_000 + "}"),
    "a folder": lambda folder: to_folder(folder / "manifest.json"),
    "NaN": manifest(points=float("nan")),
    "Infinity": manifest(parts=float("inf")),
    "a fraction": manifest(points=800.0),
    "true for a count": manifest(parts=True),
    "a negative count": manifest(windows=-1),
    "a huge count": manifest(parts=10**30),
    "true for the version": manifest(version=True),
    "no version": manifest(version=None),
    "another format": manifest(format="their history"),
    "complete in words": manifest(complete="yes"),
    "a source that is a list": manifest(source=["in.npy"]),
    "a promise that is none": manifest(promise=None),
    "parameters that are a list": manifest(parameters=[]),
    "a parameter that is a list": manifest(parameters={"spans": [[[]]]}),
    "causes that are none": manifest(unlabelled=None),
    "a cause with a negative count": manifest(unlabelled={"noise": -1}),
    "a cause with true for a count": manifest(unlabelled={"noise": True}),
    "a cause with a huge count": manifest(unlabelled={"noise": 10**30}),
}

PARTS: dict[str, Callable[[Path], object]] = {
    "null ids": change("point_id", lambda ids: [None, *ids[1:].tolist()]),
    "null segments": change("segment_id", lambda ids: [None] * len(ids)),
    "one point told again and again": change("point_id", lambda ids: np.zeros_like(ids)),
    "one point told twice": change("point_id", lambda ids: at_first(ids[1])(ids)),
    "a point of another part": change("point_id", at_first(0)),
    "a negative point": change("point_id", at_first(-1)),
    "a point beyond the count": change("point_id", at_first(800)),
    "a point far beyond": change("point_id", at_first(2**62)),
    "a segment that is not": change("segment_id", at_first(10**6)),
    "a negative segment": change("segment_id", at_first(-7)),
    "segments as words": change("segment_id", lambda ids: list(map(str, ids.tolist()))),
    "segments as fractions": change("segment_id", lambda ids: ids.astype(float)),
    "segments as unsigned": change("segment_id", lambda ids: ids.astype(np.uint64)),
    "a successor that is not": change("next_segment_id", at_first(10**6), "segment_segment"),
    "a successor that is negative": change("next_segment_id", at_first(-5), "segment_segment"),
    "rows twice": double,
    "rows lost": lambda folder: pq.write_table(pq.read_table(part(folder)).slice(3), part(folder)),
    "a column lost": lambda folder: pq.write_table(pq.read_table(part(folder)).drop_columns("point_id"), part(folder)),
    "a part lost": lambda folder: part(folder, "window").unlink(),
    "a part that is a folder": lambda folder: to_folder(part(folder)),
    "a part of nothing": lambda folder: part(folder).write_bytes(b""),
    "a part of garbage": lambda folder: part(folder).write_bytes(bytes(range(256)) * 40),
    "a table that is a file": lambda folder: (shutil.rmtree(folder / "window"), (folder / "window").touch()),
    "more parts than there are": manifest(parts=2**52),
    "fewer parts than there are": manifest(parts=2),
    "another number of points": manifest(points=799),
    "another number of windows": manifest(windows=1),
    "another number of segments": manifest(segment_ids=2**52),
    "a window of more segments than points": change("segments", at_first(2**40), "window"),
}


@pytest.mark.parametrize("kind", [*MANIFESTS, *PARTS])
def test_every_command_refuses_a_damaged_history(folder: Path, sound: Path, tmp_path: Path, kind: str) -> None:
    is_of_manifest = kind in MANIFESTS
    (MANIFESTS if is_of_manifest else PARTS)[kind](folder)
    before = sorted(tmp_path.iterdir())
    told = []
    if is_of_manifest:
        with pytest.raises(ss.StreamsegError) as info:
            list(describe(folder))
        told.append(info.value)
    with pytest.raises(ss.StreamsegError) as resolving:
        ss.resolve_file(folder, sound / "in.npy", tmp_path / "out.npy")
    told.append(resolving.value)
    for error in told:
        assert "\n" not in str(error)
        assert re.search(
            r"is damaged|is no history|manifest.json cannot be read: Is a directory|of 799 points", str(error)
        ), error
        assert len(str(error)) < 400
    # Values that only resolving looks at can be exported as they are; nothing half-written is left.
    if not refusal(lambda: export(folder, tmp_path / "csv")):
        assert not is_of_manifest
        shutil.rmtree(tmp_path / "csv")
    assert sorted(tmp_path.iterdir()) == before


def test_a_name_that_is_no_text_can_be_described(folder: Path) -> None:
    manifest(source="caf\udce9.laz")(folder)
    assert dict(describe(folder))["history of"] == "caf\\udce9.laz"


def damaged(data: bytes, random: np.random.Generator) -> bytes:
    """Flip bits, put noise in, leave a piece out, or put words of JSON in."""
    at, length = int(random.integers(len(data))), int(random.integers(1, 30))
    kind = random.integers(5)
    if kind == 0:
        return data[:at]
    if kind == 1:
        flipped = bytearray(data)
        for place in random.integers(len(data), size=length % 3 + 1):
            flipped[place] ^= 1 << int(random.integers(8))
        return bytes(flipped)
    if kind == 2:
        return data[:at] + random.bytes(length) + data[at + length :]
    if kind == 3:
        return data[:at] + data[at + length :]
    words = (b"9" * 20, b"-1", b"NaN", b"null", b"[[", b"true", b"\xff")
    return data[:at] + words[length % len(words)] + data[at:]


def test_damage_anywhere_is_told_or_does_no_harm(folder: Path, tmp_path: Path) -> None:
    random = np.random.default_rng(23)
    sound = resolved(folder)
    files = [path for path in sorted(folder.rglob("*")) if path.is_file()]
    refused = 0
    for number in range(300 * TIMES):
        path = folder / "manifest.json" if number % 3 == 0 else files[random.integers(len(files))]
        before = path.read_bytes()
        path.write_bytes(damaged(before, random))
        told = [
            refusal(use)
            for use in (
                lambda: assert_same(resolved(folder), sound),
                lambda: list(describe(folder)),
                lambda: export(folder, tmp_path / "csv"),
            )
        ]
        assert not [sentence for sentence in told if "\n" in sentence], (number, path)
        refused += sum(map(bool, told))
        path.write_bytes(before)
    assert refused > 300 * TIMES


def refusal(use: Callable[[], object]) -> str:
    """The sentence in which something is refused; nothing if it is not."""
    try:
        use()
    except ss.StreamsegError as error:
        return str(error)
    return ""


def assert_same(found: dict[int, int], sound: dict[int, int]) -> None:
    assert found == sound


def export(folder: Path, to: Path) -> None:
    ss.History(folder).to_csv(to, overwrite=True)


@pytest.mark.parametrize("knows_digests", [True, False])
def test_a_history_of_other_points_writes_nothing(folder: Path, tmp_path: Path, knows_digests: bool) -> None:
    """Text does not announce how many points it has."""
    np.savetxt(tmp_path / "fewer.xyz", POINTS[:700], "%g")
    path = folder / "manifest.json"
    manifest = json.loads(path.read_text())
    if not knows_digests:
        del manifest["digests"]
        path.write_text(json.dumps(manifest))
    said = "fewer.xyz has other points than" if knows_digests else r"700 points of .* have labels, of 800"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ss.StreamsegWarning)
        with pytest.raises(ss.InvalidInput, match=said):
            ss.resolve_file(folder, tmp_path / "fewer.xyz", tmp_path / "out.xyz")
    assert not (tmp_path / "out.xyz").exists()


@pytest.mark.parametrize("rows", [1, 7, 100, 10**6])
def test_batches_of_any_size_resolve_to_the_same(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rows: int
) -> None:
    sound = history.final_ids(folder)
    export(folder, tmp_path / "whole")
    monkeypatch.setattr(history_tables, "BATCH_ROWS", rows)
    assert max(len(piece) for part in ss.History(folder).parts() for piece in (part.point_ids, part.raw_ids)) <= rows
    assert resolved(folder) == dict(enumerate(sound.tolist()))
    export(folder, tmp_path / "batches")
    for path in (tmp_path / "whole").iterdir():
        assert path.read_bytes() == (tmp_path / "batches" / path.name).read_bytes()


def crossing() -> Iterator[NDArray[np.float64]]:
    """Spans of many points; segments that have several successors, and points in any order."""
    x = np.random.default_rng(5).permutation(np.arange(3000.0))
    lines = np.column_stack([x % 300, x // 300 * 1.5, x * 0])
    for i in range(4):
        yield lines + np.array([300.0 * i, 0, 0])


@pytest.mark.parametrize("result", ["history", "carry", "final"])
def test_a_span_that_is_larger_than_a_part_takes_several(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, result: Any
) -> None:
    def run(folder: Path) -> dict[int, int]:
        list(ss.stream(crossing(), ss.Proximity(1.2), history=folder, result=result))
        return resolved(folder)

    whole = run(tmp_path / "whole")
    monkeypatch.setattr("streamseg.history._ROWS_PER_PART", 500)
    assert run(tmp_path / "parts") == whole
    assert len(whole) == 12_000
    for table in history.COLUMNS:
        assert np.array_equal(history.table(tmp_path / "parts", table), history.table(tmp_path / "whole", table))
        sizes = [pq.read_metadata(path).num_rows for path in (tmp_path / "parts" / table).iterdir()]
        assert max(sizes) < 1000
        assert len(sizes) == ss.History(tmp_path / "parts").manifest["parts"] > 12


def test_a_run_that_is_killed_within_a_huge_span_leaves_a_history_that_adds_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is on disk after each part is kept as if the run had been killed there."""
    monkeypatch.setattr("streamseg.history._ROWS_PER_PART", 500)
    write_manifest, killed = HistoryWriter._write_manifest, []

    def write_and_copy(writer: HistoryWriter, content: dict[str, Any]) -> None:
        write_manifest(writer, content)
        killed.append(shutil.copytree(writer._folder, tmp_path / f"killed-{len(killed)}"))

    monkeypatch.setattr(HistoryWriter, "_write_manifest", write_and_copy)
    graph = ss.Proximity(1.2, filter="Y > 2")
    unlabelled = ss.stream(crossing(), graph, history=tmp_path / "run", result="carry")
    whole = {}
    with unlabelled as stream:
        for span in stream:
            whole.update(zip(span.point_ids.tolist(), span.segment_ids.tolist(), strict=True))
    within = 0
    for folder in killed:
        past = ss.History(folder)
        ids = resolved(folder)
        assert len(ids) == past.manifest["points"]
        assert past.unlabelled.filtered <= sum(whole[point] < 0 for point in ids)
        assert past.unlabelled.filtered == past.manifest["spans"] * sum(whole[i] < 0 for i in range(3000))
        assert past.manifest["spans"] <= past.manifest["points"] // 3000
        within += past.manifest["points"] % 3000 > 0
    assert within > 12
    assert ss.History(killed[-1]).manifest["spans"] == 4


def test_a_history_without_points_resolves_to_none(tmp_path: Path) -> None:
    stream = ss.stream(iter([np.empty((0, 3))]), ss.Proximity(1.0), history=tmp_path / "run")
    assert resolved(tmp_path / "run") == {}  # before its first part
    list(stream)
    ((points, segments),) = ss.History(tmp_path / "run").resolve()
    assert (len(points), len(segments)) == (0, 0)


def test_a_small_span_stays_in_one_part(folder: Path) -> None:
    spans = [set(pq.read_table(path)["span"].to_pylist()) for path in sorted((folder / "point_segment").iterdir())]
    assert sum(map(len, spans)) == len(set().union(*spans))


def test_point_ids_of_an_early_end_may_be_any_but_not_twice(tmp_path: Path) -> None:
    told = history_tables.PointsSeen(tmp_path, 3, is_whole=False)
    far = 2**40 - 1
    told.add(np.array([far, 5, 2**21, 0]))
    told.add(np.array([], np.int64))
    for twice in (far, 5, 2**21, 0):
        with pytest.raises(ss.InvalidInput, match=rf"tell of point {twice} more than once"):
            told.add(np.array([1 + 2**30, twice]))
        told = told_again(told, tmp_path, far)
    with pytest.raises(ss.InvalidInput, match=r"tell of point 1099511627776, allowed: from 0 to below"):
        told.add(np.array([2**40]))
    told.close()


def told_again(told: history_tables.PointsSeen, folder: Path, far: int) -> history_tables.PointsSeen:
    told.close()
    again = history_tables.PointsSeen(folder, 3, is_whole=False)
    again.add(np.array([far, 5, 2**21, 0]))
    return again


LONG = """
import json, resource, sys
import numpy as np, pyarrow as pa, pyarrow.parquet as pq
import streamseg as ss
folder, rows = sys.argv[1], 1 << int(sys.argv[2])
path = folder + "/point_segment/part-000000.parquet"
if sys.argv[3] == "make":
    list(ss.stream(np.zeros((5, 3)), ss.Proximity(1.0), history=folder))
    same = pa.array(np.ones(rows, np.int64))
    table = pa.table({"point_id": np.arange(rows), "segment_id": same, "span": same})
    pq.write_table(table, path, row_group_size=rows)
    manifest = json.load(open(folder + "/manifest.json"))
    json.dump({**manifest, "points": rows}, open(folder + "/manifest.json", "w"))
else:
    past = ss.History(folder)
    if sys.argv[3] == "resolve":
        assert sum(len(points) for points, _ in past.resolve()) == rows
    else:
        past.to_csv(folder + "-csv")
    print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="the peak is told in other units elsewhere")
@pytest.mark.parametrize("use", ["resolve", "export"])
def test_the_memory_for_a_part_does_not_grow_with_its_rows(tmp_path: Path, use: str) -> None:
    peaks = {}
    for power in (22, 24):
        for what in ("make", use):
            command = [sys.executable, "-c", LONG, str(tmp_path / f"run{power}"), str(power), what]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            assert done.returncode == 0, done.stderr
        peaks[power] = int(done.stdout) / 1024
    # 12 million rows more, of 24 bytes each, are 288 MB.
    assert peaks[24] < peaks[22] + 60
