"""The command line as people use it: what they get, and what they are told when something is wrong."""

import os
import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import laspy
import numpy as np
import pytest

import streamseg as ss

Run = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture
def run(tmp_path: Path) -> Run:
    def run(*words: object) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "streamseg", *map(str, words)]
        # Wide enough that messages are not wrapped.
        environment = {**os.environ, "COLUMNS": "400", "NO_COLOR": "1"}
        return subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, env=environment)

    return run


@pytest.fixture
def strip(tmp_path: Path) -> Path:
    return ss.scenes.write(tmp_path / "strip.laz", "airborne", 30_000)


def test_a_labelled_file_keeps_everything_and_gets_final_ids(run: Run, strip: Path, tmp_path: Path) -> None:
    done = run(
        "segment", strip, "out.laz", "--distance", 1, "--span-width", 5, "--history", "past", "--preview", "a.png"
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""  # no progress bar where there is no terminal
    before, after = laspy.read(strip), laspy.read(tmp_path / "out.laz")
    expected = ss.segment(strip, ss.Proximity(1.0), spans=ss.SpanByWidth(5.0))
    np.testing.assert_array_equal(after["SegmentID"], expected)
    for name in before.point_format.dimension_names:
        np.testing.assert_array_equal(after[name], before[name])
    assert f"30,000 points in {len(np.unique(expected)):,} segments" in done.stdout
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")

    assert run("resolve", "past", strip, "again.laz").returncode == 0
    np.testing.assert_array_equal(laspy.read(tmp_path / "again.laz")["SegmentID"], expected)
    exported = run("export", "past", "tables")
    assert exported.returncode == 0
    assert (tmp_path / "tables" / "point_segment.csv").read_text().count("\n") == 30_001


@pytest.mark.parametrize("result", ["final", "carry", "history"])
@pytest.mark.parametrize(
    "cut", [("--span-count", 2000), ("--span-time", 0.02), ("--span-lines", 8), ("--direction", 30)]
)
def test_every_cut_and_every_result(run: Run, strip: Path, tmp_path: Path, cut: tuple[str, int], result: str) -> None:
    done = run("segment", strip, "out.laz", "--distance", 1, *cut, "--result", result, "--threads", 2)
    assert done.returncode == 0, done.stderr
    ids = laspy.read(tmp_path / "out.laz")["SegmentID"]
    assert len(ids) == 30_000
    assert ids.min() >= 1


def test_several_files_are_one_stream(run: Run, tmp_path: Path) -> None:
    points = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [9, 0, 0]])
    np.savetxt(tmp_path / "a.xyz", points[:2])
    np.savetxt(tmp_path / "b.xyz", points[2:])
    assert run("segment", "a.xyz", "b.xyz", "out.csv", "--distance", 1.5).returncode == 0
    assert [line.split()[-1] for line in (tmp_path / "out.csv").read_text().splitlines()] == ["1", "1", "1", "2"]


def test_info_of_a_cloud_and_of_a_history(run: Run, strip: Path) -> None:
    told = run("info", strip).stdout
    assert "30,000" in told
    assert "gps_time" in told
    suggested = shlex.split(next(line for line in told.splitlines() if line.startswith("try")))[2:]
    suggested[suggested.index("OUT.laz")] = "tried.laz"
    assert run(*suggested).returncode == 0
    run("segment", strip, "out.laz", "--distance", 1, "--history", "past")
    assert "Proximity(1.0" in run("info", "past").stdout


WRONG = {
    "missing input": (["segment", "no.laz", "out.laz", "--distance", 1], ["no.laz", "does not exist"]),
    "distance": (["segment", "strip.laz", "out.laz", "--distance", -1], ["streamseg: --distance is -1", "above 0"]),
    "width": (
        ["segment", "strip.laz", "out.laz", "--distance", 1, "--span-width", 0],
        ["streamseg: --span-width is 0", "above 0"],
    ),
    "overlap": (
        ["segment", "strip.laz", "out.laz", "--distance", 1, "--overlap", 3],
        ["streamseg: --overlap is 3 of 3 spans"],
    ),
    "direction": (
        ["segment", "strip.laz", "out.laz", "--distance", 1, "--direction", "up"],
        ["streamseg: --direction is 'up'", "'x', 'y'"],
    ),
    "threads": (["segment", "strip.laz", "out.laz", "--distance", 1, "--threads", 0], ["streamseg: --threads is 0"]),
    "two cuts": (
        ["segment", "strip.laz", "out.laz", "--distance", 1, "--span-width", 9, "--span-count", 9],
        ["streamseg: --span-width and --span-count"],
    ),
    "output is input": (["segment", "strip.laz", "strip.laz", "--distance", 1, "--overwrite"], ["strip.laz"]),
    "output folder": (["segment", "strip.laz", "no/out.laz", "--distance", 1], ["no"]),
    "output suffix": (["segment", "strip.laz", "out.png", "--distance", 1], [".png", ".laz"]),
    "no history": (["resolve", "nothing", "strip.laz", "out.laz"], ["nothing is no history"]),
    "not labelled": (["preview", "strip.laz", "out.png"], ["SegmentID"]),
    "option": (["segment", "strip.laz", "out.laz", "--distance", 1, "--metric", "z"], ["xyz", "xy"]),
    "no distance": (["segment", "strip.laz", "out.laz"], ["--distance"]),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_usage_gets_one_clear_sentence(run: Run, strip: Path, tmp_path: Path, case: str) -> None:
    words, expected = WRONG[case]
    before = set(tmp_path.iterdir())
    done = run(*words)
    assert done.returncode == 2
    for part in expected:
        assert part in done.stderr
    assert "Traceback" not in done.stderr
    assert set(tmp_path.iterdir()) == before


def test_an_output_is_replaced_only_when_asked(run: Run, strip: Path, tmp_path: Path) -> None:
    (tmp_path / "out.laz").write_text("precious")
    done = run("segment", strip, "out.laz", "--distance", 1)
    assert done.returncode == 2
    assert "--overwrite" in done.stderr
    assert (tmp_path / "out.laz").read_text() == "precious"
    assert run("segment", strip, "out.laz", "--distance", 1, "--overwrite").returncode == 0
    assert len(laspy.read(tmp_path / "out.laz")) == 30_000


def test_a_picture_is_replaced_only_when_asked(run: Run, strip: Path, tmp_path: Path) -> None:
    (tmp_path / "a.png").write_text("precious")
    done = run("segment", strip, "out.laz", "--distance", 1, "--preview", "a.png")
    assert done.returncode == 2
    assert (tmp_path / "a.png").read_text() == "precious"
    assert not (tmp_path / "out.laz").exists()


def test_a_narrow_span_is_warned_of(run: Run, strip: Path) -> None:
    done = run("segment", strip, "out.laz", "--distance", 3, "--span-width", 2)
    assert done.returncode == 0
    assert "warning: windows overlap by 2, less than the distance 3" in done.stderr


def test_what_comes_before_damage_is_written(run: Run, strip: Path, tmp_path: Path) -> None:
    # LAZ of point format 6 comes in chunks of 50 000; the older formats break off at a point.
    new = laspy.read(strip)
    header = laspy.LasHeader(point_format=1, version="1.2")
    header.scales, header.offsets = new.header.scales, new.header.offsets
    old = laspy.LasData(header)
    old.X, old.Y, old.Z = new.X, new.Y, new.Z
    old.write(tmp_path / "old.laz")
    cut = (tmp_path / "old.laz").read_bytes()
    (tmp_path / "cut.laz").write_bytes(cut[: len(cut) * 2 // 3])
    done = run("segment", "cut.laz", "out.laz", "--distance", 1, "--span-width", 5)
    assert done.returncode == 2
    kept = laspy.read(tmp_path / "out.laz")
    assert 10_000 < len(kept) < 30_000
    assert f"damaged after point {len(kept):,} of 30,000" in done.stderr
    np.testing.assert_array_equal(kept.X, old.X[: len(kept)])


def test_invalid_points_are_rejected_or_dropped(run: Run, tmp_path: Path) -> None:
    np.save(tmp_path / "bad.npy", np.array([[0.0, 0, 0], [np.nan, 0, 0], [1, 0, 0]]))
    done = run("segment", "bad.npy", "out.npy", "--distance", 2)
    assert done.returncode == 2
    assert "point 1 has the coordinates (NaN, 0, 0)" in done.stderr
    assert "--drop-invalid" in done.stderr
    assert run("segment", "bad.npy", "out.npy", "--distance", 2, "--drop-invalid", "--overwrite").returncode == 0
    assert np.load(tmp_path / "out.npy").tolist() == [1, -1, 1]
    done = run("segment", "bad.npy", "out.las", "--distance", 2, "--drop-invalid")
    assert done.returncode == 0
    assert "1 points have no finite coordinates" in done.stderr
    assert len(laspy.read(tmp_path / "out.las")) == 2


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_an_interrupt_leaves_what_was_done(tmp_path: Path, number: signal.Signals) -> None:
    ss.scenes.write(tmp_path / "strip.las", "airborne", 1_500_000)
    command = [sys.executable, "-m", "streamseg", "segment", "strip.las", "out.las", "--distance", "1"]
    command += ["--span-count", "20000", "--threads", "1", "--history", "past"]
    process = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True)
    manifest = tmp_path / "past" / "manifest.json"
    # A history has its first part when a million rows have come.
    while not manifest.exists() or '"parts": 0' in manifest.read_text():
        assert process.poll() is None
        time.sleep(0.005)
    process.send_signal(number)
    _, told = process.communicate(timeout=120)
    assert process.returncode == 128 + number
    assert "interrupted" in told
    history = ss.History(tmp_path / "past")
    assert history.manifest["complete"] is False
    points = history.manifest["points"]
    assert 0 < points < 1_500_000
    kept = laspy.read(tmp_path / "out.las")
    assert len(kept) == points
    assert kept["SegmentID"].min() >= 1


@pytest.mark.parametrize("threads", [1, 2])
def test_an_interrupt_does_not_wait_for_a_window_that_takes_minutes(tmp_path: Path, threads: int) -> None:
    np.save(tmp_path / "in.npy", np.random.default_rng(0).random((300_000, 3)))
    command = [sys.executable, "-m", "streamseg", "segment", "in.npy", "out.npy", "--method", "growing"]
    command += ["--k", "90000", "--threads", str(threads), "--history", "past"]
    process = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True)
    while not (tmp_path / "past" / "manifest.json").exists():
        assert process.poll() is None
        time.sleep(0.005)
    process.send_signal(signal.SIGINT)
    _, told = process.communicate(timeout=120)
    assert process.returncode == 130
    assert told == "streamseg: interrupted; out.npy has not been written, because no window had been segmented yet\n"
    assert [path.name for path in tmp_path.iterdir()] == ["in.npy"], "a history of nothing blocks no later run"


def test_a_history_of_something_else_is_refused(run: Run, strip: Path, tmp_path: Path) -> None:
    run("segment", strip, "out.laz", "--distance", 1, "--history", "past")
    other = ss.scenes.write(tmp_path / "other.laz", "street", 40_000)
    done = run("resolve", "past", other, "again.laz")
    assert done.returncode == 2
    assert "past is the history of 30,000 points" in done.stderr
    same_size = ss.scenes.write(tmp_path / "same.laz", "street", 30_000)
    done = run("resolve", "past", same_size, "again.laz")
    assert done.returncode == 2
    assert "same.laz has other points than the history past was made from" in done.stderr
    assert not (tmp_path / "again.laz").exists()
    shutil.copy(strip, tmp_path / "copy.laz")
    done = run("resolve", "past", tmp_path / "copy.laz", "again.laz")
    assert done.returncode == 0
    assert "warning: past is the history of" in done.stderr


def test_no_picture_is_drawn_over_a_cloud(run: Run, strip: Path, tmp_path: Path) -> None:
    before = strip.read_bytes()
    for picture in ("strip.laz", "out.laz"):
        done = run("segment", strip, "out.laz", "--distance", 1, "--preview", picture, "--overwrite")
        assert done.returncode == 2
        assert ".png" in done.stderr
    assert strip.read_bytes() == before
    assert not (tmp_path / "out.laz").exists()


def test_the_demonstration_replaces_only_its_own(run: Run, strip: Path) -> None:
    before = strip.read_bytes()
    done = run("demo", ".", "--points", 2000)
    assert done.returncode == 2
    assert "strip.laz exists and is not of an earlier demonstration" in done.stderr
    assert strip.read_bytes() == before
    assert run("demo", "new", "--points", 2000).returncode == 0
    assert run("demo", "new", "--points", 2000).returncode == 0
