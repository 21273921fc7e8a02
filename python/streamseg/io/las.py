"""LAS and LAZ files as sources: headers read by laspy, points by this package.

laspy believes every count and size in a header; those that could make it run on for hours or fill the memory are
checked first.
"""

from __future__ import annotations

import io
import os
import struct
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from ..errors import FileError, MissingExtra, warn
from .cloud import Chunk, damage_sentence
from .coordinate_system import looks_like_degrees, read_system
from .las_blocks import body_of, in_blocks
from .las_box import Box, outside_sentence
from .las_dimensions import Dimensions
from .las_records import VLR, WAVEFORMS, Record, legible, stored_records, whole_records
from .lattice import Lattice
from .opening import reading

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

try:
    import laspy
except ImportError as error:  # pragma: no cover - depends on the installation
    raise MissingExtra("reading and writing LAS needs laspy; install it: pip install laspy[lazrs]") from error

__all__ = ["LasSource", "laspy"]

_SMALLEST_HEADER, _OLD_COUNT_AT = 227, 107
_MAX_HEADER_BYTES = 1 << 30
_LARGEST_POINT_FORMAT = 10
_SCALES, _LARGEST_OFFSET = (1e-12, 1e6), 1e12
_FIRST_WKT_FORMAT = 6
# laspy reports a damaged record as whatever its parser ran into.
_DAMAGE = (
    laspy.LaspyException,
    struct.error,
    ArithmeticError,
    AssertionError,
    AttributeError,
    EOFError,
    LookupError,
    TypeError,
    ValueError,
)

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
        with reading(path) as file:
            self.header, self.vlrs, self.raw_header = _read_header(file, path)
            header = self.header
            self._box = Box(header)
            self._body = body_of(file, path, header, self._box, _old_count(file))
        header.point_count = self._body.count
        self._has_told, self._outside = False, 0
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
        """Yield the points as laspy's point records, up to the end or to the damage.

        At most `size` at a time, and fewer where they are large.
        """
        self.damage = None
        header, done = self.header, 0
        pieces = self._body.pieces(*([] if selection is None else [int(selection)]))
        for block in in_blocks(pieces, header.point_format.dtype(), size, header.point_count):
            self._watch(block)
            done += len(block)
            yield laspy.ScaleAwarePointRecord(block, header.point_format, header.scales, header.offsets)
        self._conclude(done)

    @property
    def announced_evlrs(self) -> int:
        """How many extended records the file says that it has."""
        header = self.header
        return int(header.number_of_evlrs if header.version.minor >= 4 else self._has_waveforms)

    def evlrs(self) -> list[Record]:
        """Return the extended records that lie completely inside the file; their payloads stay there."""
        header, found = self.header, list[Record]()
        if not self.announced_evlrs and not self._has_waveforms:
            return found
        with reading(self.path) as file:
            if header.version.minor >= 4:
                found = stored_records(file, self.path, header.start_of_first_evlr, header.number_of_evlrs)
            if self._has_waveforms and all(record.key != WAVEFORMS for record in found):
                # Before version 1.4 this is the only record behind the points.
                record = stored_records(file, self.path, header.start_of_waveform_data_packet_record, 1)
                found += [one for one in record if one.key == WAVEFORMS]
        return found

    @property
    def _has_waveforms(self) -> bool:
        """Whether the file says where in it waveforms are."""
        return bool(self.header.version.minor >= 3 and self.header.start_of_waveform_data_packet_record > 0)

    def _watch(self, block: NDArray[np.void]) -> None:
        """Count what lies outside of the header's bounding box, unless that has been told."""
        if not self._has_told:
            self._outside += self._box.count_outside(block)

    def _conclude(self, done: int) -> None:
        """Say what was wrong with the file; warn of it once where no point is missing."""
        announced, body = self.header.point_count, self._body
        if done < announced:
            self.damage = damage_sentence(self.path, done, announced, body.reason)
        elif body.unread:
            self.damage = (
                f"{self.path.name} holds up to {body.unread:,} points more than the {announced:,} that its header "
                "announces; only these were read"
            )
        if not self._has_told:
            for remark in [] if self.damage else body.remarks:
                warn(remark)
            if self._outside:
                warn(outside_sentence(self.path, self._outside, done))
        self._has_told, self._outside = True, 0


def _read_header(file: BinaryIO, path: Path) -> tuple[Any, list[Record], bytes]:
    """Read the header, its records as they stand, and the header itself byte by byte.

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
    return _parsed(legible(raw, size, vlrs, taken, path), path), vlrs, raw[:size]


def _parsed(raw: bytes, path: Path) -> Any:
    try:
        header = laspy.LasHeader.read_from(io.BytesIO(raw))
        header.point_format.dtype()
    except _DAMAGE as error:
        raise FileError(f"{path} has a damaged header: {error}") from error
    # Some writers of version 1.4 fill in the old field only.
    header.point_count = header.point_count or struct.unpack_from("<I", raw, _OLD_COUNT_AT)[0]
    scales, offsets = header.scales, header.offsets
    least, most = _SCALES
    is_usable = np.isfinite([scales, offsets]).all() and least <= scales.min() and scales.max() <= most
    if not is_usable or np.abs(offsets).max() > _LARGEST_OFFSET:
        raise FileError(
            f"{path} has a damaged header: scale {tuple(scales.tolist())} and offset {tuple(offsets.tolist())} must be "
            f"finite numbers, the scale from {least:g} to {most:g}, the offset within {_LARGEST_OFFSET:g} of 0"
        )
    return header


def _old_count(file: BinaryIO) -> int:
    """Read the count that versions before 1.4 have, and later ones beside another; 0 if it says nothing."""
    file.seek(_OLD_COUNT_AT)
    return int.from_bytes(file.read(4), "little")


def _clock(header: Any) -> str | None:
    """Say from when on times are counted; None of points without time."""
    if "gps_time" not in header.point_format.dimension_names:
        return None
    encoding = header.global_encoding
    if encoding.gps_time_offset:
        return f"GPS time less {header.gps_time_offset} million seconds"
    return "GPS time less a billion seconds" if encoding.gps_time_type else "seconds of the GPS week"
