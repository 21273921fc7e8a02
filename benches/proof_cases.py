"""What the proof is made with: measured clouds, methods that suit them, and orders in which their points can come."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import laspy
import numpy as np
from numpy.typing import NDArray

import streamseg as ss
from measuring import DATA
from streamseg.comparison import Ids
from streamseg.io import open_cloud
from streamseg.io.lattice import Lattice

# Spans in stream order that a cloud is cut into.
SPANS = 60


class Cloud(NamedTuple):
    """Files that are one stream, and distances that suit them."""

    files: tuple[str, ...]
    distance: float
    """For lengths in space, in units of the cloud."""
    flat: float
    """For lengths on the map, which join across heights."""

    @property
    def paths(self) -> list[Path]:
        """Where the files are."""
        return [DATA / name for name in self.files]


CLOUDS = {
    "CSite3": Cloud(("isprs/CSite3.laz",), 2.5, 0.6),
    "FSite5": Cloud(("isprs/FSite5.laz",), 2.5, 1.4),
    "hawaii_pass": Cloud(("als/hawaii_pass.laz",), 1.0, 0.4),
    "bcts": Cloud(("als/bcts_2.laz", "als/bcts_3.laz"), 1.0, 0.2),
    "delft_ahn3": Cloud(("als/delft_ahn3.laz",), 1.0, 0.2),
    "topography": Cloud(("als/topography.laz",), 2.5, 1.0),
}

METHODS: dict[str, Callable[[Cloud], ss.Segmentor]] = {
    "delaunay": lambda cloud: ss.Proximity(cloud.distance),
    "growing": lambda _: ss.RegionGrowing(),
    "growing-radius": lambda cloud: ss.RegionGrowing(search_radius=cloud.distance),
    "dbscan": lambda cloud: ss.Dbscan(cloud.distance),
    "radius": lambda cloud: ss.Proximity(cloud.distance, graph="radius"),
    "delaunay-xy": lambda cloud: ss.Proximity(cloud.flat, metric="xy"),
}


class Points(NamedTuple):
    """A cloud in memory."""

    lattice: Lattice
    steps: NDArray[np.float64]
    times: NDArray[np.float64] | None

    def positions(self, order: Ids) -> NDArray[np.float64]:
        """Coordinates in some order, (n, 3)."""
        return self.lattice.to_coordinates(self.steps[order])

    def write(self, path: Path, order: Ids) -> Path:
        """Write the cloud in some order, on the same lattice."""
        header = laspy.LasHeader(point_format=1, version="1.2")
        header.scales, header.offsets = np.array(self.lattice.scale), np.array(self.lattice.offset)
        las = laspy.LasData(header)
        las.X, las.Y, las.Z = self.steps[order].astype(np.int32).T
        if self.times is not None:
            las.gps_time = self.times[order]
        las.write(path)
        return path


@functools.lru_cache(maxsize=1)
def load(cloud: Cloud) -> Points:
    """Read a cloud as it is stored; the last one is kept."""
    opened = open_cloud(cloud.paths)
    names = ("gps_time",) if "gps_time" in opened.dimensions else ()
    chunks = list(opened.chunks(1_000_000, names))
    times = np.concatenate([chunk.attributes["gps_time"] for chunk in chunks]) if names else None
    return Points(opened.lattice, np.concatenate([chunk.points for chunk in chunks]), times)


class Subject:
    """A cloud, a method, and the static results that runs are compared with."""

    def __init__(self, cloud: str, method: str) -> None:
        self.cloud = CLOUDS[cloud]
        self.segmentor = METHODS[method](self.cloud)

    @functools.cached_property
    def of_file(self) -> Ids:
        """Static result of the files, decided on their lattice."""
        return ss.segment_static(self.cloud.paths, self.segmentor)

    @functools.cached_property
    def of_array(self) -> Ids:
        """Static result of real coordinates, which are granted the rounding of their last digit."""
        points = load(self.cloud)
        return ss.segment_static(points.positions(np.arange(len(points.steps))), self.segmentor)

    def static(self, source: Any, order: Ids) -> Ids:
        """Compute the static result of the points in some order.

        Where some of the nearest neighbors are equally far away, the first in the order count. So features, what is
        grown by them, and border points of DBSCAN that are equally near to two core points depend on the order.
        """
        if isinstance(self.segmentor, (ss.RegionGrowing, ss.Dbscan)):
            return ss.segment_static(source, self.segmentor)
        return (self.of_file if isinstance(source, Path) else self.of_array)[order]


class Order(NamedTuple):
    """An order of the points of a cloud, cut into spans."""

    name: str
    order: Ids
    spans: ss.SpanByCount | ss.SpanByTime
    cuts: Ids
    """Where a live source begins a new array."""

    @property
    def is_random(self) -> bool:
        """Whether nobody measured in this order."""
        return self.name.startswith("random")


def orders(points: Points, seeds: int) -> Iterator[Order]:
    """By count, by time if there is one, and in random orders of spans by count."""
    count = -(-len(points.steps) // SPANS)
    stored = np.arange(len(points.steps))
    cuts = stored[count::count]
    yield Order("by count", stored, ss.SpanByCount(count), cuts)
    if points.times is not None:
        # Between two strips nothing is measured.
        seconds = float(np.clip(np.diff(np.sort(points.times)), 0, 1).sum()) / SPANS
        number = np.floor(points.times / seconds)
        yield Order("by time", stored, ss.SpanByTime(seconds), np.flatnonzero(np.diff(number)) + 1)
    for seed in range(seeds):
        pieces = np.split(stored, cuts)
        shuffled = [pieces[k] for k in np.random.default_rng(seed).permutation(len(pieces))]
        ends = np.cumsum([len(piece) for piece in shuffled])[:-1]
        yield Order(f"random {seed}", np.concatenate(shuffled), ss.SpanByCount(count), ends)
