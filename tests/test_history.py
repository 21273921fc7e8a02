"""The history on disk: what its manifest says, what is left of a run that ended early, and what damage is called."""

from __future__ import annotations

import json
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow
import pyarrow.parquet
import pytest
from numpy.typing import NDArray

import streamseg as ss
from reference import history


def arms(length: int = 400) -> NDArray[np.float64]:
    """A U on its side and single points beside it."""
    x = np.arange(length, dtype=float)
    low, high = np.column_stack([x, 0 * x, 0 * x]), np.column_stack([x, 0 * x + 8, 0 * x])
    bottom = np.column_stack([np.full(9, length), np.arange(9.0), np.zeros(9)])
    beside = np.column_stack([x, 0 * x + 20, x % 2 * 5])
    return np.concatenate([low, high, bottom, beside])


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A history in several parts."""
    monkeypatch.setattr("streamseg.history._ROWS_PER_PART", 300)
    folder = tmp_path / "run"
    list(ss.stream(arms(), ss.Proximity(1.0), spans=ss.SpanByWidth(10.0), history=folder))
    assert ss.History(folder).manifest["parts"] > 3
    return folder


def resolve(folder: Path) -> NDArray[np.int64]:
    parts = list(ss.History(folder).resolve())
    points = np.concatenate([points for points, _ in parts])
    return np.concatenate([segments for _, segments in parts])[np.argsort(points)]


def test_a_history_in_parts_resolves_as_a_whole(folder: Path) -> None:
    final = resolve(folder)
    assert np.array_equal(final, history.final_ids(folder))
    assert np.array_equal(final, ss.segment(arms(), ss.Proximity(1.0), spans=ss.SpanByWidth(10.0)))
    assert np.all(final[:809] == 1)


def test_the_manifest_tells_the_truth(tmp_path: Path, data: Path) -> None:
    path = data / "als" / "mixed_conifer.laz"
    spans, window = ss.SpanByWidth(9.0, "y"), ss.Window(4, 2)
    with ss.stream(path, ss.Proximity(1.0), spans=spans, window=window, history=tmp_path / "run") as run:
        assert ss.History(tmp_path / "run").manifest["complete"] is False
        count = sum(1 for _ in run)
    past = ss.History(str(tmp_path / "run"))
    points = history.table(past.folder, "point_segment")
    windows = history.table(past.folder, "window")
    segments = history.table(past.folder, "segment_segment")
    (digest,) = past.manifest.pop("digests")
    assert re.fullmatch("37657:[0-9a-f]{8}", digest)
    assert past.manifest == {
        "format": "streamseg history",
        "version": 1,
        "source": str(path),
        "parameters": {
            "segmentor": repr(ss.Proximity(1.0)),
            "spans": repr(spans),
            "window": repr(window),
            "min_segment_size": 1,
            "max_segment_size": None,
            "sort": "native",
        },
        "promise": run.promise,
        "certificate": run.certificate._asdict(),
        "complete": True,
        "points": 37_657,
        "spans": count,
        "windows": run.progress.windows,
        "segment_ids": run.progress.segment_ids,
        "late_joins": 0,
        "parts": 1,
        "unlabelled": ss.Unlabelled()._asdict(),
    }
    assert len(points) == 37_657
    assert points[:, 2].max() + 1 == count
    assert len(windows) == past.manifest["windows"]
    assert np.array_equal(np.unique(segments[:, 0]), np.arange(1, past.manifest["segment_ids"] + 1))


def test_default_spans_are_in_the_manifest(tmp_path: Path) -> None:
    list(ss.stream(arms(), ss.Proximity(1.0), history=tmp_path / "run"))
    parameters = ss.History(tmp_path / "run").manifest["parameters"]
    assert parameters["spans"] == repr(ss.SpanByWidth(20.0))
    assert parameters["window"] == repr(ss.Window(3, 1))


def test_parquet_is_readable_by_pyarrow_as_it_is(folder: Path) -> None:
    for name, columns in history.COLUMNS.items():
        table = pyarrow.parquet.read_table(folder / name)
        assert tuple(table.column_names) == columns
        assert {str(column.type) for column in table.columns} == {"int64"}


def test_what_is_there_is_not_overwritten_unless_asked_for(folder: Path, tmp_path: Path) -> None:
    before = history.raw_ids(folder)
    with pytest.raises(ss.OutputExists, match=r"exists; give another folder, or .*overwrite=True"):
        ss.stream(arms(5), ss.Proximity(1.0), history=folder)
    assert np.array_equal(history.raw_ids(folder), before)
    list(ss.stream(arms(5), ss.Proximity(1.0), history=folder, overwrite=True))
    assert np.array_equal(resolve(folder), ss.segment(arms(5), ss.Proximity(1.0)))
    assert ss.History(folder).manifest["points"] == len(arms(5))


@pytest.mark.parametrize("overwrite", [False, True])
def test_a_folder_that_is_something_else_is_left_alone(tmp_path: Path, overwrite: bool) -> None:
    thesis = tmp_path / "thesis" / "chapter.txt"
    thesis.parent.mkdir()
    thesis.write_text("years of work")
    for place in (thesis.parent, thesis):
        with pytest.raises(ss.OutputExists, match="exists and is no history"):
            ss.stream(arms(5), ss.Proximity(1.0), history=place, overwrite=overwrite)
    assert thesis.read_text() == "years of work"


def test_a_failed_set_up_leaves_the_old_history_alone(folder: Path) -> None:
    before = history.raw_ids(folder)
    with pytest.raises(ss.InvalidParameter):
        ss.stream(arms(5), ss.Proximity(1.0), history=folder, overwrite=True, threads=0)
    with pytest.raises(ss.FileError):
        ss.stream("nowhere.laz", ss.Proximity(1.0), history=folder, overwrite=True)
    assert np.array_equal(history.raw_ids(folder), before)


ENDLESS = """
import itertools, sys
import numpy as np, streamseg as ss, streamseg.history
streamseg.history._ROWS_PER_PART = 300
spans = (np.column_stack([10.0 * i + np.arange(10), np.zeros((10, 2))]) for i in itertools.count())
for span in ss.stream(spans, ss.Proximity(1.5), history=sys.argv[1]):
    if span.index == 200:
        print("ready", flush=True)
"""


def test_a_run_that_is_killed_leaves_all_but_the_part_under_way(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    with subprocess.Popen([sys.executable, "-c", ENDLESS, str(folder)], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"ready\n"
        process.send_signal(signal.SIGKILL)
    past = ss.History(folder)
    assert past.manifest["complete"] is False
    assert past.manifest["parts"] >= 5
    points = np.concatenate([points for points, _ in past.resolve()])
    assert len(points) >= 2000 - 300
    assert np.array_equal(points, np.arange(len(points)))
    assert all(np.all(segments == 1) for _, segments in past.resolve())


def test_what_has_to_be_installed_is_told_wherever_parquet_is_needed(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    for needs in (
        lambda: ss.History(folder).to_csv(tmp_path / "csv"),
        lambda: list(ss.History(folder).resolve()),
        lambda: ss.stream(np.zeros((3, 3)), ss.Proximity(1.0), history=tmp_path / "more"),
    ):
        with pytest.raises(ss.MissingExtra, match=r"pip install 'streamseg\[history\]'"):
            needs()
    assert not (tmp_path / "more").exists()


def spoil_manifest(text: str) -> Callable[[Path], object]:
    return lambda folder: (folder / "manifest.json").write_text(text)


def change_manifest(**values: object) -> Callable[[Path], object]:
    def change(folder: Path) -> None:
        manifest = json.loads((folder / "manifest.json").read_text())
        manifest.update(values)
        manifest = {key: value for key, value in manifest.items() if value is not None}
        (folder / "manifest.json").write_text(json.dumps(manifest))

    return change


def part(folder: Path, table: str, number: int) -> Path:
    return folder / table / f"part-{number:06}.parquet"


def truncate(folder: Path) -> None:
    path = part(folder, "point_segment", 2)
    path.write_bytes(path.read_bytes()[:-40])


def replace_part(table: pyarrow.Table) -> Callable[[Path], object]:
    return lambda folder: pyarrow.parquet.write_table(table, part(folder, "point_segment", 1))


DAMAGE: dict[str, tuple[Callable[[Path], object], type[ss.StreamsegError], str]] = {
    "no folder": (shutil.rmtree, ss.FileError, "is no history: it has no manifest.json"),
    "no manifest": (lambda folder: (folder / "manifest.json").unlink(), ss.FileError, "is no history"),
    "empty manifest": (spoil_manifest(""), ss.InvalidInput, "manifest.json is damaged"),
    "manifest of something else": (spoil_manifest("[1, 2]"), ss.InvalidInput, "manifest.json is damaged"),
    "manifest without a version": (spoil_manifest("{}"), ss.InvalidInput, "manifest.json is damaged"),
    "manifest that is no text": (
        lambda folder: (folder / "manifest.json").write_bytes(b"\xff\xfe\x00\x01"),
        ss.InvalidInput,
        "manifest.json is damaged",
    ),
    "newer version": (change_manifest(version=2), ss.InvalidInput, "has format version 2, this version reads 1"),
    "no number of parts": (change_manifest(parts=None), ss.InvalidInput, "manifest.json is damaged"),
    "no number of ids": (change_manifest(segment_ids=None), ss.InvalidInput, "manifest.json is damaged"),
    "no parameters": (change_manifest(parameters=None), ss.InvalidInput, "manifest.json is damaged"),
    "limits in words": (
        change_manifest(parameters={"min_segment_size": "three", "max_segment_size": None, "sort": "native"}),
        ss.InvalidInput,
        r"manifest\.json is damaged: its limits of size are \('three', None, 'native'\)",
    ),
    "limits that cannot be": (
        change_manifest(parameters={"min_segment_size": 5, "max_segment_size": 4, "sort": "native"}),
        ss.InvalidInput,
        r"manifest\.json is damaged: its limits of size are \(5, 4, 'native'\)",
    ),
    "parts in words": (change_manifest(parts="three"), ss.InvalidInput, "manifest.json is damaged"),
    "fewer ids than there are": (change_manifest(segment_ids=2), ss.StreamsegError, "the history is damaged"),
    "more parts than there are": (change_manifest(parts=99), ss.FileError, "cannot be read, the history is damaged"),
    "a part is missing": (
        lambda folder: part(folder, "segment_segment", 1).unlink(),
        ss.FileError,
        r"part-000001\.parquet cannot be read, the history is damaged",
    ),
    "a part is cut off": (truncate, ss.FileError, r"part-000002\.parquet cannot be read, the history is damaged"),
    "a part is something else": (
        lambda folder: part(folder, "point_segment", 0).write_text("hello"),
        ss.FileError,
        "cannot be read, the history is damaged",
    ),
    "a part has lost its rows": (
        replace_part(pyarrow.table({name: np.empty(0, np.int64) for name in history.COLUMNS["point_segment"]})),
        ss.StreamsegError,
        "the history is damaged",
    ),
    "a part has other columns": (
        replace_part(pyarrow.table({"a": [1], "b": [2]})),
        ss.StreamsegError,
        "the history is damaged",
    ),
    "a part has other types": (
        replace_part(pyarrow.table({"point_id": ["x"], "segment_id": [1.5], "span": [0]})),
        ss.StreamsegError,
        "the history is damaged",
    ),
}


@pytest.mark.parametrize("kind", DAMAGE)
def test_damage_has_a_name(folder: Path, kind: str) -> None:
    damage, error, message = DAMAGE[kind]
    damage(folder)
    with pytest.raises(error, match=message):
        resolve(folder)


def test_two_parts_that_changed_places_resolve_to_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("streamseg.history._ROWS_PER_PART", 100)
    # Heaps in a row, none longer than a window, so that segments go out of scope all the time.
    x = np.arange(800.0) + np.arange(800) // 7 * 3
    heaps = np.column_stack([x, np.zeros((800, 2))])
    list(ss.stream(heaps, ss.Proximity(1.0), spans=ss.SpanByWidth(10.0), history=tmp_path / "run"))
    folder = tmp_path / "run"
    final = resolve(folder)
    for second in range(1, ss.History(folder).manifest["parts"]):
        paths = [(part(folder, table, 0), part(folder, table, second)) for table in history.COLUMNS]
        for a, b in paths:
            exchange(a, b)
        assert np.array_equal(resolve(folder), final)
        for a, b in paths:
            exchange(a, b)


def exchange(a: Path, b: Path) -> None:
    waiting = a.rename(a.with_suffix(".waiting"))
    b.rename(a)
    waiting.rename(b)


def test_a_history_that_cannot_be_closed_costs_no_labels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise ss.FileError("the disk is full")

    np.save(tmp_path / "in.npy", np.arange(30.0).reshape(-1, 3))
    monkeypatch.setattr("streamseg.history.HistoryWriter.close", fail)
    for result in ("final", "carry", "history"):
        output = tmp_path / f"{result}.npy"
        with pytest.raises(ss.FileError, match=r"^the disk is full$"):
            ss.segment_file(tmp_path / "in.npy", output, ss.Proximity(9.0), history=tmp_path / result, result=result)
        assert np.load(output).tolist() == [1] * 10


@pytest.mark.parametrize("history", ["out.npy", ".", "../run", "past"])
def test_the_output_is_no_part_of_the_history(tmp_path: Path, history: str) -> None:
    folder = tmp_path / "run"
    (folder / "past").mkdir(parents=True)
    np.save(folder / "in.npy", np.zeros((5, 3)))
    output = folder / "past" / "out.npy" if history == "past" else folder / "out.npy"
    with pytest.raises(ss.InvalidParameter, match=r"^history is .*, allowed: a folder that the output .* is not in$"):
        ss.segment_file(folder / "in.npy", output, ss.Proximity(1.0), history=folder / history)
    assert not output.exists()
    assert sorted(path.name for path in folder.iterdir()) == ["in.npy", "past"]
