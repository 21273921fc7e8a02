"""Forked in the middle of a run: the child is told at once and does no harm, and the parent's run goes on."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork on this system")

# What both processes do first. `forked()` is true in the child, which an alarm ends if it hangs.
START = """
import gc, os, signal, sys
import numpy as np
import streamseg as ss
from pathlib import Path

POINTS = np.column_stack([np.arange(3000.0), np.zeros((3000, 2))])
ROWS = np.split(POINTS, 30)
NEAR = ss.Proximity(1.5)
PARENT = os.getpid()
child = 0


def forked():
    global child
    if child:
        return False
    child = os.fork()
    if child:
        # The child does all that it does before the parent goes on.
        assert os.waitpid(child, 0)[1] == 0, "the child failed or hung"
        return False
    child = -1
    signal.alarm(30)
    return True


def fork_once(*_):
    forked()


def refused(call, what="the stream"):
    try:
        call()
    except ss.StreamInUse as error:
        said = str(error)
        assert said.startswith(f"{what} belongs to process {PARENT}; a forked process cannot go on with it"), said
    else:
        raise AssertionError("not refused")


def rest(run):
    points = sum(len(span) for span in run)
    assert points == 3000 - 100, points
"""

SCRIPTS = {
    "goes on": """
run = ss.stream(ROWS, NEAR, threads=2, history="past")
next(run)
if forked():
    refused(lambda: next(run))
    for look in (lambda: run.progress, lambda: run.certificate, lambda: run.resolve([1]), lambda: run.live_entries):
        refused(look)
    run.stop()
    run.close()
    assert list(run) == []
    os._exit(0)
rest(run)
assert ss.History("past").manifest["complete"] is True
""",
    "lets go and ends as processes do": """
with ss.stream(ROWS, NEAR, threads=2, history="past", result="carry") as run:
    next(run)
    if forked():
        sys.exit()
    rest(run)
assert ss.History("past").manifest["complete"] is True
""",
    "collects": """
run = ss.stream((row for row in ROWS), ss.RegionGrowing(5), threads=2)
next(run)
if forked():
    del run
    gc.collect()
    sys.exit()
rest(run)
""",
    "goes on with final ids": """
run = ss.stream(ROWS, NEAR, result="final", spans=ss.SpanByCount(100))
first = next(run)
if forked():
    refused(lambda: next(run))
    sys.exit()
spans = [first, *run]
assert np.array_equal(np.concatenate([span.points for span in spans]), POINTS)
""",
    "goes on from a callback": """
def source():
    yield from ROWS[:10]
    fork_once()
    yield from ROWS[10:]

for options in ({"on_progress": fork_once}, {}):
    child = 0
    run = ss.stream(ROWS if options else source(), NEAR, threads=2, history="past", overwrite=True, **options)
    try:
        points = sum(len(span) for span in run)
    except ss.StreamInUse as error:
        assert child == -1 and f"belongs to process {PARENT}" in str(error), error
        sys.exit()
    assert child > 0 and points == 3000
    assert ss.History("past").manifest["complete"] is True
""",
    "goes on from a segmentor": """
def segmentor(window):
    if window.index == 3:
        fork_once()
    return np.zeros(len(window), int)

try:
    assert len(ss.segment(POINTS, segmentor, spans=ss.SpanByCount(100))) == 3000
except ss.StreamInUse:
    assert child == -1
    sys.exit()
assert child > 0
""",
    "goes on with a survey": """
survey = ss.preprocess(iter(ROWS), ss.VoxelGrid(2.0), threads=2)
next(survey)
if forked():
    refused(lambda: next(survey), "the survey")
    sys.exit()
assert sum(span.count for span in survey) == 2900
""",
    "goes on with a history": """
list(ss.stream(ROWS, NEAR, history="past"))
resolved = ss.History("past").resolve()
first = next(resolved)
if forked():
    sys.exit()
assert sum(len(ids) for ids, _ in [first, *resolved]) == 3000
""",
    "goes on with a file": """
np.save("in.npy", POINTS)
np.savetxt("in.xyz", POINTS)
ss.scenes.write("in.laz", "street", 3000)
expected = None
for callback in ("on_read", "on_progress", "on_write"):
    for end in ("npy", "xyz", "laz"):
        child = 0
        out = f"{callback}.{end}"
        try:
            outcome = ss.segment_file(f"in.{end}", out, NEAR, history="past", overwrite=True, **{callback: fork_once})
        except ss.StreamInUse:
            assert child == -1
            assert not Path(out).exists()
            sys.exit()
        assert child > 0 and outcome.points == 3000, outcome
        assert ss.History("past").manifest["complete"] is True
        assert sum(len(ids) for _, ids in ss.io.read_labels(out)) == 3000 if end != "npy" else len(np.load(out)) == 3000
assert not list(Path().glob(".streamseg*"))
""",
    "ends with a file": """
np.save("in.npy", POINTS)
np.savetxt("in.xyz", POINTS)

def fork_and_exit(_):
    if forked():
        sys.exit()

for callback in ("on_read", "on_progress", "on_write"):
    for end in ("npy", "xyz"):
        child = 0
        try:
            ss.segment_file(f"in.{end}", f"{callback}.{end}", NEAR, **{callback: fork_and_exit})
        except ss.StreamInUse:
            # What a source raises is told at the end of the run, and that cannot come here.
            assert child == -1 and callback == "on_read"
            sys.exit()
        assert child > 0
        ids = np.load(f"{callback}.npy") if end == "npy" else np.loadtxt(f"{callback}.xyz")[:, 3]
        assert np.array_equal(ids, np.ones(3000))
""",
    "ends with a spool": """
from streamseg.io import LabelSpool
spool = LabelSpool()
spool.add(np.arange(10), np.arange(10))
spool.read(0, 10)
if forked():
    refused(lambda: spool.read(0, 10), "this label spool")
    sys.exit()
spool.add([10], [10])
assert spool.read(0, 11)[0].tolist() == list(range(11))
spool.close()
""",
}


@pytest.mark.parametrize("name", SCRIPTS)
def test_the_child(tmp_path: Path, name: str) -> None:
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    script = START + SCRIPTS[name] + "\nassert child > 0, child\nprint('the parent came to its end')\n"
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout == "the parent came to its end\n"
    assert "Traceback" not in done.stderr
    assert not list(tmp_path.glob("streamseg-labels-*"))
