"""The folder of a history: what counts as one, who writes in it, and what is deleted."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import streamseg as ss
from reference import history
from streamseg import history_folder
from streamseg.history_folder import discard, take

NEAR = ss.Proximity(1.0)
POINTS = np.random.default_rng(3).random((50, 3))


def run(folder: Path, *, overwrite: bool = False) -> None:
    list(ss.stream(POINTS, NEAR, history=folder, overwrite=overwrite))


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def note(path: Path, text: str = "my work") -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def with_history(spoil: Callable[[Path], object]) -> Callable[[Path], object]:
    def make(folder: Path) -> None:
        run(folder)
        spoil(folder)

    return make


FOREIGN: dict[str, Callable[[Path], object]] = {
    "a web app": lambda folder: (
        note(folder / "manifest.json", '{"name": "my web app"}'),
        note(folder / "window" / "src" / "mine.js"),
    ),
    "a web app with a version": lambda folder: note(folder / "manifest.json", '{"version": 1, "parts": 0}'),
    "a manifest of another format": lambda folder: note(
        folder / "manifest.json", json.dumps({"format": "their history", "version": 1})
    ),
    "a manifest that is a folder": lambda folder: note(folder / "manifest.json" / "mine"),
    "a note": lambda folder: note(folder / "note.txt"),
    "a note beside a table": lambda folder: (note(folder / "note.txt"), (folder / "window").mkdir()),
    "an unfinished manifest of something": lambda folder: note(folder / "manifest.part"),
    "something in an empty table": lambda folder: note(folder / "window" / "index.html"),
    "a table that is a file": lambda folder: note(folder / "window"),
    "a note in a table": with_history(lambda folder: note(folder / "window" / "note.txt")),
    "a folder in a table": with_history(lambda folder: note(folder / "alias" / "part-000007.parquet" / "mine")),
    "a table that is a link": with_history(
        lambda folder: (
            (folder / "alias").rename(folder / "linked"),
            (folder / "alias").symlink_to(folder / "linked"),
        )
    ),
}


@pytest.mark.parametrize("overwrite", [False, True])
@pytest.mark.parametrize("kind", FOREIGN)
def test_a_folder_that_holds_something_else_is_left_alone(tmp_path: Path, kind: str, overwrite: bool) -> None:
    folder = tmp_path / "folder"
    FOREIGN[kind](folder)
    before = contents(folder)
    with pytest.raises(ss.OutputExists, match=r"is no history|no part of it"):
        ss.stream(POINTS, NEAR, history=folder, overwrite=overwrite)
    assert contents(folder) == before


DAMAGED = {
    "cut": lambda text: text[:100],
    "cut in its first line": lambda text: text[:32],
    "without counts": lambda _: json.dumps({"format": "streamseg history", "version": 1}),
    "without a version": lambda _: json.dumps({"format": "streamseg history"}),
    "with damaged counts": lambda text: text.replace('"points": 50', '"points": -50'),
}


@pytest.mark.parametrize("overwrite", [False, True])
@pytest.mark.parametrize("kind", DAMAGED)
def test_a_history_with_a_damaged_manifest_is_called_so_and_kept(tmp_path: Path, kind: str, overwrite: bool) -> None:
    run(tmp_path / "run")
    path = tmp_path / "run" / "manifest.json"
    path.write_text(DAMAGED[kind](path.read_text()))
    before = contents(tmp_path / "run")
    with pytest.raises(ss.OutputExists, match=r"run has a damaged manifest, manifest\.json; give another folder"):
        run(tmp_path / "run", overwrite=overwrite)
    assert contents(tmp_path / "run") == before


@pytest.mark.parametrize("version", [0, 2, 10**6])
def test_a_history_of_another_version_can_be_overwritten(tmp_path: Path, version: int) -> None:
    run(tmp_path / "run")
    path = tmp_path / "run" / "manifest.json"
    path.write_text(json.dumps({"format": "streamseg history", "version": version, "more": [1]}))
    with pytest.raises(ss.OutputExists, match=r"the history .*run exists; give another folder, or overwrite=True"):
        run(tmp_path / "run")
    run(tmp_path / "run", overwrite=True)
    assert len(history.raw_ids(tmp_path / "run")) == len(POINTS)


def test_a_manifest_that_cannot_be_read_is_not_called_missing(tmp_path: Path) -> None:
    run(tmp_path / "run")
    path = tmp_path / "run" / "manifest.json"
    path.unlink()
    for no_history in (tmp_path / "run", tmp_path / "nothing", tmp_path / "run" / "writing.lock" / "x"):
        with pytest.raises(ss.FileError, match=r"is no history: it has no manifest\.json"):
            ss.History(no_history)
    path.symlink_to(path)
    with pytest.raises(ss.FileError, match=r"manifest\.json cannot be reached: Too many levels of symbolic links"):
        ss.History(tmp_path / "run")


@pytest.mark.parametrize("others", [False, True])
def test_a_run_that_fails_at_once_discards_its_new_history_while_it_holds_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, others: bool
) -> None:
    """Nobody else can have begun there: another run is refused until all is deleted."""
    np.save(tmp_path / "in.npy", np.full((5, 3), np.nan))
    folder, refused = tmp_path / "run", []

    def clear_late(of: Path) -> None:
        clear(of)
        with pytest.raises(ss.OutputExists, match="being written"):
            take(of)
        refused.append(of)
        if others:
            note(of / "note.txt")

    clear = history_folder.clear
    stream_of = ss.files.stream

    def begun(*arguments: Any, **options: Any) -> ss.Stream:
        stream = stream_of(*arguments, **options)
        monkeypatch.setattr(history_folder, "clear", clear_late)
        return stream

    monkeypatch.setattr(ss.files, "stream", begun)
    with pytest.raises(ss.InvalidInput):
        ss.segment_file(tmp_path / "in.npy", tmp_path / "out.npy", NEAR, history=folder)
    assert len(refused) == 1
    assert sorted(contents(tmp_path)) == (["in.npy", "run/note.txt"] if others else ["in.npy"])
    assert folder.exists() == others


@pytest.mark.parametrize("there", [False, True])
def test_what_an_interrupted_run_has_written_is_not_discarded(tmp_path: Path, there: bool) -> None:
    np.save(tmp_path / "in.npy", np.concatenate([POINTS, np.full((5, 3), np.nan)]))
    if there:
        (tmp_path / "run").mkdir()
    options: dict[str, Any] = {"spans": ss.SpanByCount(5), "window": ss.Window(2, 1), "threads": 1}
    with pytest.raises(ss.InvalidInput):
        ss.segment_file(tmp_path / "in.npy", tmp_path / "out.npy", NEAR, history=tmp_path / "run", **options)
    assert ss.History(tmp_path / "run").manifest["points"] == len(np.load(tmp_path / "out.npy")) > 0


def test_overwriting_deletes_only_what_is_of_the_history(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    run(folder)
    for mine in ("note.txt", "more/window/part-000000.parquet", "windows/x"):
        note(folder / mine)
    (folder / "window" / "part-000041.parquet").write_text("of a longer run")
    run(folder, overwrite=True)
    assert len(history.raw_ids(folder)) == len(POINTS)
    assert [path.name for path in (folder / "window").iterdir()] == ["part-000000.parquet"]
    for mine in ("note.txt", "more/window/part-000000.parquet", "windows/x"):
        assert (folder / mine).read_text() == "my work"
    discard(folder, take(folder))
    assert sorted(contents(folder)) == ["more/window/part-000000.parquet", "note.txt", "windows/x"]
    assert not (folder / "window").exists()


BEGUN: dict[str, tuple[Callable[[Path], object], bool]] = {
    # What a run left that was killed before its first manifest, and whether even a run without overwrite may go on.
    "nothing": (lambda folder: folder.mkdir(), True),
    "its lock": (lambda folder: note(folder / "writing.lock", "1"), True),
    "some tables": (lambda folder: [(folder / name).mkdir(parents=True) for name in ("window", "alias")], True),
    "all tables": (lambda folder: [(folder / name).mkdir(parents=True) for name in history.COLUMNS], True),
    "a manifest begun": (
        lambda folder: (
            [(folder / name).mkdir(parents=True) for name in history.COLUMNS],
            note(folder / "manifest.part", "{"),
        ),
        False,
    ),
    "parts": (lambda folder: (run(folder), (folder / "manifest.json").unlink()), False),
}


@pytest.mark.parametrize("kind", BEGUN)
def test_a_run_that_was_killed_early_blocks_nothing(tmp_path: Path, kind: str) -> None:
    make, is_free = BEGUN[kind]
    folder = tmp_path / "run"
    make(folder)
    if not is_free:
        with pytest.raises(ss.OutputExists, match="exists"):
            run(folder)
    run(folder, overwrite=not is_free)
    assert len(history.raw_ids(folder)) == len(POINTS)
    assert sorted(path.name for path in folder.iterdir()) == sorted([*history.COLUMNS, "manifest.json"])


def test_a_history_needs_the_folder_that_it_is_in_as_an_output_does(tmp_path: Path) -> None:
    np.save(tmp_path / "in.npy", POINTS)
    missing = tmp_path / "no"
    for output, past in (("out.npy", missing / "run"), (missing / "out.npy", tmp_path / "run")):
        with pytest.raises(ss.FileError, match=r"the folder .*no does not exist"):
            ss.segment_file(tmp_path / "in.npy", tmp_path / output, NEAR, history=past)
    assert [path.name for path in tmp_path.iterdir()] == ["in.npy"]


WRITING = """
import sys
import numpy as np, streamseg as ss, streamseg.history
streamseg.history._ROWS_PER_PART = 20
def spans():
    for i in range(40):
        if i == 30:
            print("ready", flush=True)
            sys.stdin.readline()
        yield np.column_stack([10.0 * i + np.arange(10), np.zeros((10, 2))])
list(ss.stream(spans(), ss.Proximity(1.5), history=sys.argv[1]))
"""


def begin(folder: Path) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-c", WRITING, str(folder)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stdin=subprocess.PIPE)
    assert process.stdout is not None
    assert process.stdout.readline() == b"ready\n"
    return process


def test_only_one_run_writes_a_history_and_others_may_read_it(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    with begin(folder) as process:
        for overwrite in (False, True):
            with pytest.raises(ss.OutputExists, match=rf"is being written by another run \(process {process.pid}\)"):
                ss.stream(POINTS, NEAR, history=folder, overwrite=overwrite)
        points = np.concatenate([points for points, _ in ss.History(folder).resolve()])
        assert 0 < len(points) < 400
        process.communicate(b"\n")
    assert ss.History(folder).manifest["complete"]
    assert len(history.raw_ids(folder)) == 400
    assert not (folder / "writing.lock").exists()
    run(folder, overwrite=True)


def test_the_lock_of_a_dead_run_holds_nobody(tmp_path: Path) -> None:
    with begin(tmp_path / "run") as process:
        process.send_signal(signal.SIGKILL)
    assert (tmp_path / "run" / "writing.lock").exists()
    run(tmp_path / "run", overwrite=True)
    assert not (tmp_path / "run" / "writing.lock").exists()


def test_a_stream_that_nobody_closed_holds_its_folder_while_it_lives(tmp_path: Path) -> None:
    stream = ss.stream(POINTS, NEAR, history=tmp_path / "run")
    with pytest.raises(ss.OutputExists, match=r"is being written by another run \(of this process\)"):
        run(tmp_path / "run", overwrite=True)
    del stream
    run(tmp_path / "run", overwrite=True)


def test_a_forked_child_neither_writes_a_history_nor_frees_it(tmp_path: Path) -> None:
    stream = ss.stream((POINTS for _ in range(3)), NEAR, history=tmp_path / "run")
    writer = stream._history
    assert writer is not None
    before = contents(tmp_path / "run")
    if (child := os.fork()) == 0:
        try:
            writer.write(None, with_aliases=False)  # type: ignore[arg-type]
        except ss.StreamInUse as error:
            is_told = "open it anew there" in str(error)
        writer.close(complete=True)
        del stream, writer
        os._exit(0 if is_told else 1)
    assert os.waitpid(child, 0)[1] == 0
    assert contents(tmp_path / "run") == before
    with pytest.raises(ss.OutputExists, match="is being written"):
        run(tmp_path / "run", overwrite=True)
    assert sum(len(span) for span in stream) == 150
    assert ss.History(tmp_path / "run").manifest["complete"]


def test_a_child_that_lives_on_does_not_hold_what_its_parent_let_go(tmp_path: Path) -> None:
    stream = ss.stream(POINTS, NEAR, history=tmp_path / "run")
    reading, writing = os.pipe()
    if (child := os.fork()) == 0:
        os.close(writing)
        os.read(reading, 1)
        os._exit(0)
    os.close(reading)
    list(stream)
    run(tmp_path / "run", overwrite=True)
    os.close(writing)
    os.waitpid(child, 0)


def test_folders_without_locks_can_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def unsupported(*_: object) -> None:
        raise OSError(95, "Operation not supported")

    monkeypatch.setattr("fcntl.flock", unsupported)
    for overwrite in (False, True):
        run(tmp_path / "run", overwrite=overwrite)
    np.save(tmp_path / "in.npy", POINTS)
    ss.segment_file(tmp_path / "in.npy", tmp_path / "out.npy", NEAR)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in.npy", "out.npy", "run"]
