"""A command does what it is to do, whether or not anybody can hear what it says; the exit status tells."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

POINTS = "1 2 3\n2 3 4\n9 9 9\n"
FULL = "streamseg: cannot write to standard output: No space left on device; all else has been done\n"
SEGMENT = ["segment", "in.xyz", "out.xyz", "--distance", "5", "--preview", "out.png"]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "in.xyz").write_text(POINTS)
    return tmp_path


def run(folder: Path, words: list[str], around: str = "{}", **more: str) -> subprocess.CompletedProcess[str]:
    """Run a command inside a line of shell."""
    words = [sys.executable, "-m", "streamseg", *words]
    command = " ".join(f"'{word}'" for word in words)
    return subprocess.run(
        ["bash", "-c", f"set -o pipefail; {around.format(command)}"],
        cwd=folder,
        env={**os.environ, **more},
        capture_output=True,
        text=True,
        errors="surrogateescape",
    )


@pytest.mark.parametrize(
    ("words", "encoding"),
    [(SEGMENT, "utf-8"), (["info", "in.xyz"], "ascii"), (["--help"], "utf-8")],
    ids=["segment", "info", "help"],
)
@pytest.mark.parametrize(
    ("around", "status", "told"),
    [
        ("{} > /dev/full", 2, FULL),
        ("{} | true", 141, ""),
        ("{} >&-", 0, ""),
        ("{} >&- 2>&- <&-", 0, ""),
        ("{} > /dev/full 2> /dev/full", 2, ""),
    ],
    ids=["full", "closed pipe", "closed", "all closed", "both full"],
)
def test_nobody_hears(folder: Path, words: list[str], around: str, status: int, told: str, encoding: str) -> None:
    # The pipe is closed before anything is said: Python takes longer to start than `true` to end.
    done = run(folder, words, around, PYTHONIOENCODING=encoding)
    assert (done.returncode, done.stderr) == (status, told)
    if words is SEGMENT:
        assert np.loadtxt(folder / "out.xyz")[:, 3].tolist() == [1, 1, 2]
        assert (folder / "out.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("around", ["{} > /dev/full", "{} 2> /dev/full", "{} 2>&-", "{} >&- 2>&- <&-"])
def test_what_went_wrong_is_the_status_that_counts(folder: Path, around: str) -> None:
    assert run(folder, ["info", "no.xyz"], around).returncode == 2
    assert run(folder, ["verify", "in.xyz", "--distance", "5", "--span-count", "0"], around).returncode == 2


@pytest.mark.parametrize("more", [{"PYTHONIOENCODING": "ascii"}, {"LC_ALL": "C", "PYTHONUTF8": "0"}, {}], ids=str)
def test_names_that_a_terminal_has_no_letters_for(folder: Path, more: dict[str, str]) -> None:
    for name in (os.fsdecode(b"h\xf6he.xyz"), "高さ.xyz"):
        (folder / "in.xyz").replace(folder / name)
        done = run(folder, ["segment", name, "out.xyz", "--distance", "5", "--overwrite"], **more)
        assert (done.returncode, done.stderr) == (0, "")
        done = run(folder, ["segment", name, f"out-{name}", "--distance", "5"], **more)
        assert (done.returncode, done.stderr) == (0, "")
        assert "3 points in 2 segments" in done.stdout
        done = run(folder, ["info", f"no-{name}"], **more)
        assert done.returncode == 2
        assert "Traceback" not in done.stderr
        assert "does not exist" in done.stderr
        (folder / name).replace(folder / "in.xyz")
