"""One case in a process of its own: what it may take, and what it may leave behind."""

from __future__ import annotations

import os
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np

MOST_SECONDS = 20.0
MOST_BYTES = 600e6
_POLLED_EVERY = 0.002


class Ended(NamedTuple):
    """How a process ended."""

    status: int
    """Exit status; minus n if signal n ended it."""
    out: str
    err: str
    seconds: float
    peak: float
    """Bytes: the kernel's peak of resident memory, of the process or one that it started."""


class Verdict(NamedTuple):
    """What is to be said of a case."""

    number: int
    outcome: str
    """What happened, in words that can be counted."""
    fault: str
    """The promise that was broken; empty if none was."""
    seconds: float
    peak: float


class Case(NamedTuple):
    """A case that is ready to run in its folder."""

    task: Callable[[], object]
    judge: Callable[[Ended], tuple[str, str]]
    """Outcome and fault."""
    about: str
    """What was done to the input."""
    may_stay: frozenset[str] = frozenset()
    """Names that may be in the folder after the run."""


class Kind(Protocol):
    """A kind of case."""

    cases: int

    def prepare(self, folder: Path) -> None:
        """Make what all cases share, once."""

    def make(self, random: np.random.Generator, folder: Path, shared: Path) -> Case:
        """Make the input of one case in its folder."""

    def judge_all(self, verdicts: list[Verdict]) -> list[Verdict]:
        """Return the promises that only all cases together can break."""


def run_case(kind: Kind, name: str, number: int, seed: int, shared: Path, keep: Path | None) -> Verdict:
    """Make a case, run it, judge it."""
    folder = Path(tempfile.mkdtemp(prefix="case-", dir=shared))
    temporary = folder / "temporary"
    temporary.mkdir()
    try:
        random = np.random.default_rng([seed, sum(name.encode()), number])
        case = kind.make(random, folder, shared)
        before = set(os.listdir(folder))
        ended = _in_a_process(case.task, folder, temporary)
        outcome, fault = _common_faults(case, ended, folder, temporary, before)
        if not fault:
            outcome, fault = case.judge(ended)
        if keep is not None:
            shutil.copytree(folder, keep, symlinks=True)
            print(case.about, ended, sep="\n")
        fault = f"{fault} [{case.about}]" if fault else ""
        return Verdict(number, outcome, fault, ended.seconds, ended.peak)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def command(*words: object) -> Callable[[], None]:
    """Make a task of a command line."""

    def task() -> None:
        from streamseg.cli import main

        sys.argv = ["streamseg", *map(str, words)]
        main()

    return task


def _common_faults(case: Case, ended: Ended, folder: Path, temporary: Path, before: set[str]) -> tuple[str, str]:
    last = (ended.err.strip().splitlines() or [""])[-1][:200]
    if ended.status < 0:
        return "ended by a signal", f"signal {-ended.status} after {ended.seconds:.1f} s"
    if "Traceback (most recent" in ended.err or ended.status == 1:
        return "traceback", f"traceback: {last}"
    if "panicked at" in ended.err + ended.out:
        return "panic text", f"panic text on the screen: {last}"
    if ended.peak > MOST_BYTES:
        return "too much memory", f"peak of {ended.peak / 1e6:.0f} MB"
    litter = [*os.listdir(temporary), *(set(os.listdir(folder)) - before - case.may_stay - {"out.txt", "err.txt"})]
    if litter:
        return "litter", f"left behind: {', '.join(sorted(litter)[:3])}"
    if ended.status == 2 and not ended.err.strip():
        return "no word", "status 2 without a word"
    return "", ""


def _in_a_process(task: Callable[[], object], folder: Path, temporary: Path) -> Ended:
    began = time.monotonic()
    pid = os.fork()
    if pid == 0:
        _child(task, folder, temporary)
    status, usage = 0, None
    while usage is None:
        done, status, used = os.wait4(pid, os.WNOHANG)
        if done:
            usage = used
        elif time.monotonic() - began > MOST_SECONDS:
            os.kill(pid, signal.SIGKILL)
            done, status, usage = os.wait4(pid, 0)
        else:
            time.sleep(_POLLED_EVERY)
    text = [(folder / name).read_text(errors="replace") for name in ("out.txt", "err.txt")]
    code = os.waitstatus_to_exitcode(status)
    return Ended(code, *text, time.monotonic() - began, usage.ru_maxrss * 1024)


def _child(task: Callable[[], object], folder: Path, temporary: Path) -> None:
    """Run the task and end the process."""
    status = 1
    try:
        for name, target in (("out.txt", 1), ("err.txt", 2)):
            descriptor = os.open(folder / name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
            os.dup2(descriptor, target)
            os.close(descriptor)
        sys.stdin = open(os.devnull)  # noqa: SIM115 - as long as the process lives
        os.environ["TMPDIR"] = tempfile.tempdir = str(temporary)
        os.chdir(folder)
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        task()
        status = 0
    except SystemExit as leaving:
        code = leaving.code
        status = code if isinstance(code, int) else int(code is not None)
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)
