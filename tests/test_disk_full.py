"""A disk that is full: told as what it is, and nothing on it pretends to be whole."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest


def outputs(script: str, *arguments: object) -> list[str]:
    """Lines that a script of its own process prints; it limits the size of the files that it may write."""
    command = [sys.executable, "-c", script, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


HISTORY = """
import resource, signal, sys
import numpy as np, streamseg as ss, streamseg.history
streamseg.history._ROWS_PER_PART = int(sys.argv[2])
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
random = np.random.default_rng(0)
spans = (random.random((5000, 3)) * [10, 1000, 0] + [10 * i, 0, 0] for i in range(30))
run = ss.stream(spans, ss.Proximity(1.0), history=sys.argv[1])
resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, resource.RLIM_INFINITY))
taken = 0
try:
    for span in run:
        taken += len(span)
except ss.FileError as error:
    assert isinstance(error, OSError)
    print(error)
resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
run.close()
past = ss.History(sys.argv[1])
resolved = sum(len(points) for points, _ in past.resolve())
print(past.manifest["complete"], past.manifest["points"] == resolved)
"""


@pytest.mark.parametrize("rows_per_part", [30_000, 10**6])
def test_a_full_disk_is_told_and_the_history_does_not_pretend(tmp_path: Path, rows_per_part: int) -> None:
    told, outcome = outputs(HISTORY, tmp_path / "run", rows_per_part)
    assert told.startswith(f"the history {tmp_path / 'run'} cannot be written: ")
    assert outcome == "False True"


SPOOL = """
import resource, signal, sys
import numpy as np, streamseg as ss
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
random = np.random.default_rng(0)
if sys.argv[1] == "settlement":
    spans = (random.random((5000, 3)) * [10, 1000, 0] + [10 * i, 0, 0] for i in range(30))
    run = ss.stream(spans, ss.Proximity(1.0), result="final")
elif sys.argv[1] == "slabs":
    run = ss.stream(random.random((2_000_000, 3)) * 1000, ss.Proximity(1.0), spans=ss.SpanByWidth(20.0))
else:
    points = random.random((1_000_000, 3)) * 1000
    run = ss.stream(points, ss.Dbscan(1.0), spans=ss.SpanByCount(50_000), revisit=True)
resource.setrlimit(resource.RLIMIT_FSIZE, (1_000_000, resource.RLIM_INFINITY))
for _ in range(2):
    try:
        for span in run:
            pass
        print("ended")
    except ss.FileError as error:
        print(error)
"""


@pytest.mark.parametrize("what", ["settlement", "slabs", "slabs that wait"])
def test_a_spool_that_cannot_be_written_is_told_once(what: str) -> None:
    told, ended = outputs(SPOOL, what)
    assert told.startswith("the spool in ")
    assert " could not be written: " in told
    assert told.endswith("free some space or set TMPDIR to another folder")
    assert ended == "ended"


LATE = """
import resource, signal, sys
import numpy as np, streamseg as ss, streamseg.history

signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
streamseg.history._ROWS_PER_PART = 20_000
what, most_bytes, folder = sys.argv[1], int(sys.argv[2]), sys.argv[3]

def stream(**options):
    random = np.random.default_rng(0)
    if what == "store":  # many points, few segments
        spans = (random.random((20_000, 3)) * [30, 10, 0] for _ in range(28))
        graph = ss.Proximity(1.0, graph="radius")
        return ss.stream(spans, graph, revisit=True, result="history", **options)
    if what == "ledger":  # few points, each of them a segment of its own in each of ten windows
        spans = (random.random((5000, 3)) * [10_000, 1000, 0] + [10_000 * i, 0, 0] for i in range(40))
        graph, window = ss.Proximity(1.0, graph="radius"), ss.Window(10, 9)
        return ss.stream(spans, graph, window=window, revisit=True, result="history", **options)
    growing = ss.RegionGrowing(8, min_segment_size=1)  # ids of spans that may be seen again
    points = random.random((50_000, 3)) * [500, 100, 1]
    return ss.stream(points, growing, spans=ss.SpanByWidth(20.0), result="history", **options)

def taken(run):
    spans = []
    for span in run:
        assert span.index == len(spans)
        spans.append((span.point_ids, span.segment_ids))
    return spans

whole_run = stream()
whole = taken(whole_run)
run, limited = stream(history=folder), []
resource.setrlimit(resource.RLIMIT_FSIZE, (most_bytes, resource.RLIM_INFINITY))
try:
    for span in run:
        limited.append((span.point_ids, span.segment_ids))
except ss.FileError as error:
    print(error)
print(list(run) == [] and whole_run.is_proven and not run.is_proven)
same = [np.array_equal(a, b) for got, known in zip(limited, whole) for a, b in zip(got, known)]
print(len(limited), all(same) and len(same) == 2 * len(limited), len(whole))
resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
run.close()
past = ss.History(folder)
points, ids = map(np.concatenate, zip(*past.resolve()))
raw = np.concatenate([ids for _, ids in limited])
is_whole = np.array_equal(points, np.concatenate([points for points, _ in limited]))
# What it has made one is one.
is_right = np.array_equal(whole_run.resolve(ids), whole_run.resolve(raw))
print(past.manifest["complete"], is_whole, is_right)
"""


@pytest.mark.parametrize(("what", "most_bytes"), [("store", 2_000_000), ("ledger", 2_000_000), ("gone", 200_000)])
def test_late_joins_that_cannot_be_written_leave_what_has_gone_whole(
    tmp_path: Path, what: str, most_bytes: int
) -> None:
    """Every span comes out once, in order, with the ids it has with room enough, then the failure is told, once."""
    told, is_over, spans, history = outputs(LATE, what, most_bytes, tmp_path / "run")
    print(f"{what}: {told}; {spans}")
    assert told.startswith(f"the spool in {tempfile.gettempdir()} could not be written: ")
    assert told.endswith("free some space or set TMPDIR to another folder")
    assert is_over == "True"
    came, is_same, there_are = spans.split()
    assert is_same == "True"
    assert 2 < int(came) < int(there_are)
    assert history == "False True True"


NAMELESS = """
import os, signal
import numpy as np, streamseg as ss
random = np.random.default_rng(0)
spans = (random.random((20_000, 3)) * [30, 10, 0] for _ in range(28))
for span in ss.stream(spans, ss.Proximity(1.0, graph="radius"), revisit=True):
    if span.index == 25:
        folder, opened = os.path.realpath(os.environ["TMPDIR"]), {}
        for number in map(int, os.listdir("/proc/self/fd")):
            try:
                opened[os.readlink(f"/proc/self/fd/{number}")] = os.fstat(number).st_size
            except OSError:
                pass  # that of the listing
        held = {name: size for name, size in opened.items() if name.startswith(folder)}
        elsewhere = [name for name in opened if name.endswith(" (deleted)") and name not in held]
        is_nameless = all(name.endswith(" (deleted)") for name in held)
        print(is_nameless, max(held.values()), elsewhere, os.listdir(folder), flush=True)
        os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="the system does not tell which files are open")
def test_what_is_on_disk_lies_in_tmpdir_without_a_name_and_goes_with_the_process(tmp_path: Path) -> None:
    run = subprocess.run(
        [sys.executable, "-c", NAMELESS],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "TMPDIR": str(tmp_path)},
    )
    assert run.returncode == -signal.SIGKILL, run.stderr
    is_nameless, size, elsewhere, named = run.stdout.split()
    assert (is_nameless, elsewhere, named) == ("True", "[]", "[]")
    assert int(size) > 1_000_000
    assert list(tmp_path.iterdir()) == []
