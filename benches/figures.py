"""Figures 5 and 6 of the streamed framework (ISPRS Annals I-3, 2012, section 3.4): processing time against spans.

Figure 5 varies the width of the spans, three to a window; figure 6 the number of spans in a window. Proximity
segmentation at 2.5 m of an airborne cloud of houses, already in memory; the time is that of the segmentation alone,
resolved labels included. The dotted line is the static segmentation. The paper had one thread; all cores are beside it.
On a busy machine ``--clock cpu`` draws the processor's time instead of the wall's, which for one thread is the same
thing undisturbed; the tables hold both.

    python benches/figures.py --out figures
"""

from __future__ import annotations

import argparse
import csv
import functools
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray

import streamseg as ss
from measuring import CLOCKS, DATA, Clock, Quartiles, Run, Runs, alternate, cores, load_xyz, machine, seconds

mpl.use("Agg")

import matplotlib.pyplot as plt
from matplotlib.ticker import FuncFormatter, NullLocator

if TYPE_CHECKING:
    from matplotlib.axes import Axes

DISTANCE = 2.5
WIDTHS = (2.5, 3.5, 5.0, 7.0, 10.0, 14.0, 20.0, 28.0, 40.0, 56.0, 80.0, 113.0, 160.0, 200.0)
COUNTS = (2, 3, 4, 5, 6, 8, 10, 12, 14, 16, 18, 20)
THREE_SPANS = 3
OVERLAP = 1
STATIC = "static"

INK, SOFT, GRID = "#1f2430", "#5b6472", "#e4e7ec"
COLORS = ("#b5482a", "#1f6fb2", "#2f855a", "#805ad5")


class Way(NamedTuple):
    """One point of a figure."""

    figure: int
    width: float
    spans: int
    threads: int

    @property
    def x(self) -> float:
        """Where it stands along the figure."""
        return self.width if self.figure == 5 else float(self.spans)


def segment(xyz: NDArray[np.float64], way: Way) -> NDArray[np.int64]:
    window = ss.Window(way.spans, OVERLAP)
    return ss.segment(xyz, ss.Proximity(DISTANCE), spans=ss.SpanByWidth(way.width), window=window, threads=way.threads)


def ways(width: float) -> list[Way]:
    """All points of both figures; `width` is that of the spans in figure 6."""
    threads = sorted({1, cores()})
    fifth = [Way(5, each, THREE_SPANS, crew) for crew in threads for each in WIDTHS]
    return fifth + [Way(6, width, count, crew) for crew in threads for count in COUNTS]


def measure(xyz: NDArray[np.float64], points: list[Way], repeats: int) -> Runs:
    """Run everything in turn, each round in another order; the static one several times a round, as it is the scale."""
    tasks: dict[str, Callable[[], object]] = {str(way): functools.partial(segment, xyz, way) for way in points}
    statics = [f"{STATIC} {turn}" for turn in range(5)]
    tasks |= {name: functools.partial(ss.segment_static, xyz, ss.Proximity(DISTANCE)) for name in statics}
    for task in tasks.values():
        task()
    runs = alternate(tasks, repeats, lambda done: print(f"round {done} of {repeats} done", flush=True))
    runs[STATIC] = [run for name in statics for run in runs.pop(name)]
    return runs


def write_runs(path: Path, figure: int, points: list[Way], runs: Runs) -> None:
    """Write every run of a figure as CSV; the static ones have neither spans nor width."""

    def row(kind: str, way: Way | None, number: int, run: Run) -> list[object]:
        what = (way.width, way.spans, OVERLAP, way.threads) if way else ("", "", "", 1)
        return [kind, *what, number, f"{run.wall:.6f}", f"{run.cpu:.6f}"]

    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(("kind", "span_width", "spans", "overlap", "threads", "run", "wall_seconds", "cpu_seconds"))
        writer.writerows(row(STATIC, None, number, run) for number, run in enumerate(runs[STATIC]))
        for way in points:
            if way.figure == figure:
                writer.writerows(row("streamed", way, number, run) for number, run in enumerate(runs[str(way)]))


def read_runs(folder: Path) -> tuple[list[Way], Runs]:
    """Read what `write_runs` wrote for both figures."""
    runs: Runs = {}
    points: dict[Way, None] = {}
    for figure in (5, 6):
        with (folder / f"figure{figure}.csv").open(newline="") as file:
            rows = list(csv.DictReader(file))
        runs[STATIC] = []
        for row in rows:
            name = STATIC
            if row["kind"] != STATIC:
                way = Way(figure, float(row["span_width"]), int(row["spans"]), int(row["threads"]))
                points[way], name = None, str(way)
            runs.setdefault(name, []).append(Run(float(row["wall_seconds"]), float(row["cpu_seconds"])))
    return list(points), runs


def draw(path: Path, figure: int, points: list[Way], runs: Runs, clock: Clock, extent: float, below: str) -> None:
    """Draw a figure: solid lines streamed, dotted line static, bands between the quartiles."""
    _, axes = plt.subplots(figsize=(8.4, 5.2), dpi=160)
    static = seconds(runs, STATIC, clock)
    axes.axhspan(static.low, static.high, color=INK, alpha=0.08, linewidth=0)
    axes.axhline(static.median, color=INK, linestyle=(0, (1, 2)), linewidth=1.8, label="static, 1 thread")
    tops = [static.high]
    # The processor's time of several threads together says nothing of how soon they are done.
    crews = sorted({way.threads for way in points}) if clock == "wall" else [1]
    for color, threads in zip(COLORS, crews, strict=False):
        line = [way for way in points if way.figure == figure and way.threads == threads]
        times = [seconds(runs, str(way), clock) for way in line]
        name = f"streamed, {threads} thread{'s' if threads > 1 else ' (as the paper)'}"
        plot_line(axes, [way.x for way in line], times, color, name)
        tops += [time.high for time in times]
    axes.set_ylim(0, 1.15 * max(tops))
    axes.set_ylabel("processing time [s]" if clock == "wall" else "processor time [s]")
    dress(axes, figure, points, static)
    if figure == 5:
        mark_whole(axes, extent / THREE_SPANS)
    plt.figtext(0.012, 0.012, below, fontsize=7.5, color=SOFT, linespacing=1.4)
    plt.tight_layout(rect=(0, 0.055, 1, 1))
    plt.savefig(path)
    plt.close()


def caption(cloud: str, points: int, repeats: int) -> str:
    """Say below both figures what was measured, how, and on what."""
    return (
        f"{cloud}, {points:,} points, proximity {DISTANCE:g} m on the Delaunay triangulation. Median and quartiles "
        f"of {repeats} interleaved runs,\nsegmentation only. {machine()}."
    )


def plot_line(axes: Axes, x: list[float], times: list[Quartiles], color: str, name: str) -> None:
    axes.fill_between(x, [time.low for time in times], [time.high for time in times], color=color, alpha=0.16, lw=0)
    medians = [time.median for time in times]
    axes.plot(x, medians, color=color, lw=2.0, marker="o", ms=4.5, mec="white", mew=0.8, label=name)


def mark_whole(axes: Axes, width: float) -> None:
    """Mark the width from which on about one window holds everything."""
    axes.axvline(width, color=SOFT, linewidth=0.9, linestyle=(0, (4, 3)))
    place = axes.get_xaxis_transform()
    note = "one window holds\nthe whole cloud"
    axes.text(width * 0.97, 0.985, note, transform=place, ha="right", va="top", fontsize=8, color=SOFT, linespacing=1.3)


def dress(axes: Axes, figure: int, points: list[Way], static: Quartiles) -> None:
    """Titles, axes, and a second scale in multiples of the static time."""
    width = next(way.width for way in points if way.figure == 6)
    if figure == 5:
        title = f"Width of the spans against processing time, {THREE_SPANS} spans per window"
        axes.set_xlabel("span width [m], logarithmic")
        axes.set_xscale("log")
        ticks: list[float] = [2.5, 5, 10, 20, 40, 80, 200]
    else:
        title = f"Spans per window against processing time, spans {width:g} m wide, overlap {OVERLAP}"
        axes.set_xlabel("spans per window")
        ticks = [2, 3, *range(4, 21, 2)]
    axes.set_xticks(ticks)
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_title(title, loc="left", fontsize=11.5, color=INK, pad=12)
    axes.grid(axis="y", color=GRID, linewidth=0.8)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    scale = axes.secondary_yaxis("right", functions=(to_multiple(static.median), to_multiple(1 / static.median)))
    scale.set_ylabel("multiple of the static time", color=SOFT)
    scale.tick_params(colors=SOFT)
    scale.spines["right"].set_visible(False)
    axes.legend(frameon=False, loc="lower left", fontsize=9)


def to_multiple(unit: float) -> Callable[[Any], Any]:
    return lambda value: value / unit


def show(points: list[Way], runs: Runs) -> None:
    """Print the medians by both clocks, and as multiples of the static ones."""
    static, static_cpu = seconds(runs, STATIC), seconds(runs, STATIC, "cpu")
    print(f"static: wall {static.median:.3f} s ({static.low:.3f} - {static.high:.3f}), cpu {static_cpu.median:.3f} s")
    heading = ("figure", "width", "spans", "threads", "wall s", "/ static", "cpu s", "/ static")
    print("".join(f"{word:>9}" for word in heading))
    for way in points:
        wall, cpu = (seconds(runs, str(way), clock).median for clock in CLOCKS)
        ratios = wall / static.median, cpu / static_cpu.median
        print(
            f"{way.figure:>9}{way.width:>9g}{way.spans:>9}{way.threads:>9}"
            f"{wall:>9.3f}{ratios[0]:>9.2f}{cpu:>9.3f}{ratios[1]:>9.2f}"
        )


def main() -> None:
    """Measure, write the runs, and draw."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cloud", type=Path, default=DATA / "isprs" / "CSite3.laz")
    parser.add_argument("--out", type=Path, default=Path("figures"), help="folder [default: figures]")
    parser.add_argument("--repeats", type=int, default=9, help="rounds [default: 9]")
    parser.add_argument("--width", type=float, default=5.0, help="of the spans in figure 6 [default: 5]")
    parser.add_argument("--clock", choices=CLOCKS, default="wall", help="what is drawn [default: wall]")
    parser.add_argument("--redraw", action="store_true", help="draw the runs that are in the folder already")
    given = parser.parse_args()
    warnings.simplefilter("ignore", ss.StreamsegWarning)
    given.out.mkdir(parents=True, exist_ok=True)
    xyz = load_xyz(given.cloud)
    if given.redraw:
        points, runs = read_runs(given.out)
    else:
        points = ways(given.width)
        runs = measure(xyz, points, given.repeats)
        for figure in (5, 6):
            write_runs(given.out / f"figure{figure}.csv", figure, points, runs)
    show(points, runs)
    below = caption(given.cloud.name, len(xyz), len(runs[str(points[0])]))
    for figure in (5, 6):
        path = given.out / f"figure{figure}.png"
        draw(path, figure, points, runs, given.clock, float(np.ptp(xyz[:, 0])), below)
        print(path)


if __name__ == "__main__":
    main()
