"""NumPy files of points as sources, read piece by piece without mapping the file into memory."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple

import numpy as np
from numpy.lib import format as npy_format

from ..errors import FileError, InvalidInput
from .cloud import Chunk, damage_sentence
from .lattice import Lattice

if TYPE_CHECKING:
    from collections.abc import Generator, Iterator, Sequence
    from pathlib import Path

    from numpy.typing import NDArray


class _Header(NamedTuple):
    shape: tuple[int, ...]
    by_column: bool
    dtype: np.dtype[Any]
    data_at: int


class NpySource:
    """One ``.npy`` file. See `streamseg.io.cloud.Source`.

    Either an ``(n, 3)`` or wider array of numbers, whose first columns are x, y and z and whose others are called
    ``column_4``, ``column_5``, …; or a structured ``(n,)`` array with the fields x, y and z.
    """

    kind = "npy"

    def __init__(self, path: Path) -> None:
        self.path = path
        self.lattice = Lattice()
        self.damage: str | None = None
        with open(path, "rb") as file:
            header = _read_header(file, path)
            self._bytes_of_points = os.fstat(file.fileno()).st_size - header.data_at
        self._header = header
        self.dimensions, self._xyz = _dimensions(header, path)
        self.point_count: int | None = header.shape[0]
        self.number_type = header.dtype if header.dtype.names is None else header.dtype[self._xyz[0]]

    def chunks(self, size: int, attributes: Sequence[str]) -> Iterator[Chunk]:
        """Yield the points as float64."""
        return self._read(size, (*self._xyz, *attributes))

    def _read(self, size: int, names: tuple[str, ...]) -> Generator[Chunk, None, None]:
        self.damage = None
        announced = self._header.shape[0]
        readable = self._readable(names)
        with open(self.path, "rb") as file:
            for start in range(0, readable, size):
                columns = self._columns(file, start, min(start + size, readable), names)
                points = np.empty((len(columns[0]), 3))
                for axis in range(3):
                    points[:, axis] = columns[axis]
                others = zip(names[3:], columns[3:], strict=True)
                yield Chunk(points, {name: np.array(column) for name, column in others})
        if readable < announced:
            self.damage = damage_sentence(self.path, readable, announced, "unexpected end of file")

    def _readable(self, names: tuple[str, ...]) -> int:
        rows, width = self._header.shape[0], self._width
        items = self._bytes_of_points // self._header.dtype.itemsize
        if not self._header.by_column:
            return min(rows, items // width)
        last = max(self.dimensions.index(name) for name in names)
        return max(0, min(rows, items - last * rows))

    def _columns(self, file: BinaryIO, start: int, stop: int, names: tuple[str, ...]) -> list[NDArray[Any]]:
        header, count = self._header, stop - start
        if header.by_column:
            rows = header.shape[0]
            return [self._items(file, self.dimensions.index(name) * rows + start, count) for name in names]
        items = self._items(file, start * self._width, count * self._width)
        if header.dtype.names is not None:
            return [items[name] for name in names]
        table = items.reshape(count, self._width)
        return [table[:, self.dimensions.index(name)] for name in names]

    def _items(self, file: BinaryIO, first: int, count: int) -> NDArray[Any]:
        file.seek(self._header.data_at + first * self._header.dtype.itemsize)
        items = np.fromfile(file, self._header.dtype, count)
        if len(items) < count:
            raise FileError(f"{self.path} became shorter while it was read")
        return items

    @property
    def _width(self) -> int:
        return self._header.shape[1] if len(self._header.shape) == 2 else 1


def _read_header(file: BinaryIO, path: Path) -> _Header:
    if os.fstat(file.fileno()).st_size == 0:
        raise FileError(f"{path} is empty, a .npy file was expected")
    try:
        version = npy_format.read_magic(file)
        read = npy_format.read_array_header_1_0 if version == (1, 0) else npy_format.read_array_header_2_0
        shape, by_column, dtype = read(file)
    except (ValueError, EOFError, OSError) as error:
        raise FileError(f"{path} is no .npy file that can be read: {error}") from error
    return _Header(shape, bool(by_column) and len(shape) == 2, dtype, file.tell())


def _dimensions(header: _Header, path: Path) -> tuple[tuple[str, ...], tuple[str, str, str]]:
    shape, dtype = header.shape, header.dtype
    if dtype.names is not None and len(shape) == 1:
        by_lower = {name.lower(): name for name in dtype.names}
        found = [by_lower.get(axis) for axis in "xyz"]
        numbers = [name for name in dtype.names if dtype[name].kind in "fiub"]
        if any(name not in numbers for name in found):
            raise InvalidInput(f"{path} needs the numeric fields x, y and z; it has {', '.join(dtype.names)}")
        x, y, z = (str(name) for name in found)
        return tuple(numbers), (x, y, z)
    if dtype.kind not in "fiu":
        raise InvalidInput(f"{path} holds {dtype}, expected numbers: float or integer")
    if len(shape) != 2 or shape[1] < 3:
        raise InvalidInput(f"{path} has shape {shape}, expected (n, 3) or wider")
    return ("x", "y", "z", *(f"column_{i}" for i in range(4, shape[1] + 1))), ("x", "y", "z")
