"""What the benchmarks share: the clouds, alternating runs, quartiles, and agreement of two partitions.

Single times mean little on a machine that does other things too. So everything that is compared is run in turn, round
after round, and what is reported are medians, quartiles, and medians of the ratios within a round. On a busy machine
the processor's clock tells more than the one on the wall; it counts the time of all threads together.
"""

from __future__ import annotations

import gc
import os
import platform
import random
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

DATA = Path(os.environ.get("STREAMSEG_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))


Clock = Literal["wall", "cpu"]
CLOCKS: tuple[Clock, ...] = ("wall", "cpu")


class Run(NamedTuple):
    """Seconds that one run of a task took: on the wall, and of all processors together."""

    wall: float
    cpu: float

    def by(self, clock: Clock) -> float:
        """Seconds by one of the clocks."""
        return self.wall if clock == "wall" else self.cpu


class Quartiles(NamedTuple):
    """The middle half of some measurements."""

    low: float
    median: float
    high: float

    @classmethod
    def of(cls, values: list[float]) -> Quartiles:
        """Quartiles of some values."""
        return cls(*np.percentile(values, (25, 50, 75)).tolist())


Runs = dict[str, list[Run]]


def load_xyz(path: Path) -> NDArray[np.float64]:
    """Read the coordinates of a LAS or LAZ file, (n, 3)."""
    import laspy

    return np.ascontiguousarray(laspy.read(path).xyz, np.float64)


def cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def machine() -> str:
    """Say what the figures were measured on."""
    model = platform.processor() or platform.machine()
    if (about := Path("/proc/cpuinfo")).exists():
        names = [line.partition(":")[2].strip() for line in about.read_text().splitlines() if "model name" in line]
        model = names[0] if names else model
    return f"{model}, {cores()} cores, Python {platform.python_version()}, {platform.system()}"


def timed(task: Callable[[], Any]) -> Run:
    """Run a task once; what it returns is given up within the time, as a caller's would be later."""
    gc.collect()
    cpu, begun = time.process_time(), time.perf_counter()
    task()
    return Run(time.perf_counter() - begun, time.process_time() - cpu)


def alternate(
    tasks: Mapping[str, Callable[[], Any]], repeats: int, on_round: Callable[[int], None] = lambda _: None
) -> Runs:
    """Run all tasks once a round, in an order shuffled anew, so that none always has the same company."""
    runs: Runs = {name: [] for name in tasks}
    order = list(tasks)
    shuffled = random.Random(1)
    for done in range(repeats):
        shuffled.shuffle(order)
        for name in order:
            runs[name].append(timed(tasks[name]))
        on_round(done + 1)
    return runs


def seconds(runs: Runs, name: str, clock: Clock = "wall") -> Quartiles:
    """Quartiles of the time of a task."""
    return Quartiles.of([run.by(clock) for run in runs[name]])


def ratio(runs: Runs, name: str, to: str, clock: Clock = "wall") -> Quartiles:
    """Quartiles, over the rounds that both ran in, of the time of `name` divided by that of `to`."""
    return Quartiles.of([a.by(clock) / b.by(clock) for a, b in zip(runs[name], runs[to], strict=False)])


def adjusted_rand(a: NDArray[np.int64], b: NDArray[np.int64]) -> float:
    """Agreement of two partitions: 1 = the same, 0 = as good as chance (Hubert and Arabie 1985).

    Points in no segment (-1) count as one class.
    """
    first, second = (np.unique(labels, return_inverse=True)[1].astype(np.int64) for labels in (a, b))
    together = np.unique(first * (int(second.max()) + 1) + second, return_counts=True)[1]

    def pairs(counts: NDArray[np.int64]) -> float:
        return float((counts.astype(np.float64) * (counts - 1)).sum() / 2)

    both, in_first, in_second = pairs(together), pairs(np.bincount(first)), pairs(np.bincount(second))
    by_chance = in_first * in_second / pairs(np.array([len(a)]))
    most = (in_first + in_second) / 2
    return 1.0 if most == by_chance else (both - by_chance) / (most - by_chance)
