"""Torture: thousands of damaged files, odd arrays and odd parameters, each in a process of its own.

Nothing may end a process by a signal, print a traceback, hang, take too much memory or leave litter;
and what is wrong in the output has to be told. Every case follows from the seed and its number.

    python benches/torture                          # everything, some 6,000 cases
    python benches/torture --only laz-blocks --cases 100
    python benches/torture --only laz-blocks --case 17 --keep /tmp/case-17
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path

import arrays
import las_headers
import laz_blocks
import npy_files
import parameters
import text_files
from case import Kind, Verdict, run_case

KINDS: dict[str, Kind] = {
    "laz-blocks": laz_blocks.KIND,
    "las-headers": las_headers.KIND,
    "npy": npy_files.KIND,
    "text": text_files.KIND,
    "arrays": arrays.KIND,
    "parameters": parameters.KIND,
}
_SHOWN = 12


def main() -> int:
    """Run what was asked for; 1 if anything broke a promise."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--only", choices=KINDS, action="append", help="one kind of case (may be repeated)")
    parser.add_argument("--cases", type=int, help="cases of each kind [default: each kind's own number]")
    parser.add_argument("--case", type=int, help="just this one")
    parser.add_argument("--seed", type=int, default=10)
    parser.add_argument("--jobs", type=int, default=len(os.sched_getaffinity(0)))
    parser.add_argument("--keep", type=Path, help="with --case: leave its files in this new folder")
    asked = parser.parse_args()
    broken = 0
    for name in asked.only or KINDS:
        kind = KINDS[name]
        numbers = [asked.case] if asked.case is not None else list(range(asked.cases or kind.cases))
        began = time.monotonic()
        verdicts = list(_verdicts(name, numbers, asked))
        broken += _report(name, kind, verdicts, time.monotonic() - began)
    return int(broken > 0)


def _verdicts(name: str, numbers: list[int], asked: argparse.Namespace) -> Iterator[Verdict]:
    """Run the cases in several processes, of which each forks one process a case."""
    jobs = max(1, min(asked.jobs, len(numbers)))
    context = multiprocessing.get_context("fork")
    with tempfile.TemporaryDirectory(prefix="torture-") as folder:
        os.environ["TORTURE_CLIPS"] = folder
        KINDS[name].prepare(Path(folder))
        working: dict[Connection, tuple[BaseProcess, list[int]]] = {}
        for job in range(jobs):
            verdicts, end = context.Pipe(duplex=False)
            share = numbers[job::jobs]
            worker = context.Process(target=_work, args=(name, share, asked, folder, end))
            worker.start()
            end.close()  # so that a worker that dies ends the pipe
            working[verdicts] = worker, list(share)
        while working:
            for verdicts in wait(list(working)):
                worker, left = working[verdicts]  # type: ignore[index]
                try:
                    yield verdicts.recv()  # type: ignore[union-attr]
                    left.pop(0)
                except EOFError:
                    worker.join()
                    yield from (_lost(number, worker.exitcode) for number in left)
                    del working[verdicts]  # type: ignore[arg-type]


def _lost(number: int, code: int | None) -> Verdict:
    return Verdict(number, "no verdict", f"the worker that had it ended with {code}", 0.0, 0.0)


def _work(name: str, numbers: list[int], asked: argparse.Namespace, folder: str, end: Connection) -> None:
    kind = KINDS[name]
    for number in numbers:
        end.send(run_case(kind, name, number, asked.seed, Path(folder), asked.keep))


def _report(name: str, kind: Kind, verdicts: list[Verdict], seconds: float) -> int:
    """Print what came out, and every broken promise; returns how many there are."""
    outcomes = Counter(verdict.outcome for verdict in verdicts)
    print(f"{name}: {len(verdicts):,} cases in {seconds:.0f} s")
    for outcome, count in sorted(outcomes.items()):
        print(f"    {count:6,}  {outcome}")
    print(
        f"    peak memory {max(verdict.peak for verdict in verdicts) / 1e6:.0f} MB, "
        f"longest {max(verdict.seconds for verdict in verdicts):.1f} s"
    )
    faults = [verdict for verdict in verdicts if verdict.fault]
    faults += kind.judge_all(verdicts)
    for fault in sorted(faults, key=lambda verdict: verdict.number)[:_SHOWN]:
        print(f"    BROKEN, case {fault.number}: {fault.fault}")
    if len(faults) > _SHOWN:
        print(f"    … and {len(faults) - _SHOWN:,} more")
    sys.stdout.flush()
    return len(faults)


if __name__ == "__main__":
    sys.exit(main())
