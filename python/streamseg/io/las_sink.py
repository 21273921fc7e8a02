"""Labelled clouds written as LAS or LAZ."""

from __future__ import annotations

import warnings
from dataclasses import replace
from math import floor
from typing import TYPE_CHECKING, Any, BinaryIO, cast

import numpy as np

from ..errors import InvalidInput, StreamsegWarning
from . import laz
from .cloud import DEFAULT_CHUNK, Chunk, Cloud
from .las import LasSource, new_header, stored_fields
from .las_header import COPC_USER, LASZIP_USER, WAVEFORM_RECORD, Evlr, LasHeader, find_evlrs, new_vlr
from .las_layout import describe_extras, labelled_layout, segment_field
from .lattice import Lattice, Triple

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

_COPIED_AT_ONCE = 1 << 20
_RETURNS_AT = 14
_INT32 = np.iinfo(np.int32)
_LEGACY_LIMIT = 1 << 32
_LAX_USER = b"LAStools"
_NEW_FORMAT = 6
_SINGLE_RETURN = 0x11
_STEPS_OF_SMALL_CLOUDS = 1e6


class LasWriter:
    """Writes packed records, and at the end the header that is true of them."""

    def __init__(self, file: BinaryIO, header: LasHeader, compressed: bool) -> None:
        self._file = file
        self._compressor: Any = None
        if compressed:
            extra = header.record_length - stored_fields(header.point_format).itemsize
            data, start = laz.encoder(file, header.point_format, extra)
            laszip = new_vlr(LASZIP_USER, 22204, data, b"http://laszip.org")
            header = replace(header, vlrs=(*header.vlrs, laszip))
            header = header.patched("B", 104, header.point_format | 0x80)
        self._header = header
        file.write(header.to_bytes())
        if compressed:
            self._compressor = start()
        self.count = 0
        self._returns = np.zeros(16, np.int64)
        self._lowest = np.full(3, np.inf)
        self._highest = np.full(3, -np.inf)

    def append(self, records: NDArray[np.uint8]) -> None:
        """Write ``(n, record_length)`` bytes."""
        if len(records) == 0:
            return
        if self._compressor is not None:
            self._compressor.compress_many(records.reshape(-1))
        else:
            self._file.write(records.data)
        steps = np.ascontiguousarray(records[:, :12]).view("<i4")
        self._lowest = np.minimum(self._lowest, steps.min(axis=0))
        self._highest = np.maximum(self._highest, steps.max(axis=0))
        number_bits = 0b111 if self._header.point_format < _NEW_FORMAT else 0b1111
        self._returns += np.bincount(records[:, _RETURNS_AT] & number_bits, minlength=16)
        self.count += len(records)

    def finish(self, original: BinaryIO | None, evlrs: list[Evlr]) -> None:
        """Copy extended records from the `original` file and bring the header up to date."""
        if self._compressor is not None:
            self._compressor.done()
        header, file = self._header, self._file
        start = file.seek(0, 2)
        if header.minor >= 3:
            header = header.patched("Q", 227, 0)
        for evlr in evlrs:
            if evlr.record_id == WAVEFORM_RECORD and evlr.user == b"LASF_Spec":
                header = header.patched("Q", 227, file.tell())
            assert original is not None
            _copy(original, evlr.start, evlr.stop, file)
        if header.minor >= 4:
            header = header.patched("QI", 235, start if evlrs else 0, len(evlrs))
        file.seek(0)
        file.write(self._with_counts(header).to_bytes())
        file.seek(0, 2)

    def _with_counts(self, header: LasHeader) -> LasHeader:
        lattice = header.lattice
        low, high = (
            steps * np.asarray(lattice.scale) + np.asarray(lattice.offset) for steps in (self._lowest, self._highest)
        )
        by_return = self._returns[1:].tolist()
        fits = header.point_format < _NEW_FORMAT and self.count < _LEGACY_LIMIT
        header = header.patched("6I", 107, *([self.count, *by_return[:5]] if fits else [0] * 6))
        header = header.patched("6d", 179, *np.column_stack((high, low)).ravel().tolist())
        if header.minor >= 4:
            header = header.patched("Q15Q", 247, self.count, *by_return)
        elif not fits:
            raise InvalidInput(f"LAS 1.{header.minor} holds at most {_LEGACY_LIMIT - 1:,} points, got {self.count:,}")
        return header


class RecordSink:
    """LAS and LAZ in, LAS or LAZ out: every dimension and record is kept."""

    def __init__(self, cloud: Cloud, compressed: bool) -> None:
        self._cloud = cloud
        self._sources = cast("tuple[LasSource, ...]", cloud.sources)
        self._compressed = compressed
        self._layout = labelled_layout(self._sources)
        scale_and_offset = (*cloud.lattice.scale, *cloud.lattice.offset)
        self._layout = self._layout._replace(header=self._layout.header.patched("6d", 131, *scale_and_offset))
        self._read = 0

    def begin(self, file: BinaryIO) -> None:
        """Write the header."""
        self._writer = LasWriter(file, self._layout.header, self._compressed)

    def blocks(self) -> Iterator[tuple[int, Any]]:
        """Yield the number of points and the records, per block."""
        self._cloud.damage = None
        for index, source in enumerate(self._sources):
            for records in source.records(DEFAULT_CHUNK):
                self._read += len(records)
                yield len(records), (index, records)
            self._cloud.note_damage(source)

    def append(self, block: tuple[int, NDArray[np.void]], ids: NDArray[np.int64], kept: NDArray[np.bool_]) -> int:
        """Write those records of the block that are `kept`."""
        index, records = block
        if not kept.all():
            records, ids = records[kept], ids[kept]
        packed = self._layout.convert(records, index)
        shift = self._cloud.shifts[index]
        if not shift.is_identity:
            points = np.ascontiguousarray(packed[:, :12]).view("<i4").astype(np.float64)
            shift.apply(points)
            packed[:, :12] = _as_int32(points, self._cloud.lattice, self._sources[index].path.name)
        at = self._layout.segment_at
        packed[:, at : at + 8] = _bytes_of(ids.astype("<i8"))
        self._writer.append(packed)
        return len(records)

    def finish(self) -> None:
        """Write what stands behind the points and the final header."""
        is_same_points = len(self._sources) == 1 and self._writer.count == self._read
        with open(self._sources[0].path, "rb") as original:
            evlrs = [
                evlr
                for evlr in find_evlrs(original, self._sources[0].header)
                # A spatial index counts points, so it is only true of the same points.
                if evlr.user != COPC_USER and (evlr.user != _LAX_USER or is_same_points)
            ]
            self._writer.finish(original, evlrs)


class PointSink:
    """Points from other formats written as LAS 1.4, point format 6, with the segment id as only attribute."""

    def __init__(self, cloud: Cloud, compressed: bool) -> None:
        self._cloud = cloud
        self._compressed = compressed
        self._lattice = fitting_lattice(cloud)
        fields = stored_fields(_NEW_FORMAT)
        header = describe_extras(new_header(), [segment_field()])
        header = header.patched("6d", 131, *self._lattice.scale, *self._lattice.offset)
        self._header = header.patched("BH", 104, _NEW_FORMAT, fields.itemsize + 8)
        self._standard_bytes = fields.itemsize

    def begin(self, file: BinaryIO) -> None:
        """Write the header."""
        self._writer = LasWriter(file, self._header, self._compressed)

    def blocks(self) -> Iterator[tuple[int, Any]]:
        """Yield the number of points and the points, per block."""
        for chunk in self._cloud.chunks(DEFAULT_CHUNK):
            yield len(chunk.points), chunk

    def append(self, block: Chunk, ids: NDArray[np.int64], kept: NDArray[np.bool_]) -> int:
        """Write those points of the block that are `kept`."""
        points, lattice = block.points[kept], self._lattice
        steps = np.rint((points - np.asarray(lattice.offset)) / np.asarray(lattice.scale))
        packed = np.zeros((len(points), self._header.record_length), np.uint8)
        packed[:, :12] = _as_int32(steps, lattice, self._cloud.paths[0].name)
        packed[:, _RETURNS_AT] = _SINGLE_RETURN
        packed[:, self._standard_bytes :] = _bytes_of(ids[kept].astype("<i8"))
        self._writer.append(packed)
        return len(points)

    def finish(self) -> None:
        """Write the final header."""
        self._writer.finish(None, [])


def fitting_lattice(cloud: Cloud) -> Lattice:
    """Choose scale and offset for a cloud of plain coordinates, after a pass over it.

    The offset is the largest whole number not above the smallest coordinate. The scale is 0.001; finer for clouds
    less than 10 units wide, so that the longest side has at least a million steps; coarser, with a warning, where
    0.001 does not fit into 32 bits.
    """
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for chunk in cloud.chunks(DEFAULT_CHUNK):
        if not np.isfinite(chunk.points).all():
            raise InvalidInput(f"{cloud.paths[0]} has coordinates that are not finite numbers, which LAS cannot hold")
        low, high = np.minimum(low, chunk.points.min(axis=0)), np.maximum(high, chunk.points.max(axis=0))
    offset = cast("Triple", tuple(float(floor(value)) for value in low))
    reach = float((high - np.asarray(offset)).max())
    extent = float((high - low).max())
    exponent = -3
    while exponent > -9 and 0 < extent < 10 and extent < _STEPS_OF_SMALL_CLOUDS * 10.0**exponent:
        exponent -= 1
    while reach > _INT32.max * 10.0**exponent:
        exponent += 1
    if exponent > -3:
        warnings.warn(
            f"{cloud.paths[0].name} is {extent:,.0f} units wide: LAS can hold it in steps of {10.0**exponent:g}, "
            "not in the usual 0.001; coordinates are rounded to these steps",
            StreamsegWarning,
            stacklevel=2,
        )
    scale = float(f"1e{exponent}")
    return Lattice((scale, scale, scale), offset)


def _as_int32(steps: NDArray[np.float64], lattice: Lattice, name: str) -> NDArray[np.uint8]:
    if len(steps) and (steps.min() < _INT32.min or steps.max() > _INT32.max):
        raise InvalidInput(
            f"{name} has points too far away for 32 bit steps of scale {lattice.scale} from offset {lattice.offset}; "
            "write the files one by one, or bring them to one coarser scale first"
        )
    return _bytes_of(steps.astype("<i4"))


def _bytes_of(values: NDArray[Any]) -> NDArray[np.uint8]:
    bytes_per_row = values.itemsize * (values.shape[1] if values.ndim == 2 else 1)
    return values.view(np.uint8).reshape(len(values), bytes_per_row)


def _copy(source: BinaryIO, start: int, stop: int, target: BinaryIO) -> None:
    source.seek(start)
    while start < stop:
        block = source.read(min(_COPIED_AT_ONCE, stop - start))
        target.write(block)
        start += len(block)
