"""Proximity segmentation beside SciPy, and streamed beside static, on one flight pass.

The peer is what people write with SciPy today: `scipy.spatial.Delaunay` in the plane, edges no longer than the distance
in space, `scipy.sparse.csgraph.connected_components`. All runs are in one process, on one array already in memory, in
turn. Bars: static at least 15 times as fast as SciPy; streamed at its best width, on all cores, no slower than static.

    python benches/peers.py --repeats 5
"""

from __future__ import annotations

import argparse
import functools
import json
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import Delaunay

import streamseg as ss
from measuring import DATA, Quartiles, Runs, adjusted_rand, alternate, cores, load_xyz, machine, ratio, seconds

SCIPY, STATIC = "scipy", "static"
LEAST_SPEED_UP = 15.0
GREATEST_STREAMED = 1.0

Xyz = NDArray[np.float64]
Labels = NDArray[np.int64]
Table = dict[str, dict[str, Any]]


class Streamed(NamedTuple):
    """A way to stream: how wide the spans, how many to a window, overlapping by one, and how many threads."""

    width: float
    spans: int
    threads: int

    def __str__(self) -> str:
        return f"streamed, {self.width:g} x {self.spans}, {self.threads} thread{'s' if self.threads > 1 else ''}"


def by_scipy(xyz: Xyz, distance: float) -> Labels:
    """Components of the plane's Delaunay edges that are no longer than the distance in space."""
    corners = Delaunay(xyz[:, :2] - xyz[:, :2].mean(axis=0)).simplices
    edges = np.concatenate((corners[:, (0, 1)], corners[:, (1, 2)], corners[:, (2, 0)]))
    lengths = np.linalg.norm(xyz[edges[:, 0]] - xyz[edges[:, 1]], axis=1)
    a, b = edges[lengths <= distance].T
    graph = coo_array((np.ones(len(a), np.bool_), (a, b)), shape=(len(xyz), len(xyz)))
    labels: NDArray[np.int32] = connected_components(graph, directed=False)[1]
    return labels.astype(np.int64)


def stream(xyz: Xyz, distance: float, way: Streamed) -> Labels:
    spans, window = ss.SpanByWidth(way.width), ss.Window(way.spans, 1)
    return ss.segment(xyz, ss.Proximity(distance), spans=spans, window=window, threads=way.threads)


def width_and_spans(text: str) -> tuple[float, int]:
    """Read ``WIDTHxSPANS``, as in ``20x3``."""
    width, _, spans = text.partition("x")
    return float(width), int(spans)


def weaver_share(xyz: Xyz, distance: float, way: Streamed, repeats: int) -> Quartiles:
    """Part of the time of a stream that the weaver takes."""

    def share() -> float:
        begun = time.perf_counter()
        spans, window = ss.SpanByWidth(way.width), ss.Window(way.spans, 1)
        with ss.stream(xyz, ss.Proximity(distance), spans=spans, window=window, threads=way.threads) as run:
            for _ in run:
                pass
        return run.progress.weaving / (time.perf_counter() - begun)

    return Quartiles.of([share() for _ in range(repeats)])


def measure(tasks: dict[str, Callable[[], Labels]], repeats: int, scipy_repeats: int) -> Runs:
    """Run all in turn; SciPy, which takes long and is far off, in the first rounds only."""
    runs = alternate(tasks, min(repeats, scipy_repeats), told)
    rest = {name: task for name, task in tasks.items() if name != SCIPY}
    for name, more in alternate(rest, max(0, repeats - scipy_repeats)).items():
        runs[name] += more
    return runs


def told(done: int) -> None:
    print(f"round {done} done", flush=True)


def tabulate(runs: Runs, labels: dict[str, Labels]) -> Table:
    """One row per way: median, ratio to static, segments, agreement with static."""
    table: Table = {}
    for name in runs:
        wall, to_static = seconds(runs, name), ratio(runs, name, STATIC)
        table[name] = {
            "runs": len(runs[name]),
            "seconds": wall.median,
            "seconds_quartiles": [wall.low, wall.high],
            "ratio_to_static": to_static.median,
            "ratio_quartiles": [to_static.low, to_static.high],
            "cpu_seconds": seconds(runs, name, "cpu").median,
            "cpu_ratio_to_static": ratio(runs, name, STATIC, "cpu").median,
            "segments": len(np.unique(labels[name][labels[name] >= 0])),
            "adjusted_rand": adjusted_rand(labels[name], labels[STATIC]),
        }
    return table


def show(table: Table) -> None:
    print(f"\n{'':<32} {'wall s':>8} {'quartiles':>15} {'/static':>7} {'cpu s':>8} {'/static':>7}", end="")
    print(f" {'segments':>9} {'ARI':>10}")
    for name, row in table.items():
        low, high = row["seconds_quartiles"]
        print(
            f"{name:<32} {row['seconds']:>8.3f} {f'{low:.3f} - {high:.3f}':>15} {row['ratio_to_static']:>7.2f} "
            f"{row['cpu_seconds']:>8.3f} {row['cpu_ratio_to_static']:>7.2f} "
            f"{row['segments']:>9,} {row['adjusted_rand']:>10.7f}"
        )


def bars(table: Table, ways: list[Streamed]) -> dict[str, Any]:
    """Whether static and streamed are as fast as they have to be."""
    speed_up = table[SCIPY]["ratio_to_static"] if SCIPY in table else None
    on_all_cores = [str(way) for way in ways if way.threads == cores()]
    best = min(on_all_cores, key=lambda name: table[name]["ratio_to_static"])
    streamed = table[best]["ratio_to_static"]
    if speed_up is not None:
        met = "met" if speed_up >= LEAST_SPEED_UP else "MISSED"
        by_cpu = table[SCIPY]["cpu_ratio_to_static"]
        print(f"\nstatic is {speed_up:.1f} times as fast as SciPy, {by_cpu:.1f} by the processor's clock", end=" ")
        print(f"(bar: {LEAST_SPEED_UP:g}: {met})")
    met = "met" if streamed <= GREATEST_STREAMED else "MISSED"
    print(f"{best} takes {streamed:.2f} of static (bar: at most {GREATEST_STREAMED:g}: {met})")
    return {"static_over_scipy": speed_up, "best_streamed": best, "streamed_over_static": streamed}


def options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cloud", type=Path, default=DATA / "als" / "hawaii_pass.laz")
    parser.add_argument("--repeats", type=int, default=5, help="rounds [default: 5]")
    parser.add_argument("--scipy-repeats", type=int, default=3, help="rounds with SciPy [default: 3]; 0 = none")
    parser.add_argument("--distance", type=float, default=1.0, help="in units of the cloud [default: 1]")
    parser.add_argument(
        "--windows",
        type=width_and_spans,
        nargs="+",
        metavar="WIDTHxSPANS",
        default=[(10.0, 3), (20.0, 3), (50.0, 3), (200.0, 3), (5.0, 12)],
        help="width of the spans and how many to a window [default: 10x3 20x3 50x3 200x3 5x12]",
    )
    parser.add_argument("--json", type=Path, help="also write the figures here")
    return parser.parse_args()


def main() -> None:
    """Measure, print, and say whether the bars are met."""
    given = options()
    warnings.simplefilter("ignore", ss.StreamsegWarning)
    xyz, distance = load_xyz(given.cloud), given.distance
    print(f"{given.cloud.name}: {len(xyz):,} points, distance {distance:g}; {machine()}")
    ways = [Streamed(width, spans, threads) for width, spans in given.windows for threads in sorted({1, cores()})]
    tasks: dict[str, Callable[[], Labels]] = {SCIPY: functools.partial(by_scipy, xyz, distance)}
    tasks |= {STATIC: functools.partial(ss.segment_static, xyz, ss.Proximity(distance))}
    tasks |= {str(way): functools.partial(stream, xyz, distance, way) for way in ways}
    if given.scipy_repeats == 0:
        del tasks[SCIPY]
    labels = {name: task() for name, task in tasks.items()}
    table = tabulate(measure(tasks, given.repeats, given.scipy_repeats), labels)
    show(table)
    outcome = bars(table, ways)
    shares = {str(way): weaver_share(xyz, distance, way, 3).median for way in ways}
    print("weaver's share of the time: " + ", ".join(f"{share:.1%} {name}" for name, share in shares.items()))
    if given.json:
        written = {"cloud": given.cloud.name, "points": len(xyz), "machine": machine(), "ways": table, "bars": outcome}
        given.json.write_text(json.dumps({**written, "weaver_share": shares}, indent=2))


if __name__ == "__main__":
    main()
