"""LAS and LAZ files as sources; the only importer of laspy."""

from __future__ import annotations

import io
import os
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from ..errors import FileError, InvalidInput, MissingExtra
from . import laz
from .cloud import Chunk, damage_sentence
from .las_header import LASZIP_USER, LasHeader, header_stream, linear_unit

if TYPE_CHECKING:
    from collections.abc import Generator, Iterator, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

try:
    import laspy
except ImportError as error:  # pragma: no cover - depends on the installation
    raise MissingExtra("reading LAS and LAZ needs laspy; install it: pip install laspy[lazrs]") from error

_XYZ = ("X", "Y", "Z")


class LasSource:
    """One LAS or LAZ file. See `streamseg.io.cloud.Source`.

    Points are the raw integers X, Y, Z as float64. Attributes are any dimension that laspy names, bit fields and
    extra bytes included.
    """

    kind = "las"

    def __init__(self, path: Path) -> None:
        self.path = path
        with open(path, "rb") as file:
            self.header = LasHeader.read(file, path)
            self._bytes_of_points = _size_of(file) - self.header.points_at
        self.point_format = self._parse_point_format()
        self.record_type: np.dtype[Any] = self.point_format.dtype()
        self.point_count: int | None = self.header.point_count
        self.lattice = self.header.lattice
        self.dimensions: tuple[str, ...] = tuple(self.point_format.dimension_names)
        self.unit = linear_unit(self.header)
        self.damage: str | None = None

    def chunks(self, size: int, attributes: Sequence[str]) -> Iterator[Chunk]:
        """Yield points in the file's own lattice units."""
        for records in self._records(size, laz.layers((*_XYZ, *attributes))):
            points = np.empty((len(records), 3))
            for axis, name in enumerate(_XYZ):
                points[:, axis] = records[name]
            yield Chunk(points, {name: self._dimension(records, name) for name in attributes})

    def records(self, size: int) -> Iterator[NDArray[np.void]]:
        """Yield the points as they are stored: ``(n,)`` arrays of packed records with every dimension."""
        return self._records(size, laz.ALL_FIELDS)

    def _records(self, size: int, fields: int) -> Generator[NDArray[np.void], None, None]:
        announced, done, reason = self.header.point_count, 0, None
        self.damage = None
        with open(self.path, "rb") as file:
            blocks: Generator[bytes | bytearray, None, str | None]
            blocks = self._compressed(file, size, fields) if self.header.is_compressed else self._plain(file, size)
            while True:
                try:
                    block = next(blocks)
                except StopIteration as end:
                    reason = end.value
                    break
                records = np.frombuffer(block, self.record_type)
                for start in range(0, len(records), size):
                    yield records[start : start + size]
                done += len(records)
        if done < announced:
            self.damage = damage_sentence(self.path, done, announced, reason or "unexpected end of data")

    def _compressed(self, file: BinaryIO, size: int, fields: int) -> Generator[bytes | bytearray, None, str | None]:
        header = self.header
        laszip = next((vlr for vlr in header.vlrs if vlr.user == LASZIP_USER), None)
        if laszip is None:
            raise FileError(f"{self.path} has a damaged header: the laszip record of its compressed points is missing")
        points = laz.LazPoints(header.points_at, laszip.data, header.point_count, header.record_length)
        return laz.decoded_blocks(file, points, size, fields)

    def _plain(self, file: BinaryIO, size: int) -> Generator[bytes | bytearray, None, str | None]:
        length = self.header.record_length
        left = min(self.header.point_count, self._bytes_of_points // length)
        file.seek(self.header.points_at)
        while left > 0:
            block = file.read(min(size, left) * length)
            block = block[: len(block) // length * length]
            if not block:
                break
            yield block
            left -= len(block) // length
        return "unexpected end of file"

    def _dimension(self, records: NDArray[np.void], name: str) -> NDArray[Any]:
        return np.ascontiguousarray(laspy.PackedPointRecord(records, self.point_format)[name])

    def _parse_point_format(self) -> Any:
        try:
            parsed = laspy.LasHeader.read_from(header_stream(self.header)).point_format
            itemsize = parsed.dtype().itemsize
        except Exception as error:  # laspy reports a damaged record as whatever its parser ran into
            raise FileError(f"{self.path} has a damaged header: {error}") from error
        if itemsize != self.header.record_length:
            raise FileError(
                f"{self.path} has a damaged header: its points have {self.header.record_length} bytes, the dimensions "
                f"it lists {itemsize}"
            )
        return parsed


def stored_fields(point_format: int) -> np.dtype[Any]:
    """Return the packed record of a point format without extra bytes."""
    fields: np.dtype[Any] = laspy.PointFormat(point_format).dtype()
    return fields


def new_header() -> LasHeader:
    """Make an empty LAS 1.4 header for point format 6."""
    stream = io.BytesIO()
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.global_encoding.wkt = True  # required from point format 6 on
    header.generating_software = "streamseg"
    header.write_to(stream)
    raw = stream.getvalue()
    return LasHeader(raw, (), b"")


def require_dimension(source: LasSource, name: str) -> None:
    """Raise InvalidInput unless the file has the dimension."""
    if name not in source.dimensions:
        raise InvalidInput(f"{source.path} has no dimension {name!r}; there are: {', '.join(source.dimensions)}")


def _size_of(file: BinaryIO) -> int:
    return os.fstat(file.fileno()).st_size
