"""The spool of segment ids against a dictionary, and files that appear complete or not at all."""

from __future__ import annotations

import errno
import os
import shutil
import subprocess
import sys
import tempfile
import tracemalloc
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import streamseg as ss
from streamseg.errors import (
    FileError,
    InvalidInput,
    InvalidParameter,
    OutputExists,
    StreamsegError,
    StreamsegWarning,
)
from streamseg.io import LabelSpool, check_output, labels, open_cloud, write_labelled
from streamseg.io.text_sink import IdSink

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

POINT_ID = st.one_of(
    st.integers(0, 40), st.integers((1 << 20) - 20, (1 << 20) + 20), st.integers(5 << 20, (5 << 20) + 5)
)
PAIRS = st.lists(st.tuples(POINT_ID, st.integers(-1, 2**62)), max_size=30)


class Ones:
    def read(self, start: int, stop: int) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        return np.ones(stop - start, np.int64), np.ones(stop - start, np.bool_)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.one_of(PAIRS, POINT_ID), max_size=8), st.integers(1, 50))
def test_the_spool_behaves_like_a_dictionary(steps: list[Any], buffered: int) -> None:
    """A list of pairs is added; a number asks for the range that starts there."""
    expected: dict[int, int] = {}
    with pytest.MonkeyPatch.context() as patch, LabelSpool() as spool:
        patch.setattr(labels, "_BUFFERED_PAIRS", buffered)
        for step in [*steps, 0, (1 << 20) - 20, 5 << 20]:
            if isinstance(step, int):
                ids, reached = spool.read(step, step + 45)
                assert reached.tolist() == [point in expected for point in range(step, step + 45)]
                assert ids.tolist() == [expected.get(point, -1) for point in range(step, step + 45)]
            else:
                spool.add(
                    np.array([point for point, _ in step], np.int64),
                    np.array([segment for _, segment in step], np.int64),
                )
                expected.update(step)


def test_a_stream_of_points_in_any_order_comes_back_in_order() -> None:
    count = 3_000_000
    order = np.random.default_rng(8).permutation(count)
    with LabelSpool() as spool:
        for part in np.array_split(order, 13):
            spool.add(part, part * 3)
        for start in range(0, count, 700_000):
            stop = min(start + 700_000, count)
            ids, reached = spool.read(start, stop)
            assert reached.all()
            assert np.array_equal(ids, np.arange(start, stop) * 3)


def test_the_spool_stays_small() -> None:
    tracemalloc.start()
    try:
        with LabelSpool() as spool:
            for start in range(0, 8_000_000, 250_000):
                spool.add(np.arange(start, start + 250_000), np.ones(250_000, np.int64))
            for start in range(0, 8_000_000, 250_000):
                assert spool.read(start, start + 250_000)[1].all()
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 24 << 20  # of 128 MiB of pairs


def test_the_spool_leaves_nothing_behind(tmp_path: Path) -> None:
    with LabelSpool(tmp_path) as spool:
        for _ in range(2):
            spool.add(np.arange(1 << 18), np.zeros(1 << 18, np.int64))
        spool.read(0, 2)
        assert len(list(tmp_path.rglob("*.pairs"))) == 1
    assert list(tmp_path.iterdir()) == []
    spool.close()
    with pytest.raises(StreamsegError, match="closed"):
        spool.read(0, 1)


def cut(path: Path) -> None:
    os.truncate(path, path.stat().st_size - 16)


@pytest.mark.parametrize("spoil", [Path.unlink, cut, lambda path: shutil.rmtree(path.parent)])
@pytest.mark.parametrize("then", ["read", "write"])
def test_labels_that_something_else_removes_are_missed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, spoil: Callable[[Path], object], then: str
) -> None:
    monkeypatch.setattr(labels, "_BUFFERED_PAIRS", 8)
    with LabelSpool(tmp_path) as spool:
        for start in (0, 10):
            spool.add(np.arange(start, start + 10), np.ones(10, np.int64))
        (path,) = tmp_path.rglob("*.pairs")
        spoil(path)
        with pytest.raises(FileError, match=r"00000000\.pairs has been removed or cut by something else; set TMPDIR"):
            spool.read(0, 20) if then == "read" else spool.add(np.arange(20, 60), np.ones(40, np.int64))


def test_labels_that_cannot_be_written_wait_in_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(labels, "_BUFFERED_PAIRS", 8)
    with LabelSpool(tmp_path) as spool:
        spool.add(np.arange(8), np.arange(8))
        (folder,) = tmp_path.iterdir()
        (folder / "00000000.pairs").mkdir()
        for _ in range(2):
            with pytest.raises(FileError, match=r"cannot write .*: Is a directory; make room there"):
                spool.add([8], [8])
        assert (spool.count, spool.has_any) == (8, True)
        assert np.array_equal(spool.read(0, 9)[0], [*range(8), -1])
        (folder / "00000000.pairs").rmdir()
        spool.add([8], [8])
        assert (spool.count, spool.read(0, 9)[0].tolist()) == (9, list(range(9)))


@pytest.mark.parametrize("result", ["final", "carry"])
def test_a_run_whose_labels_vanish_writes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, result: Any) -> None:
    """A cleaner of temporary folders comes just before the output is written."""
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    np.save(tmp_path / "in.npy", np.zeros((40, 3)))

    read = LabelSpool.read

    def read_late(spool: LabelSpool, start: int, stop: int) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        for path in scratch.rglob("*.pairs"):
            path.unlink()
        return read(spool, start, stop)

    monkeypatch.setattr(tempfile, "tempdir", str(scratch))
    monkeypatch.setattr(labels, "_BUFFERED_PAIRS", 8)
    monkeypatch.setattr(LabelSpool, "read", read_late)
    with pytest.raises(FileError, match="has been removed or cut"):
        ss.segment_file(
            tmp_path / "in.npy",
            tmp_path / "out.npy",
            ss.Proximity(1.0),
            spans=ss.SpanByCount(10),
            result=result,
        )
    assert not (tmp_path / "out.npy").exists()


def test_a_label_that_is_lost_is_missed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    np.save(tmp_path / "in.npy", np.zeros((40, 3)))
    read = LabelSpool.read

    def forgetful(spool: LabelSpool, start: int, stop: int) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        ids, reached = read(spool, start, stop)
        reached[7] = False
        return ids, reached

    monkeypatch.setattr(LabelSpool, "read", forgetful)
    with pytest.raises(InvalidInput, match=r"39 points of .* have labels, of 40"):
        ss.segment_file(tmp_path / "in.npy", tmp_path / "out.npy", ss.Proximity(1.0))
    assert not (tmp_path / "out.npy").exists()


@pytest.mark.parametrize(
    ("points", "segments", "said"),
    [
        ([1, 2], [1], r"'segment_ids' has shape \(1,\), expected \(2,\)"),
        ([-5, 2], [1, 1], "point id -5 is negative"),
        ([[1, 2]], [[1, 1]], r"'point_ids' has shape \(1, 2\), expected \(k,\)"),
        ([1.0], [1], "'point_ids' has dtype float64, expected int64"),
    ],
)
def test_the_spool_refuses_what_are_no_ids(points: Any, segments: Any, said: str) -> None:
    with LabelSpool() as spool, pytest.raises(InvalidInput, match=said):
        spool.add(points, segments)


def test_a_missing_folder_for_the_spool_is_told(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="cannot make a temporary folder"):
        LabelSpool(tmp_path / "nowhere")


@pytest.fixture
def source(tmp_path: Path) -> Path:
    path = tmp_path / "in.npy"
    np.save(path, np.arange(30.0).reshape(10, 3))
    return path


def test_an_existing_output_is_refused_unless_asked_for(tmp_path: Path, source: Path) -> None:
    out = tmp_path / "out.npy"
    out.write_text("precious")
    with pytest.raises(OutputExists, match=r"out\.npy exists already") as caught:
        write_labelled(open_cloud(source), out, Ones())
    assert isinstance(caught.value, FileExistsError)
    assert out.read_text() == "precious"
    write_labelled(open_cloud(source), out, Ones(), overwrite=True)
    assert np.load(out).tolist() == [1] * 10


def test_outputs_that_cannot_be_are_refused(tmp_path: Path, source: Path) -> None:
    with pytest.raises(InvalidParameter, match=r"ends in '\.ply', must end in \.las, \.laz"):
        check_output(tmp_path / "out.ply", [source])
    with pytest.raises(FileError, match=r"the folder .*nowhere does not exist"):
        check_output(tmp_path / "nowhere" / "out.laz", [source])
    (tmp_path / "folder.las").mkdir()
    with pytest.raises(FileError, match="it is a folder"):
        check_output(tmp_path / "folder.las", [source])
    os.link(source, tmp_path / "same.npy")
    for same in (source, tmp_path / "same.npy"):
        with pytest.raises(InvalidParameter, match="is the input"):
            check_output(same, [source], overwrite=True)
    check_output(tmp_path / "out.laz", [source])


def test_a_folder_without_permission_is_refused(tmp_path: Path, source: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    closed = tmp_path / "closed"
    closed.mkdir(mode=0o500)
    if os.geteuid() == 0:  # root may write everywhere: let the system answer as it would anybody else
        monkeypatch.setattr(os, "access", lambda path, mode: path != closed or not mode & os.W_OK)
    check_output(tmp_path / "out.laz", [source])
    with pytest.raises(FileError, match="no permission"):
        check_output(closed / "out.laz", [source])


class FailsAfter(Ones):
    def __init__(self, error: BaseException) -> None:
        self.error = error

    def read(self, start: int, stop: int) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        if start > 0:
            raise self.error
        return super().read(start, stop)


@pytest.mark.parametrize("error", [KeyboardInterrupt(), ZeroDivisionError("mine"), StreamsegError("ours")])
@pytest.mark.parametrize("suffix", [".laz", ".las", ".csv", ".npy"])
def test_a_failure_half_way_leaves_nothing_and_comes_through(tmp_path: Path, error: BaseException, suffix: str) -> None:
    for name in ("a.npy", "b.npy"):
        np.save(tmp_path / name, np.zeros((10, 3)))
    cloud = open_cloud([tmp_path / "a.npy", tmp_path / "b.npy"])
    with pytest.raises(type(error)) as caught:
        write_labelled(cloud, tmp_path / f"out{suffix}", FailsAfter(error))
    assert caught.value is error
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.npy", "b.npy"]


FULL_DISK = """
import resource, sys
import numpy as np
from pathlib import Path
from streamseg.errors import FileError
from streamseg.io import open_cloud, write_labelled
class Noise:
    def read(self, start, stop):
        return np.random.default_rng(1).integers(0, 2**60, stop - start), np.ones(stop - start, bool)
cloud = open_cloud(sys.argv[1])
resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, 300_000))
try:
    write_labelled(cloud, Path(sys.argv[2]), Noise())
except FileError as error:
    print(error)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="needs a limit on the size of files")
@pytest.mark.parametrize("suffix", [".laz", ".las", ".csv", ".npy"])
def test_a_disk_that_takes_no_more_is_told_and_nothing_is_left(tmp_path: Path, suffix: str) -> None:
    np.save(tmp_path / "in.npy", np.random.default_rng(2).random((60_000, 3)) * 100)
    out = tmp_path / f"out{suffix}"
    done = subprocess.run(
        [sys.executable, "-c", FULL_DISK, str(tmp_path / "in.npy"), str(out)],
        capture_output=True,
        text=True,
        check=True,
    )
    reason = os.strerror(errno.EFBIG)
    assert done.stdout == f"cannot write {out}: {reason}; nothing half-written is left in {tmp_path}\n"
    assert [path.name for path in tmp_path.iterdir()] == ["in.npy"]


def test_nothing_reached_writes_nothing(tmp_path: Path, source: Path) -> None:
    with LabelSpool() as spool, pytest.raises(InvalidInput, match=r"not one point of .* has been labelled"):
        write_labelled(open_cloud(source), tmp_path / "out.laz", spool)
    assert [path.name for path in tmp_path.iterdir()] == ["in.npy"]


def test_progress_is_told_and_a_spool_can_be_written(tmp_path: Path, source: Path) -> None:
    told: list[int] = []
    with LabelSpool() as spool:
        spool.add(np.arange(7), np.arange(7))
        assert write_labelled(open_cloud(source), tmp_path / "out.csv", spool, progress=told.append) == 7
    assert told == [10]
    assert (tmp_path / "out.csv").read_text().splitlines()[-1] == "18.0,19.0,20.0,6"


def test_ids_that_cannot_be_read_again_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise OSError(5, "Input/output error")

    with LabelSpool() as spool:
        spool.add(np.arange(1 << 20), np.zeros(1 << 20, np.int64))
        monkeypatch.setattr("numpy.fromfile", refuse)
        with pytest.raises(FileError, match=r"cannot read .*pairs: Input/output error"):
            spool.read(0, 4)


@pytest.mark.parametrize("may_end_early", [False, True])
@pytest.mark.parametrize("was_known", [False, True])
def test_damage_that_is_met_only_when_writing_costs_what_is_told(
    tmp_path: Path, source: Path, monkeypatch: pytest.MonkeyPatch, may_end_early: bool, was_known: bool
) -> None:
    cloud, blocks = open_cloud(source), IdSink.blocks

    def blocks_to_the_damage(sink: IdSink) -> Any:
        for count, block in blocks(sink):
            yield count - 4, block
        cloud.damage = "it is cut"

    monkeypatch.setattr(IdSink, "blocks", blocks_to_the_damage)
    if was_known:
        cloud.damage = "it is cut"

    def write() -> int:
        return write_labelled(cloud, tmp_path / "out.npy", Ones(), expected=10, may_end_early=may_end_early)

    if may_end_early and not was_known:
        with pytest.warns(StreamsegWarning, match=r"it is cut; 4 points behind it had been segmented and are not in"):
            assert write() == 6
        assert len(np.load(tmp_path / "out.npy")) == 6
    else:
        with pytest.raises(InvalidInput, match=r"6 points of .* have labels, of 10 .*it is cut"):
            write()
        assert not (tmp_path / "out.npy").exists()
