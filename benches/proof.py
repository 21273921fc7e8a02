"""Streamed against static on measured clouds: which runs are identical, and what they left undecided.

    python benches/proof.py [--clouds …] [--methods …] [--widths …] [--directions …] [--quick] [--out proof.csv]
    python benches/proof.py --orders [--clouds …] [--methods …] [--seeds 10] [--quick] [--out proof.csv]

The first table has spans by width; widths are multiples of the distance of each cloud. The second has spans in stream
order: as they were measured, and in random orders; from a file, an array and a live iterator that come back to earlier
ground, and from a file that does not. Every row is printed and appended to the file as soon as it is known; with
--resume, rows that are there already are not computed again. Fails if a run that promised the static result, or proved
it, has another.
"""

from __future__ import annotations

import argparse
import csv
import functools
import tempfile
import time
import warnings
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import streamseg as ss
from proof_cases import CLOUDS, METHODS, Order, Subject, load, orders
from streamseg.comparison import Ids, compare
from streamseg.run import in_input_order

WIDTHS = (2.0, 4.0, 10.0, 20.0, 40.0)
DIRECTIONS = ("x", "y", "30")
BY_WIDTH = ("delaunay", "growing", "growing-radius", "dbscan")
MONOTONE = ("radius", "delaunay-xy")
SMALL = "topography"


class Key(NamedTuple):
    """What tells a run apart from others."""

    cloud: str
    method: str
    source: str
    spans: str
    revisit: str


class Found(NamedTuple):
    """What came of a run against the static result."""

    promised: str
    """Whether the run promised the static result; "proven" if nothing was left undecided."""
    identical: str
    agreement: str
    static: int
    streamed: int
    edges: int
    """Edges decided or not, and those that were left undecided."""
    edges_left: int
    points: int
    points_left: int
    early: int
    returned: int
    waited: int
    cpu: float
    """Seconds of all processors together."""


COLUMNS = (*Key._fields, *Found._fields)
SPACE = (11, 14, 6, 10, 7, 8, 9, 9, 8, 8, 10, 10, 10, 11, 9, 9, 9, 7)


class Table:
    """Rows that are printed and kept as they come."""

    def __init__(self, path: Path, *, resume: bool) -> None:
        self._path = path
        self._known: dict[Key, list[str]] = {}
        self.broken = 0
        if resume and path.exists():
            with path.open(newline="") as file:
                self._known = {Key(*row[: len(Key._fields)]): row for row in list(csv.reader(file))[1:]}
        else:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.unlink(missing_ok=True)
            self._append(COLUMNS)
        _show(COLUMNS)

    def add(self, key: Key, compute: Callable[[], Found]) -> None:
        """Print the row of a key, computed unless it is known."""
        if key not in self._known:
            row = [str(value) for value in (*key, *compute())]
            self._append(row)
            self._known[key] = row
        row = self._known[key]
        _show(row)
        told = Found(*row[len(Key._fields) :])  # type: ignore[arg-type]
        self.broken += told.promised != "no" and told.identical == "no"

    def _append(self, row: Iterable[str]) -> None:
        with self._path.open("a", newline="") as file:
            csv.writer(file).writerow(row)


def _show(row: Iterable[str]) -> None:
    print("  ".join(f"{value:>{space}}" for value, space in zip(row, SPACE, strict=True)), flush=True)


def against(static: Ids, source: Any, segmentor: ss.Segmentor, **more: Any) -> Found:
    """Stream a source and compare."""
    begun = time.process_time()
    with ss.stream(source, segmentor, result="final", with_points=False, **more) as run:
        streamed = in_input_order(run)
    seconds = time.process_time() - begun
    found, told = compare(static, streamed), run.certificate
    return Found(
        promised="proven" if run.is_proven else "yes" if run.is_identical else "no",
        identical="no" if len(found.differing) else "yes",
        agreement=f"{found.adjusted_rand_index:.6f}",
        static=np.count_nonzero(np.unique(static) >= 0),
        streamed=np.count_nonzero(np.unique(streamed) >= 0),
        edges=told.decided_edges + told.undecided_edges,
        edges_left=told.undecided_edges,
        points=told.decided_points + told.undecided_points,
        points_left=told.undecided_points,
        early=told.early_decisions,
        returned=told.returned_points,
        waited=told.waited_points,
        cpu=round(seconds, 1),
    )


def by_width(subject: Subject, spans: ss.SpanByWidth) -> Found:
    """Stream the files in spans by width."""
    return against(subject.of_file, subject.cloud.paths, subject.segmentor, spans=spans)


def in_order(subject: Subject, order: Order, source: str, more: dict[str, Any]) -> Found:
    """Stream the points in some order, from one kind of source."""
    points = load(subject.cloud)
    if source == "file":
        with tempfile.TemporaryDirectory() as folder:
            path = points.write(Path(folder) / "ordered.las", order.order)
            static = subject.static(path, order.order)
            return against(static, path, subject.segmentor, spans=order.spans, **more)
    positions = points.positions(order.order)
    static = subject.static(positions, order.order)
    if source == "live":
        return against(static, iter(np.split(positions, order.cuts)), subject.segmentor, **more)
    attributes = {} if points.times is None else {"gps_time": points.times[order.order]}
    return against(static, positions, subject.segmentor, spans=order.spans, attributes=attributes, **more)


def add_widths(table: Table, names: tuple[str, str], widths: list[float], directions: list[str]) -> None:
    """Spans of several widths in several directions."""
    subject = Subject(*names)
    for direction in directions:
        for width in widths:
            spans = ss.SpanByWidth(
                width * subject.cloud.distance, direction if direction in ("x", "y") else float(direction)
            )
            key = Key(*names, "file", f"{spans.width:g} {direction}", "no")
            table.add(key, functools.partial(by_width, subject, spans))


def add_orders(table: Table, names: tuple[str, str], seeds: int) -> None:
    """Spans in stream order, from every kind of source, with and without coming back."""
    subject = Subject(*names)
    for order in orders(load(subject.cloud), seeds):
        sources = ["file", "array"]
        # To a live source more may come at any place: only what nothing undoes is the same in any order, and k
        # neighbors without a radius are refused.
        if names[1] in MONOTONE or (names[1] != "growing" and not order.is_random):
            sources.append("live")
        for source, revisit in [*((source, "yes") for source in sources), ("file", "no")]:
            more = {"revisit": True} if revisit == "yes" else {}
            key = Key(*names, source, order.name, revisit)
            table.add(key, functools.partial(in_order, subject, order, source, more))


def main() -> None:
    """Print the table that is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--clouds", nargs="+", choices=CLOUDS)
    parser.add_argument("--methods", nargs="+", choices=METHODS)
    parser.add_argument("--widths", nargs="+", type=float, help="in distances of the cloud")
    parser.add_argument("--directions", nargs="+", default=DIRECTIONS, help="x, y or azimuths in degrees")
    parser.add_argument("--orders", action="store_true", help="spans in stream order instead of by width")
    parser.add_argument("--seeds", type=int, help="how many random orders")
    parser.add_argument("--quick", action="store_true", help="a small cloud and few spans, for a look")
    parser.add_argument("--resume", action="store_true", help="leave out rows that are in the file already")
    parser.add_argument("--out", type=Path, default=Path("figures/proof.csv"), help="where rows are kept")
    options = parser.parse_args()
    # What they say of narrow spans is in the table.
    warnings.simplefilter("ignore", ss.StreamsegWarning)
    clouds = options.clouds or ([SMALL] if options.quick else [name for name in CLOUDS if name != SMALL])
    methods = options.methods or (METHODS if options.orders else BY_WIDTH)
    table = Table(options.out, resume=options.resume)
    for names in [(cloud, method) for cloud in clouds for method in methods]:
        if options.orders:
            seeds = options.seeds if options.seeds is not None else 2 if options.quick else 10
            add_orders(table, names, seeds)
        else:
            widths = options.widths or (WIDTHS[1:4:2] if options.quick else WIDTHS)
            add_widths(table, names, widths, options.directions)
    if table.broken:
        raise SystemExit(f"{table.broken} runs promised the static result and have another")


if __name__ == "__main__":
    main()
