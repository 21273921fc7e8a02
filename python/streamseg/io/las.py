"""LAS and LAZ files as sources, read by laspy.

laspy believes every count and size in a header; those that could make it run on for hours or fill the memory are
checked first.
"""

from __future__ import annotations

import io
import mmap
import os
import struct
from typing import TYPE_CHECKING, Any, BinaryIO, cast

import numpy as np

from ..errors import FileError, MissingExtra
from . import laz
from .cloud import Chunk, damage_sentence
from .coordinate_system import looks_like_degrees, read_system
from .las_dimensions import Dimensions
from .las_records import EVLR, VLR, WAVEFORMS, Record, WithStart, legible, whole_records
from .lattice import Lattice

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

try:
    import laspy
except ImportError as error:  # pragma: no cover - depends on the installation
    raise MissingExtra("reading and writing LAS needs laspy; install it: pip install laspy[lazrs]") from error

__all__ = ["LasSource", "laspy"]

# A LAZ chunk has 50 000 points and is the unit of parallel work: smaller reads would run on one thread.
_BLOCK = 500_000
_CORNERING_STEPS = (8192, 128, 1)

_SMALLEST_HEADER = 227
_MAX_HEADER_BYTES = 1 << 30
_LARGEST_POINT_FORMAT = 10
_FIRST_WKT_FORMAT = 6

# Point formats from 6 on are compressed in layers, which need not all be decoded; of others than these all are.
_LAYERS = {
    "gps_time": laspy.DecompressionSelection.GPS_TIME,
    "scan_direction_flag": laspy.DecompressionSelection.FLAGS,
    "edge_of_flight_line": laspy.DecompressionSelection.FLAGS,
    "classification": laspy.DecompressionSelection.CLASSIFICATION,
    "intensity": laspy.DecompressionSelection.INTENSITY,
}


class LasSource:
    """One LAS or LAZ file. See `streamseg.io.cloud.Source`.

    Points are the raw integers X, Y, Z as float64. Attributes are any dimension that laspy names, bit fields and
    extra bytes included, as `las_dimensions` has them.
    """

    kind = "las"

    def __init__(self, path: Path) -> None:
        self.path = path
        with open(path, "rb") as file:
            self.header, self.vlrs, self.raw_header, self._legible_start = _read_header(file, path)
        header = self.header
        self.point_count: int | None = header.point_count
        self.lattice = Lattice(tuple(header.scales.tolist()), tuple(header.offsets.tolist()))
        self._dimensions = Dimensions(header.point_format, self.vlrs)
        self.dimensions: tuple[str, ...] = self._dimensions.names
        self.extra_dimensions = self._dimensions.extra
        self.box = tuple((float(low), float(high)) for low, high in zip(header.mins, header.maxs, strict=True))
        self.range_x = self.box[0]
        prefers_wkt = header.global_encoding.wkt or header.point_format.id >= _FIRST_WKT_FORMAT
        self.coordinate_system, self.stated_system = read_system([*self.vlrs, *self.evlrs()], prefers_wkt)
        self.clock = _clock(header)
        self.looks_like_degrees = looks_like_degrees(self.box[:2], self.lattice.scale)
        self.damage: str | None = None

    def chunks(self, size: int, attributes: Sequence[str]) -> Iterator[Chunk]:
        """Yield points in the file's own lattice units."""
        selection = laspy.DecompressionSelection.base().decompress_z()
        for name in attributes:
            selection |= _LAYERS.get(name, laspy.DecompressionSelection.all())
        for records in self.records(size, selection):
            points = np.empty((len(records), 3))
            for axis, name in enumerate("XYZ"):
                points[:, axis] = records[name]
            yield Chunk(points, {name: self._dimensions.values(records, name) for name in attributes})

    def records(self, size: int, selection: Any = None) -> Iterator[Any]:
        """Yield the points as laspy's point records, up to the end or to the damage."""
        self.damage = None
        announced, done = self.header.point_count, 0
        with open(self.path, "rb") as file:
            sound, reason = self._sound_part(file)
            # Each try goes in smaller steps up to the point that the one before could not decode.
            for step in (max(size, _BLOCK), *_CORNERING_STEPS):
                try:
                    is_parallel = sound.has_table and step >= _BLOCK
                    reader = laz.guarded(self._reader, file, sound, is_parallel, selection, done)
                    while done < sound.points:
                        block = laz.guarded(reader.read_points, min(step, sound.points - done))
                        for start in range(0, len(block), size):
                            yield block[start : start + size]
                        done += len(block)
                    break
                except laz.Undecodable as error:
                    reason = str(error)
        if done < announced:
            self.damage = damage_sentence(self.path, done, announced, reason)

    @property
    def announced_evlrs(self) -> int:
        """How many extended records the file says that it has."""
        header = self.header
        return int(header.number_of_evlrs if header.version.minor >= 4 else self._has_waveforms)

    def evlrs(self) -> list[Record]:
        """Return the extended records that lie completely inside the file, with views of the file as payloads."""
        header, found = self.header, list[Record]()
        if not self.announced_evlrs and not self._has_waveforms:
            return found
        with open(self.path, "rb") as file:
            data = memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))
        if header.version.minor >= 4:
            found = whole_records(data, header.start_of_first_evlr, header.number_of_evlrs, EVLR)
        if self._has_waveforms and all(record.key != WAVEFORMS for record in found):
            # Before version 1.4 this is the only record behind the points.
            record = whole_records(data, header.start_of_waveform_data_packet_record, 1, EVLR)
            found += [one for one in record if one.key == WAVEFORMS]
        return found

    @property
    def _has_waveforms(self) -> bool:
        """Whether the file says where in it waveforms are."""
        return bool(self.header.version.minor >= 3 and self.header.start_of_waveform_data_packet_record > 0)

    def _sound_part(self, file: BinaryIO) -> tuple[laz.Sound, str]:
        """Say how many points can be tried, and why not more."""
        header = self.header
        if not header.are_points_compressed:
            whole = (os.fstat(file.fileno()).st_size - header.offset_to_point_data) // header.point_format.size
            return laz.Sound(min(whole, header.point_count), True), "unexpected end of file"
        try:
            return laz.sound_part(file, header), "the chunk after it is damaged"
        except laz.Undecodable as error:
            return laz.Sound(0, False), str(error)

    def _reader(self, file: BinaryIO, sound: laz.Sound, is_parallel: bool, selection: Any, at: int) -> Any:
        """Open a reader whose next point is `at`; without a chunk table the way there is through all before it."""
        file.seek(0)
        if self._legible_start is not None:
            file = cast("BinaryIO", WithStart(file, self._legible_start))
        if selection is None or not sound.has_table:  # layers that are not decoded are skipped by seeking
            selection = laspy.DecompressionSelection.all()
        reader = laspy.LasReader(
            file if sound.has_table else laz.ForwardOnly(file),
            closefd=False,
            laz_backend=laspy.LazBackend.LazrsParallel if is_parallel else laspy.LazBackend.Lazrs,
            read_evlrs=False,
            decompression_selection=selection,
        )
        reader.header.point_count = sound.points
        if at > 0 and sound.has_table:
            reader.seek(at)
        elif at > 0:
            for start in range(0, at, _BLOCK):
                reader.read_points(min(_BLOCK, at - start))
        return reader


def _read_header(file: BinaryIO, path: Path) -> tuple[Any, list[Record], bytes, bytes | None]:
    """Read the header, its records as they stand, the header itself byte by byte; and what laspy reads in their place.

    Raises
    ------
    FileError
        The file is empty, is no LAS, or its header is cut off or contradicts itself.
    """
    length = os.fstat(file.fileno()).st_size
    start = file.read(_SMALLEST_HEADER)
    if not start:
        raise FileError(f"{path} is empty, a LAS or LAZ file was expected")
    if start[:4] != b"LASF":
        raise FileError(f"{path} is no LAS or LAZ file: it starts with {start[:4]!r} where b'LASF' is expected")
    if len(start) < _SMALLEST_HEADER:
        raise FileError(f"{path} is cut off inside its header, after {len(start)} bytes")
    size, points_at, vlr_count, format_byte = struct.unpack_from("<HIIB", start, 94)
    if start[24] != 1 or start[25] > 5:
        raise FileError(f"{path} is LAS version {start[24]}.{start[25]}; versions 1.0 to 1.5 can be read")
    if points_at > min(length, _MAX_HEADER_BYTES):
        raise FileError(
            f"{path} is cut off before its first point: it has {length:,} bytes, "
            f"the points should start at byte {points_at:,}"
        )
    if not _SMALLEST_HEADER <= size <= points_at:
        raise FileError(
            f"{path} has a damaged header: its size is given as {size} bytes, {_SMALLEST_HEADER} or more are needed "
            f"in front of the first point at byte {points_at:,}"
        )
    if format_byte & 0x7F > _LARGEST_POINT_FORMAT:
        raise FileError(f"{path} has point format {format_byte & 0x7F}; formats 0 to 10 can be read")
    raw = start + file.read(points_at - len(start))
    vlrs = whole_records(raw, size, vlr_count, VLR)
    if len(vlrs) < vlr_count:
        raise FileError(f"{path} has a damaged header: record {len(vlrs) + 1} of {vlr_count:,} reaches into the points")
    names = laspy.PointFormat(format_byte & 0x7F)
    taken = {*names.dimension_names, *(names.dtype().names or ())}
    readable = legible(raw, size, vlrs, taken, path)
    return _parsed(readable, path), vlrs, raw[:size], None if readable == raw else readable


def _parsed(raw: bytes, path: Path) -> Any:
    try:
        header = laspy.LasHeader.read_from(io.BytesIO(raw))
        header.point_format.dtype()
    except Exception as error:  # laspy reports a damaged record as whatever its parser ran into
        raise FileError(f"{path} has a damaged header: {error}") from error
    # Some writers of version 1.4 fill in the old field only.
    header.point_count = header.point_count or struct.unpack_from("<I", raw, 107)[0]
    scales, offsets = header.scales, header.offsets
    if not np.isfinite([scales, offsets]).all() or scales.min() <= 0:
        raise FileError(
            f"{path} has a damaged header: scale {tuple(scales.tolist())} and offset {tuple(offsets.tolist())} must be "
            "finite numbers, and the scale above 0"
        )
    return header


def _clock(header: Any) -> str | None:
    """Say from when on times are counted; None of points without time."""
    if "gps_time" not in header.point_format.dimension_names:
        return None
    encoding = header.global_encoding
    if encoding.gps_time_offset:
        return f"GPS time less {header.gps_time_offset} million seconds"
    return "GPS time less a billion seconds" if encoding.gps_time_type else "seconds of the GPS week"
