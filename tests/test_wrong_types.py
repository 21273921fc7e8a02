"""What people give by mistake: each is one sentence, below the root, and of the builtin kind that people expect."""

from __future__ import annotations

import io
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import streamseg as ss

POINTS = np.column_stack([np.arange(50.0), np.zeros((50, 2))])
NEAR = ss.Proximity(1.5)
HUGE = 10**400

Call = Callable[[], object]

NUMBERS: dict[str, Call] = {
    "distance": lambda: ss.Proximity(HUGE),
    "eps": lambda: ss.Dbscan(HUGE),
    "min_points": lambda: ss.Dbscan(1.0, HUGE),
    "width": lambda: ss.SpanByWidth(HUGE),
    "points": lambda: ss.SpanByCount(2**63),
    "seconds": lambda: ss.SpanByTime(HUGE),
    "lines": lambda: ss.SpanByScanLine(2**63),
    "spans": lambda: ss.Window(2**63),
    "overlap": lambda: ss.Window(3, HUGE),
    "min_segment_size": lambda: ss.Proximity(1.0, min_segment_size=HUGE),
    "max_segment_size": lambda: ss.Proximity(1.0, max_segment_size=2**64),
    "k": lambda: ss.RegionGrowing(HUGE),
    "max_distance": lambda: ss.PlaneExtraction(1.0, max_distance=HUGE),
    "tile_size": lambda: ss.PlaneExtraction(1.0, tile_size=HUGE),
    "residual": lambda: ss.RegionGrowing(9, residual=HUGE),
    "radius": lambda: ss.RadiusOutlierRemoval(HUGE),
    "multiplier": lambda: ss.StatisticalOutlierRemoval(8, HUGE),
    "size": lambda: ss.VoxelGrid(HUGE),
    "threads": lambda: ss.stream(POINTS, NEAR, threads=HUGE),
}


@pytest.mark.parametrize("name", NUMBERS)
def test_a_number_that_is_too_large_is_a_wrong_parameter(name: str) -> None:
    with pytest.raises(ss.InvalidParameter, match=rf"^{name} is .*, allowed: ") as caught:
        NUMBERS[name]()
    assert len(str(caught.value)) < 200


TYPES: dict[str, Call] = {
    "distance is '1'": lambda: ss.Proximity("1"),  # type: ignore[arg-type]
    "points is 2.5": lambda: ss.SpanByCount(2.5),  # type: ignore[arg-type]
    "points is '7'": lambda: ss.SpanByCount("7"),  # type: ignore[arg-type]
    "k is '7'": lambda: ss.RegionGrowing("7"),  # type: ignore[arg-type]
    "min_segment_size is '7'": lambda: ss.Proximity(1.0, min_segment_size="7"),  # type: ignore[arg-type]
    "threads is '2'": lambda: ss.segment(POINTS, NEAR, threads="2"),  # type: ignore[arg-type]
    "window is 3": lambda: ss.segment(POINTS, NEAR, window=3),  # type: ignore[arg-type]
    "inputs is ndarray": lambda: ss.segment_file(POINTS, "out.npy", NEAR),  # type: ignore[arg-type]
}


@pytest.mark.parametrize("start", TYPES)
def test_a_wrong_type_is_a_wrong_parameter_and_a_type_error(start: str) -> None:
    with pytest.raises(ss.InvalidType, match=rf"^{start}, allowed: "):
        TYPES[start]()


def test_numbers_may_be_of_any_kind() -> None:
    assert ss.SpanByCount(np.int32(7)) == ss.SpanByCount(7)  # type: ignore[arg-type]
    assert ss.Proximity(np.float32(0.5)).distance == 0.5  # type: ignore[arg-type]
    assert ss.Proximity(1).distance == 1.0
    assert len(ss.segment(POINTS, NEAR, threads=np.int64(2))) == 50  # type: ignore[arg-type]


@pytest.mark.parametrize("k", [0, 100_001])
def test_neighbors_are_at_most_a_hundred_thousand(k: int) -> None:
    for call in (lambda: ss.RegionGrowing(k), lambda: ss.PlaneExtraction(1.0, k=k)):
        with pytest.raises(ss.InvalidParameter, match=rf"^k is {k}, allowed: a whole number"):
            call()


def test_a_memoryview_is_an_array_and_a_file_is_not() -> None:
    assert ss.segment(memoryview(POINTS), NEAR).tolist() == [1] * 50
    for source in (io.StringIO("1 2 3"), io.BytesIO(b"1 2 3"), bytearray(9), POINTS > 1, POINTS.astype(complex)):
        with pytest.raises(ss.InvalidInput):
            ss.segment(source, NEAR)
    with pytest.raises(ss.InvalidInput, match="attributes has the name 5, expected text"):
        ss.segment(POINTS, NEAR, attributes={5: np.zeros(50)})  # type: ignore[dict-item]


def test_what_is_masked_is_invalid() -> None:
    masked = np.ma.MaskedArray(POINTS, mask=np.zeros(POINTS.shape, bool))
    masked[7, 2] = np.ma.masked
    with pytest.raises(ss.InvalidInput, match=r"^point 7 has the coordinates \(7, 0, NaN\)"):
        ss.segment(masked, NEAR)
    assert ss.segment(masked, NEAR, drop_invalid=True).tolist() == [1] * 7 + [-1] + [2] * 42


def test_only_ids_of_the_stream_can_be_resolved() -> None:
    run = ss.stream(POINTS, NEAR)
    list(run)
    assert run.resolve([1, -1]).tolist() == [1, -1]
    for odd in (10**9, -2, 0):
        with pytest.raises(ss.InvalidInput, match=rf"^ids has {odd}, which this stream has not given"):
            run.resolve([1, odd])


SEGMENTOR = """
def labels(window):
    if window.index == 1:
        raise {what}
    return [0] * len(window)
"""


@pytest.mark.parametrize(("what", "told"), [("ValueError('oh')", "ValueError: oh"), ("SystemExit(5)", "SystemExit: 5")])
def test_a_plugin_that_raises_is_told_with_its_own_frames_only(tmp_path: Path, what: str, told: str) -> None:
    (tmp_path / "mine.py").write_text(SEGMENTOR.format(what=what))
    info = tmp_path / "mine-1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: mine\nVersion: 1\n")
    (info / "entry_points.txt").write_text("[streamseg.segmentors]\nmine = mine:labels\n")
    np.save(tmp_path / "in.npy", POINTS)
    program = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); from streamseg.cli import main; main()"
    words = ["segment", "in.npy", "out.npy", "--method", "mine", "--span-count", "5"]
    done = subprocess.run([sys.executable, "-c", program, *words], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 1
    lines = [line for line in done.stderr.splitlines() if "are in out.npy" not in line]
    assert lines[0] == f"streamseg: segmentor 'labels' raised in window 1: {told}"
    assert [line.split(",")[0].strip() for line in lines[1:] if "File" in line] == [f'File "{tmp_path / "mine.py"}"']
    assert "Traceback" not in done.stderr


def streamseg(folder: Path, *words: object) -> subprocess.CompletedProcess[str]:
    command: list[Any] = [sys.executable, "-m", "streamseg", *map(str, words)]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True)


def test_the_command_line_names_the_options_that_were_typed(tmp_path: Path) -> None:
    np.save(tmp_path / "in.npy", POINTS)
    for words, start in {
        ("--distance", 1, "--span-width", -5): "streamseg: --span-width is -5, allowed",
        ("--distance", 1, "--span-count", 0): "streamseg: --span-count is 0, allowed",
        ("--method", "growing", "--k", 100_001): "streamseg: --k is 100001, allowed",
        ("--distance", 1, "--min-size", 9, "--max-size", 5): "streamseg: --max-size is 5 with a --min-size of 9",
    }.items():
        done = streamseg(tmp_path, "segment", "in.npy", "out.npy", *words)
        assert (done.returncode, done.stderr.startswith(start)) == (2, True), done.stderr


def test_input_that_is_refused_leaves_no_history(tmp_path: Path) -> None:
    np.save(tmp_path / "nan.npy", np.full((5, 3), np.nan))
    with pytest.raises(ss.InvalidInput):
        ss.segment_file(tmp_path / "nan.npy", tmp_path / "out.npy", NEAR, history=tmp_path / "past")
    assert [path.name for path in tmp_path.iterdir()] == ["nan.npy"]
    done = streamseg(tmp_path, "info", "nan.npy")
    assert "5 points have no finite coordinates" in done.stdout


def test_a_broken_condition_and_no_segments_are_told_in_the_summary(tmp_path: Path) -> None:
    np.save(tmp_path / "in.npy", POINTS)
    done = streamseg(tmp_path, "segment", "in.npy", "a.npy", "--distance", 1.5, "--span-width", 9, "--overlap", 0)
    assert "windows share no span" in done.stdout
    done = streamseg(tmp_path, "segment", "in.npy", "b.npy", "--distance", 1.5, "--filter", "Z > 5")
    assert 'no segment: --filter "Z > 5" leaves none of ' in done.stdout
    done = streamseg(tmp_path, "segment", "in.npy", "c.npy", "--method", "dbscan", "--eps", 1.5, "--min-points", 9)
    assert " points are noise\n" in done.stdout
    assert "more points would be in one with a larger --eps (1.5), or a smaller --min-points (9)\n" in done.stdout
