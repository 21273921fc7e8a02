"""Files that change between two readings: told, and nothing is written, whatever the file system says of them."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import laspy
import numpy as np
import pytest
from numpy.typing import NDArray

import streamseg as ss
from streamseg.io import open_cloud, unchanged

Positions = NDArray[np.float64]
NEAR = ss.Proximity(5.0)
RANDOM = np.random.default_rng(24)
# Two heaps; all coordinates take as many letters.
HEAPS = np.round((RANDOM.random((600, 3)) + np.repeat([[0, 0, 0], [50, 0, 0]], 300, axis=0)) * 1000 + 1000)
KINDS = ["xyz", "npy", "las", "laz"]
CHANGED = "has changed since it was opened, so its points cannot be told from others"
GONE = "does not exist"


def write(path: Path, points: Positions) -> Path:
    if path.suffix == ".npy":
        np.save(path, points)
    elif path.suffix == ".xyz":
        np.savetxt(path, points, fmt="%.0f")
    else:
        header = laspy.LasHeader(version="1.4", point_format=6)
        header.scales = [1.0, 1.0, 1.0]
        cloud = laspy.LasData(header)
        cloud.x, cloud.y, cloud.z = points.T
        cloud.write(path)
    return path


def keep_time(path: Path, change: Callable[[], object]) -> None:
    before = path.stat()
    change()
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))


def replace(path: Path, points: Positions) -> None:
    write(path.with_name(f"other{path.suffix}"), points).replace(path)


CHANGES: dict[str, Callable[[Path], object]] = {
    "replaced": lambda path: replace(path, HEAPS[::-1]),
    "replaced, time kept": lambda path: keep_time(path, lambda: replace(path, HEAPS[::-1])),
    "rewritten in place": lambda path: write(path, HEAPS[::-1]),
    "appended to": lambda path: path.write_bytes(path.read_bytes() + b"1 2 3\n"),
    "cut off": lambda path: os.truncate(path, path.stat().st_size * 2 // 3),
    "removed": lambda path: path.unlink(),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("output", ["out.npy", "out.xyz", "out.laz"])
@pytest.mark.parametrize("change", CHANGES)
def test_no_point_gets_the_id_of_another(tmp_path: Path, kind: str, output: str, change: str) -> None:
    path = write(tmp_path / f"in.{kind}", HEAPS)
    changed: list[bool] = []

    def once(progress: ss.Progress) -> None:
        if progress.windows and not changed:
            changed.append(True)
            CHANGES[change](path)

    with pytest.raises(ss.FileError, match=GONE if change == "removed" else CHANGED):
        ss.segment_file(path, tmp_path / output, NEAR, on_progress=once)
    assert changed
    assert not [file for file in tmp_path.iterdir() if file.name.startswith(("out", ".streamseg"))]


@pytest.mark.parametrize("change", [name for name in CHANGES if "time kept" not in name])
def test_a_change_during_the_first_reading_is_told_too(tmp_path: Path, change: str) -> None:
    paths = [write(tmp_path / f"{name}.xyz", HEAPS) for name in "ab"]
    reads: list[int] = []

    def once(read: int) -> None:
        if not reads:
            CHANGES[change](paths[0])
        reads.append(read)

    with pytest.raises(ss.FileError, match=GONE if change == "removed" else CHANGED):
        ss.segment_file(paths, tmp_path / "out.xyz", NEAR, on_read=once)
    assert not (tmp_path / "out.xyz").exists()


def test_every_pass_over_a_cloud_is_watched(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(unchanged, "_BLOCK", 64)
    path = write(tmp_path / "in.npy", HEAPS)
    cloud = open_cloud(path)
    for size in (1, 63, 64, 65, 600, 1000):
        assert sum(len(chunk.points) for chunk in cloud.chunks(size)) == 600
    # Only a part is read, so no block that differs is met.
    keep_time(path, lambda: replace(path, np.vstack([HEAPS[:500], HEAPS[:499:-1]])))
    chunks = cloud.chunks(100)
    for _ in range(4):
        next(chunks)
    with pytest.raises(ss.FileError, match=CHANGED):
        list(chunks)
    for call in (
        lambda: ss.segment(cloud, NEAR, spans="auto"),
        lambda: ss.features(cloud, "NormalZ", k=4),
        lambda: list(ss.preprocess(cloud, ss.VoxelGrid(1.0))),
    ):
        with pytest.raises(ss.FileError, match=CHANGED):
            call()


def test_a_run_that_ended_early_has_seen_what_it_has_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(unchanged, "_BLOCK", 64)
    path = write(tmp_path / "in.npy", np.vstack([HEAPS, [[np.nan, 0, 0]]]))

    def swap(_: object) -> None:
        keep_time(path, lambda: replace(path, np.vstack([HEAPS[::-1], [[np.nan, 0, 0]]])))

    with pytest.raises(ss.FileError, match=CHANGED):
        ss.segment_file(path, tmp_path / "out.npy", NEAR, spans=ss.SpanByCount(600), on_read=swap)
    assert not (tmp_path / "out.npy").exists()


@pytest.mark.parametrize("kind", KINDS)
def test_a_history_knows_the_points_that_it_was_made_from(tmp_path: Path, kind: str) -> None:
    path, past = write(tmp_path / f"in.{kind}", HEAPS), tmp_path / "past"
    ss.segment_file(path, tmp_path / f"out.{kind}", NEAR, history=past)
    # The same points, in a file of another time.
    replace(path, HEAPS)
    assert ss.resolve_file(past, path, tmp_path / f"again.{kind}") == 600
    assert (tmp_path / f"again.{kind}").read_bytes() == (tmp_path / f"out.{kind}").read_bytes()
    replace(path, HEAPS[::-1])
    with pytest.raises(ss.InvalidInput, match=r"has other points than the history .*past was made from"):
        ss.resolve_file(past, path, tmp_path / f"wrong.{kind}")
    assert not (tmp_path / f"wrong.{kind}").exists()
