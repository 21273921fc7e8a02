"""Labelled clouds written as text, and segment ids alone as a NumPy file."""

from __future__ import annotations

from decimal import Decimal
from typing import TYPE_CHECKING, Any, BinaryIO, cast

import numpy as np
from numpy.lib import format as npy_format

from ..errors import InvalidInput
from .axes import axes_of, listed
from .labels import NO_SEGMENT, SEGMENT_DIMENSION
from .spelling import letters_of
from .text_lines import BOM, to_bytes, to_text

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from .cloud import Cloud
    from .npy import NpySource
    from .text import TextLayout, TextSource

_POINTS_AT_ONCE = 100_000
_MOST_DECIMALS = 12
_NPY_HEADER_BYTES = 128


class LineSink:
    """Text in, text out: each line is kept and its segment id appended.

    A last column called ``SegmentID`` is of an earlier run and replaced. Text cannot say of other names whether they
    are, so nothing that is there is called like the ids.

    Raises
    ------
    InvalidInput
        Lines of several files would not have the same columns, or two columns the same name.
    """

    def __init__(self, cloud: Cloud, id_name: str = SEGMENT_DIMENSION) -> None:
        self._id_name = id_name
        self._cloud = cloud
        self._sources = cast("tuple[TextSource, ...]", cloud.sources)
        for source in self._sources[1:]:
            _require_same_columns(self._sources[0], source)
        layout = self._sources[0].layout
        is_named = layout.header is not None
        # Files without names have the columns of the first.
        self._replaces = is_named and id_name == SEGMENT_DIMENSION == layout.names[-1]
        if is_named:
            _require_free_name(self._sources[0], layout.names[:-1] if self._replaces else layout.names, id_name)

    def begin(self, file: BinaryIO) -> None:
        """Write the line of names, if the first file has one."""
        self._file = file
        layout = self._sources[0].layout
        if layout.has_bom:
            file.write(BOM)
        if layout.header is not None:
            header = layout.header.rstrip()
            if layout.ends_in_delimiter:
                header = header.removesuffix(layout.header_joiner.strip())
            kept = _without_last(header, layout.header_joiner) if self._replaces else header
            file.write(to_bytes(f"{kept}{layout.header_joiner}{to_text(self._id_name.encode())}\n"))

    def blocks(self) -> Iterator[tuple[int, Any]]:
        """Yield the number of points and their lines, per block."""
        self._cloud.damage = None
        for index, source in enumerate(self._sources):
            with self._cloud.witnesses[index].reading() as reading:
                for lines, points in source.lines(_POINTS_AT_ONCE):
                    reading.add(points)
                    yield len(lines), (index, lines)
                reading.is_damaged = source.damage is not None
            self._cloud.note_damage(source)

    def append(self, block: tuple[int, list[str]], ids: NDArray[np.int64], kept: NDArray[np.bool_]) -> int:
        """Write those lines of the block that are `kept`."""
        index, lines = block
        if not kept.all():
            lines, ids = [line for line, keep in zip(lines, kept.tolist(), strict=True) if keep], ids[kept]
        layout = self._sources[index].layout
        if self._replaces:
            lines = [_without_last(line, layout.delimiter) for line in lines]
        line_end = f"{layout.joiner}%d\n"
        pairs = zip(lines, ids.tolist(), strict=True)
        self._file.write(to_bytes("".join(map(f"%s{line_end}".__mod__, pairs))))
        return len(lines)

    def finish(self) -> None:
        """Nothing is left to do."""


def _without_last(line: str, delimiter: str | None) -> str:
    """Take the last column away."""
    return line.rstrip().rsplit(delimiter if delimiter != " " else None, 1)[0]


def _require_free_name(source: TextSource, kept: Sequence[str], id_name: str) -> None:
    """Refuse a name of the ids that one of the columns beside them has, or by which x, y and z are another."""
    taken = next((name for name in kept if letters_of(name) == letters_of(id_name)), None)
    if taken is not None:
        raise InvalidInput(
            f"{source.path.name} has a column {taken!r} already, and text does not say who has written it; give the "
            "ids another name with id_name (--id-name), or take that column out"
        )
    if axes_of((*kept, id_name)).places != source.layout.axes.places:
        raise InvalidInput(
            f"{source.path.name} with a column {id_name!r} would not say any more where x, y and z are; give the ids "
            "another name with id_name (--id-name)"
        )


def _require_same_columns(first: TextSource, other: TextSource) -> None:
    """Refuse files that cannot become one: what stands in a column would depend on the line."""
    ours, theirs = first.layout, other.layout
    if (ours.delimiter, ours.names) == (theirs.delimiter, theirs.names):
        return
    is_nameless = theirs.header is None and ours.xyz == theirs.xyz and len(ours.names) == len(theirs.names)
    if is_nameless and ours.delimiter == theirs.delimiter:
        return
    raise InvalidInput(
        f"{first.path} and {other.path} cannot become one text file: their columns are {_listed(ours)} and "
        f"{_listed(theirs)}; write .las, .laz or .npy"
    )


def _listed(layout: TextLayout) -> str:
    mark = {None: "blanks", "\t": "tabs"}.get(layout.delimiter, f"{layout.delimiter!r}")
    return f"{listed(layout.names)} (between {mark})"


class CoordinateSink:
    """Anything in, text out: x y z and the segment id. A ``.csv`` has commas and a line of names."""

    def __init__(self, cloud: Cloud, comma_separated: bool, id_name: str = SEGMENT_DIMENSION) -> None:
        self._cloud = cloud
        self._header = f"x,y,z,{id_name}\n" if comma_separated else ""
        number = _number_format(cloud)
        self._line = ("," if comma_separated else " ").join((number, number, number, "%d")) + "\n"

    def begin(self, file: BinaryIO) -> None:
        """Write the line of names."""
        self._file = file
        file.write(self._header.encode())

    def blocks(self) -> Iterator[tuple[int, Any]]:
        """Yield the number of points and their coordinates, per block."""
        for chunk in self._cloud.chunks(_POINTS_AT_ONCE):
            yield len(chunk.points), self._cloud.lattice.to_coordinates(chunk.points)

    def append(self, block: NDArray[np.float64], ids: NDArray[np.int64], kept: NDArray[np.bool_]) -> int:
        """Write those points of the block that are `kept`."""
        points = block[kept]
        rows = zip(*points.T.tolist(), ids[kept].tolist(), strict=True)
        self._file.write("".join(map(self._line.__mod__, rows)).encode())
        return len(points)

    def finish(self) -> None:
        """Nothing is left to do."""


class IdSink:
    """Anything in, segment ids out: an ``(n,)`` int64 ``.npy`` whose rows are the points' ids in order.

    Row i belongs to point i. So a point that was not reached keeps its row, with −1, unless no later one was
    reached either.
    """

    def __init__(self, cloud: Cloud) -> None:
        self._cloud = cloud

    def begin(self, file: BinaryIO) -> None:
        """Leave room for the header."""
        self._file = file
        self._rows = self._pending = 0
        file.write(bytes(_NPY_HEADER_BYTES))

    def blocks(self) -> Iterator[tuple[int, Any]]:
        """Yield the number of points per block."""
        for chunk in self._cloud.chunks():
            yield len(chunk.points), None

    def append(self, _block: None, ids: NDArray[np.int64], kept: NDArray[np.bool_]) -> int:
        """Write the ids up to the last point that is `kept`."""
        reached = np.flatnonzero(kept)
        if len(reached) == 0:
            self._pending += len(ids)
            return 0
        stop = int(reached[-1]) + 1
        while self._pending:
            skipped = min(self._pending, _POINTS_AT_ONCE)
            self._write(np.full(skipped, NO_SEGMENT, np.int64))
            self._pending -= skipped
        self._write(np.where(kept[:stop], ids[:stop], NO_SEGMENT))
        self._pending = len(ids) - stop
        return len(reached)

    def finish(self) -> None:
        """Write the header, now that the number of rows is known."""
        self._file.seek(0)
        described = {"shape": (self._rows,), "fortran_order": False, "descr": "<i8"}
        npy_format.write_array_header_1_0(self._file, described)
        if self._file.tell() != _NPY_HEADER_BYTES:
            raise AssertionError(f".npy header took {self._file.tell()} bytes, {_NPY_HEADER_BYTES} were left for it")

    def _write(self, ids: NDArray[np.int64]) -> None:
        self._file.write(ids.astype("<i8").data)
        self._rows += len(ids)


def _number_format(cloud: Cloud) -> str:
    """As many digits as the input has, and no more."""
    if cloud.kind == "las":
        decimals = max(_decimals(value) for value in (*cloud.lattice.scale, *cloud.lattice.offset))
        return f"%.{min(decimals, _MOST_DECIMALS)}f"
    numbers = cast("tuple[NpySource, ...]", cloud.sources)
    return "%.9g" if all(source.number_type == np.float32 for source in numbers) else "%r"


def _decimals(value: float) -> int:
    exponent = Decimal(repr(value)).normalize().as_tuple().exponent
    return max(0, -exponent) if isinstance(exponent, int) else 0
