"""NumPy files of points as sources, read piece by piece without mapping the file into memory."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from ..errors import FileError, InvalidInput
from .axes import Axes, axes_of, listed
from .cloud import Chunk, damage_sentence
from .coordinate_system import LONGITUDE_LATITUDE
from .lattice import Lattice
from .limits import BLOCK_BYTES
from .npy_header import Header, read_header
from .opening import reading

if TYPE_CHECKING:
    from collections.abc import Generator, Iterator, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

# Whole numbers up to this are exact as float64.
_LARGEST_EXACT = 1 << 53


class NpySource:
    """One ``.npy`` file. See `streamseg.io.cloud.Source`.

    Either an ``(n, 3)`` or wider array of numbers, or a structured ``(n,)`` array with the fields x, y and z. The first
    columns of numbers are x, y and z. The others are called ``column_4``, ``column_5``, ….

    Attributes
    ----------
    coordinate_system : CoordinateSystem or None
        What the names of x and y say of it.
    columns_said : str
        Which columns are x, y and z, for people.
    """

    kind = "npy"

    def __init__(self, path: Path) -> None:
        self.path = path
        self.lattice = Lattice()
        self.damage: str | None = None
        with reading(path) as file:
            header = read_header(file, path)
            self._bytes_of_points = os.fstat(file.fileno()).st_size - header.data_at
        self._header = header
        self.dimensions, axes = _dimensions(header, path)
        x, y, z = axes.places or (0, 1, 2)
        self._xyz = (self.dimensions[x], self.dimensions[y], self.dimensions[z])
        self.point_count: int | None = min(header.shape[0], self._most_points())
        self.number_type = header.dtype if header.dtype.names is None else header.dtype[self._xyz[0]]
        self.coordinate_system = LONGITUDE_LATITUDE if axes.in_degrees else None
        self.columns_said = (
            "x, y and z are columns 1, 2 and 3, which have no names"
            if header.dtype.names is None
            else "x, y and z are fields {}, {} and {}".format(*self._xyz)
        )

    def chunks(self, size: int, attributes: Sequence[str]) -> Iterator[Chunk]:
        """Yield the points as float64."""
        return self._read(size, (*self._xyz, *attributes))

    def _read(self, size: int, names: tuple[str, ...]) -> Generator[Chunk, None, None]:
        self.damage = None
        announced = self._header.shape[0]
        readable = self._readable(names)
        size = min(size, max(1, BLOCK_BYTES // self._bytes_at_once()))
        with reading(self.path) as file:
            for start in range(0, readable, size):
                columns = self._columns(file, start, min(start + size, readable), names)
                points = np.empty((len(columns[0]), 3))
                # Not every NaN is converted without a complaint.
                with np.errstate(all="ignore"):
                    for axis in range(3):
                        points[:, axis] = self._exact(columns[axis])
                others = zip(names[3:], columns[3:], strict=True)
                yield Chunk(points, {name: np.array(column) for name, column in others})
        if readable < announced:
            self.damage = damage_sentence(self.path, readable, announced, "unexpected end of file")

    def _bytes_at_once(self) -> int:
        """Bytes that are read together for each point."""
        return self._header.dtype.itemsize * (1 if self._header.by_column else self._header.width)

    def _most_points(self) -> int:
        """Count the points that the file has room for, whatever it announces; at least one, to be told as damage."""
        items = self._bytes_of_points // self._header.dtype.itemsize
        return max(1, items if self._header.by_column else items // self._header.width)

    def _readable(self, names: tuple[str, ...]) -> int:
        rows = self._header.shape[0]
        items = self._bytes_of_points // self._header.dtype.itemsize
        if not self._header.by_column:
            return min(rows, items // self._header.width)
        last = max(self.dimensions.index(name) for name in names)
        return max(0, min(rows, items - last * rows))

    def _columns(self, file: BinaryIO, start: int, stop: int, names: tuple[str, ...]) -> list[NDArray[Any]]:
        header, count = self._header, stop - start
        if header.by_column:
            rows = header.shape[0]
            return [self._items(file, self.dimensions.index(name) * rows + start, count) for name in names]
        items = self._items(file, start * header.width, count * header.width)
        if header.dtype.names is not None:
            return [items[name] for name in names]
        table = items.reshape(count, header.width)
        return [table[:, self.dimensions.index(name)] for name in names]

    def _items(self, file: BinaryIO, first: int, count: int) -> NDArray[Any]:
        file.seek(self._header.data_at + first * self._header.dtype.itemsize)
        items = np.fromfile(file, self._header.dtype, count)
        if len(items) < count:
            raise FileError(f"{self.path} became shorter while it was read")
        return items

    def _exact(self, column: NDArray[Any]) -> NDArray[Any]:
        """Refuse whole numbers that are no longer told apart as float64."""
        if column.dtype.kind in "iu" and column.dtype.itemsize == 8 and len(column):
            largest = max(abs(int(column.min())), abs(int(column.max())))
            if largest > _LARGEST_EXACT:
                raise InvalidInput(
                    f"{self.path} has coordinates such as {largest}: whole numbers beyond "
                    f"{_LARGEST_EXACT} are not kept apart; take an offset from them"
                )
        return column


def _dimensions(header: Header, path: Path) -> tuple[tuple[str, ...], Axes]:
    names = header.dtype.names
    if names is None:
        others = (f"column_{place}" for place in range(4, header.width + 1))
        return ("x", "y", "z", *others), Axes((0, 1, 2))
    numbers = tuple(name for name in names if header.dtype[name].kind in "fiub")
    axes = axes_of([name if header.dtype[name].kind in "fiu" else "" for name in numbers])
    if axes.places is None:
        raise InvalidInput(f"{path} needs the numeric fields x, y and z; it has {listed(names)}; {axes.problem()}")
    return numbers, axes
