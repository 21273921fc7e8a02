"""A disk that is full: told as what it is, and nothing on it pretends to be whole."""

from __future__ import annotations

import subprocess
import sys
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
