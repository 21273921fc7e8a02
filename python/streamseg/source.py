"""Any source of points as chunks for the core: files, an array, or arrays that keep arriving."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._core import SpanByScanLine, SpanByTime, SpanByWidth
from .errors import InvalidInput
from .io import Cloud, open_cloud

PathLike = str | Path
Spans = Any

# Points that are handed to the core at a time.
_CHUNK = 250_000

# What a chunk is for the core: (n, 3) points, and one (n,) array per attribute that the spans need.
CoreChunk = tuple[ArrayLike, tuple[ArrayLike, ...]]


class Source(NamedTuple):
    """Where points come from.

    chunks : yields what the core takes, each time it is called
    stored : whether the points are there already and may be in any order, as in a file or an array
    scale, offset : the lattice of the points; None for real coordinates
    point_count : how many points are announced, if known
    damage : tells, after reading, what could not be read
    name : for people and manifests
    """

    chunks: Callable[[], Iterator[CoreChunk]]
    stored: bool
    scale: tuple[float, float, float] | None = None
    offset: tuple[float, float, float] | None = None
    point_count: int | None = None
    damage: Callable[[], str | None] = lambda: None
    name: str = "array"


def open_source(source: Any, spans: Spans, attributes: Mapping[str, ArrayLike] | None = None) -> Source:
    """Make a `Source` of a path, several paths, a cloud, an array, or an iterable of arrays."""
    if isinstance(source, Source):
        return source
    if isinstance(source, Cloud):
        return _of_cloud(source, spans)
    if isinstance(source, (str, Path)):
        return _of_cloud(open_cloud(source), spans)
    if isinstance(source, Sequence) and source and all(isinstance(item, (str, Path)) for item in source):
        return _of_cloud(open_cloud(source), spans)
    if hasattr(source, "__array__") or _is_nested_list(source):
        return _of_array(_as_array(source), spans, attributes or {})
    if isinstance(source, Iterable) and not isinstance(source, bytes):
        return _of_iterable(source, spans)
    raise InvalidInput(
        f"source is {type(source).__name__}, allowed: a path, several paths, an (n, 3) array, or an iterable of arrays"
    )


def _is_nested_list(source: Any) -> bool:
    """Whether it is a plain list of points, as people type it in, and not a list of arrays."""
    if not isinstance(source, list):
        return False
    first = source[0] if source else ()
    return isinstance(first, (list, tuple)) and all(isinstance(value, (int, float)) for value in first)


def _as_array(source: Any) -> NDArray[Any]:
    try:
        return np.asarray(source)
    except ValueError as error:
        raise InvalidInput(f"points is no array of numbers ({error}), expected shape (n, 3)") from None


def _needed(spans: Spans) -> tuple[str, ...]:
    if isinstance(spans, SpanByTime):
        return ("gps_time",)
    if isinstance(spans, SpanByScanLine):
        return ("scan_direction_flag", "edge_of_flight_line")
    return ()


def _of_cloud(cloud: Cloud, spans: Spans) -> Source:
    names = _needed(spans)

    def chunks() -> Iterator[CoreChunk]:
        for chunk in cloud.chunks(_CHUNK, names):
            yield chunk.points, tuple(chunk.attributes[name] for name in names)

    lattice = None if cloud.lattice.is_identity else cloud.lattice
    return Source(
        chunks,
        stored=True,
        scale=lattice and lattice.scale,
        offset=lattice and lattice.offset,
        point_count=cloud.point_count,
        damage=lambda: cloud.damage,
        name=", ".join(str(path) for path in cloud.paths),
    )


def _of_array(points: NDArray[Any], spans: Spans, attributes: Mapping[str, ArrayLike]) -> Source:
    if points.size and (points.ndim != 2 or points.shape[1] != 3):
        raise InvalidInput(f"points has shape {points.shape}, expected (n, 3): x, y and z")
    values = _attributes_of(attributes, spans, len(points))

    def chunks() -> Iterator[CoreChunk]:
        for start in range(0, len(points), _CHUNK):
            yield points[start : start + _CHUNK], tuple(value[start : start + _CHUNK] for value in values)

    return Source(chunks, stored=True, point_count=len(points))


def _attributes_of(attributes: Mapping[str, ArrayLike], spans: Spans, count: int) -> tuple[NDArray[Any], ...]:
    values = []
    for name in _needed(spans):
        if name not in attributes:
            given = ", ".join(attributes) or "none"
            raise InvalidInput(f"{spans!r} needs the attribute {name!r} (attributes={{{name!r}: …}}), given: {given}")
        value = np.asarray(attributes[name])
        if value.shape != (count,):
            raise InvalidInput(f"{name} has shape {value.shape}, expected ({count},): one value per point")
        values.append(value)
    return tuple(values)


def _of_iterable(source: Iterable[Any], spans: Spans) -> Source:
    def chunks() -> Iterator[CoreChunk]:
        for item in source:
            points, attributes = item if _has_attributes(item) else (item, {})
            count = len(_as_array(points)) if _needed(spans) else 0
            yield points, _attributes_of(attributes, spans, count)

    # A list can be read to its end; a generator may have none, so only order tells where a slab ends.
    stored = isinstance(source, Sequence) and isinstance(spans, SpanByWidth)
    return Source(chunks, stored=stored, name="iterable of arrays")


def _has_attributes(item: Any) -> bool:
    return isinstance(item, tuple) and len(item) == 2 and isinstance(item[1], Mapping)


def counted(source: Source, on_read: Callable[[int], None]) -> Source:
    """Tell how many points have been read, chunk by chunk."""

    def chunks() -> Iterator[CoreChunk]:
        read = 0
        for points, values in source.chunks():
            read += len(np.asarray(points))
            on_read(read)
            yield points, values

    return source._replace(chunks=chunks)
