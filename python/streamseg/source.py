"""Any source of points as chunks for the core: files, an array, or arrays that keep arriving."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from io import IOBase
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._core import Plan, SpanByScanLine, SpanByTime, SpanByWidth, meant_attribute
from .errors import InvalidInput, warn
from .io import Cloud, open_cloud

PathLike = str | Path
Spans = Any
# Of an array the values of each attribute; of a live source the names of those that its items bring along.
Attributes = Mapping[str, ArrayLike] | Sequence[str]

# Points that are handed to the core at a time.
_CHUNK = 250_000

# A scan line with more points than this is none.
_LONGEST_LINE = 1_000_000

# Kinds of arrays that NumPy would make numbers of: complex, times, texts.
_NO_NUMBERS = "cmMSUV"

# What a chunk is for the core: (n, 3) points, and one (n,) array per attribute that the spans need.
CoreChunk = tuple[ArrayLike, tuple[ArrayLike, ...]]


class Source(NamedTuple):
    """Where points come from.

    chunks : yields what the core takes, with the attributes of the given names, each time it is called
    attributes : names of the attributes that can be asked for
    has_more : whether there may be others too, as in a live source, which has announced nothing
    stored : whether the points are there already and may be in any order, as in a file or an array
    scale, offset : the lattice of the points; None for real coordinates
    point_count : how many points are announced, if known
    damage : tells, after reading, what could not be read
    name : for people and manifests
    digests : tells, once all has been read, how many points each file has, with a checksum; None if unknown
    extent_x : how far the points reach along x, if known without reading them
    can_be_stored : whether it has an end, so that spans by width may be laid out before the first is given
    caution : one sentence, if distances between the points are not what they seem
    """

    chunks: Callable[[Sequence[str]], Iterator[CoreChunk]]
    stored: bool
    attributes: tuple[str, ...] = ()
    has_more: bool = False
    scale: tuple[float, float, float] | None = None
    offset: tuple[float, float, float] | None = None
    point_count: int | None = None
    damage: Callable[[], str | None] = lambda: None
    name: str = "array"
    digests: Callable[[], list[str] | None] = lambda: None
    extent_x: float | None = None
    can_be_stored: bool = False
    caution: str | None = None

    @property
    def lattice(self) -> tuple[tuple[float, float, float], tuple[float, float, float]] | None:
        """Scale and offset; None for real coordinates."""
        return None if self.scale is None or self.offset is None else (self.scale, self.offset)

    def with_caution(self, promise: str) -> str:
        """Say beside a promise what its distances are."""
        return f"{promise}; but {self.caution}" if self.caution else promise


def open_source(source: Any, attributes: Attributes | None = None) -> Source:
    """Make a `Source` of a path, several paths, a cloud, an array, or an iterable of arrays."""
    if isinstance(source, Source):
        return source
    if isinstance(source, Cloud):
        return _of_cloud(source)
    if isinstance(source, (str, Path)):
        return _of_cloud(open_cloud(source))
    if hasattr(source, "__array__") or isinstance(source, memoryview) or _is_nested_list(source):
        return _of_array(_as_array(source), attributes or {})
    if isinstance(source, Sequence) and source and all(isinstance(item, (str, Path)) for item in source):
        return _of_cloud(open_cloud(source))
    if isinstance(source, Iterable) and not isinstance(source, (bytes, bytearray, IOBase)):
        if isinstance(attributes, Mapping):
            raise InvalidInput(
                "attributes is a mapping, expected names, because the items of a live source bring theirs along: "
                f"(points, {{{next(iter(attributes), 'Intensity')!r}: …}})"
            )
        return _of_iterable(source, attributes or ())
    raise InvalidInput(
        f"source is {type(source).__name__}, allowed: a path, several paths, an (n, 3) array, or an iterable of arrays"
    )


def laid_out(source: Source, spans: Spans, *, read_twice: bool = False) -> Source:
    """Take a list of arrays as stored if spans by width need it: any of its points may be the first of a slab."""
    is_needed = read_twice or isinstance(spans, (SpanByWidth, Plan))
    return as_stored(source) if is_needed else source


def as_stored(source: Source) -> Source:
    """Take a list of arrays as stored: it can be read to its end, and again."""
    return source._replace(stored=True) if source.can_be_stored else source


def needed_by(spans: Spans) -> tuple[str, ...]:
    """Name the attributes that spans are cut by."""
    if isinstance(spans, SpanByTime):
        return ("gps_time",)
    if isinstance(spans, SpanByScanLine):
        return ("scan_direction_flag", "edge_of_flight_line")
    return ()


def with_lines(chunks: Iterator[CoreChunk]) -> Iterator[CoreChunk]:
    """Warn if no scan line ends for long: what is one span has to fit in memory."""
    points: int | None = 0
    direction = None
    for chunk in chunks:
        if points is not None:
            directions, edges = (np.asarray(values) for values in chunk[1][:2])
            direction = directions[0] if direction is None and len(directions) else direction
            ends = np.any(directions != direction) or np.any(edges)
            points = None if ends else points + len(directions)
        if points is not None and points > _LONGEST_LINE:
            _warn_of_line(points)
            points = None
        yield chunk
    if points:
        _warn_of_line(points)


def _warn_of_line(points: int) -> None:
    warn(
        f"not one scan line ends in the first {points:,} points, so they are one span: scan_direction_flag never "
        "changes, and edge_of_flight_line is nowhere set; use spans by width, time or count"
    )


def _is_nested_list(source: Any) -> bool:
    """Whether it is a plain list of points, as people type it in, and not a list of arrays."""
    if not isinstance(source, list):
        return False
    first = source[0] if source else ()
    return isinstance(first, (list, tuple)) and all(isinstance(value, (int, float)) for value in first)


def _as_array(source: Any) -> NDArray[Any]:
    if isinstance(source, np.ma.MaskedArray) and source.dtype.kind in "fiu":
        # What is masked has no value, like NaN.
        return np.where(np.ma.getmaskarray(source), np.nan, np.ma.getdata(source))
    try:
        return np.asarray(source)
    except ValueError as error:
        raise InvalidInput(f"points is no array of numbers ({error}), expected shape (n, 3)") from None


def _of_cloud(cloud: Cloud) -> Source:
    def chunks(names: Sequence[str]) -> Iterator[CoreChunk]:
        for chunk in cloud.chunks(_CHUNK, tuple(dict.fromkeys(names))):
            yield chunk.points, tuple(chunk.attributes[name] for name in names)

    lattice = None if cloud.lattice.is_identity else cloud.lattice
    if cloud.caution:
        warn(cloud.caution)
    return Source(
        chunks,
        stored=True,
        attributes=cloud.dimensions,
        scale=lattice and lattice.scale,
        offset=lattice and lattice.offset,
        point_count=cloud.point_count,
        damage=lambda: cloud.damage,
        name=", ".join(str(path) for path in cloud.paths),
        digests=lambda: cloud.digests,
        extent_x=cloud.extent_x,
        caution=cloud.caution,
    )


def _as_points(points: NDArray[Any]) -> NDArray[Any]:
    if points.dtype.kind in ("b", *_NO_NUMBERS) and points.dtype.names is None:
        raise InvalidInput(f"points is an array that is no array of numbers ({points.dtype}), expected shape (n, 3)")
    return points


def _of_array(points: NDArray[Any], attributes: Attributes) -> Source:
    if points.size and (points.ndim != 2 or points.shape[1] != 3):
        raise InvalidInput(f"points has shape {points.shape}, expected (n, 3): x, y and z")
    _as_points(points)
    if not isinstance(attributes, Mapping):
        given = type(attributes).__name__
        raise InvalidInput(
            f"attributes is a {given}, expected a mapping of name to (n,) array, such as {{'Intensity': …}}"
        )
    if odd := [name for name in attributes if not isinstance(name, str)]:
        raise InvalidInput(f"attributes has the name {odd[0]!r}, expected text, such as 'Intensity'")
    columns = {name: _column(name, values, len(points)) for name, values in attributes.items()}

    def chunks(names: Sequence[str]) -> Iterator[CoreChunk]:
        wanted = [_found(columns, name) for name in names]
        cuts = (slice(start, start + _CHUNK) for start in range(0, len(points), _CHUNK))
        return ((points[cut], tuple(column[cut] for column in wanted)) for cut in cuts)

    return Source(
        chunks, stored=True, attributes=tuple(columns), point_count=len(points), extent_x=_extent_along_x(points)
    )


def _extent_along_x(points: NDArray[Any]) -> float | None:
    """Tell how far finite points reach along x."""
    if not points.size or points.dtype.kind not in "fiu":
        return None
    x = points[:, 0]
    x = x[np.isfinite(x)]
    return float(x.max()) - float(x.min()) if x.size else None


def _column(name: str, values: ArrayLike, count: int) -> NDArray[Any]:
    column = _as_array(values)
    if column.dtype.kind in _NO_NUMBERS:
        raise InvalidInput(f"{name} is no array of numbers ({column.dtype}), expected shape ({count},)")
    if column.shape != (count,):
        raise InvalidInput(f"{name} has shape {column.shape}, expected ({count},): one value per point")
    return column


def _found(columns: Mapping[str, NDArray[Any]], name: str) -> NDArray[Any]:
    """Look a name up: the column whose name is the most like it."""
    found = meant_attribute(name, [other for other in columns if isinstance(other, str)])
    if found is not None:
        return columns[found]
    given = ", ".join(columns) or "none"
    raise InvalidInput(f"the attribute {name!r} is needed (attributes={{{name!r}: …}}), given: {given}")


def _of_iterable(source: Iterable[Any], announced: Attributes) -> Source:
    def chunks(names: Sequence[str]) -> Iterator[CoreChunk]:
        for item in source:
            points, attributes = item if _has_attributes(item) else (item, {})
            points = _as_points(_as_array(points))
            count = len(points) if points.ndim and names else 0
            yield points, tuple(_column(name, _found(attributes, name), count) for name in names)

    # A list can be read to its end; a generator may have none, so only order tells where a slab ends.
    return Source(
        chunks,
        stored=False,
        attributes=tuple(announced),
        has_more=True,
        name="iterable of arrays",
        can_be_stored=isinstance(source, Sequence),
    )


def _has_attributes(item: Any) -> bool:
    return isinstance(item, tuple) and len(item) == 2 and isinstance(item[1], Mapping)


def counted(source: Source, on_read: Callable[[int], None]) -> Source:
    """Tell how many points have been read, chunk by chunk."""

    def chunks(names: Sequence[str]) -> Iterator[CoreChunk]:
        read = 0
        for points, values in source.chunks(names):
            read += len(np.asarray(points))
            on_read(read)
            yield points, values

    return source._replace(chunks=chunks)
