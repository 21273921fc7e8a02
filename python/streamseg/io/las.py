"""LAS and LAZ files as sources: headers read by laspy, points by this package.

laspy believes every count and size in a header; those that could make it run on for hours or fill the memory are
checked first.
"""

from __future__ import annotations

import io
import mmap
import os
import re
import struct
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from ..errors import FileError, MissingExtra, warn
from .cloud import Chunk, damage_sentence
from .las_blocks import body_of, in_blocks
from .las_box import Box, outside_sentence
from .lattice import Lattice

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
_VLR, _EVLR = struct.Struct("<2x16sHH32s"), struct.Struct("<2x16sHQ32s")

_LINEAR_UNIT_KEY, _PROJECTED_SYSTEM_KEY = 3076, 3072
_UNITS_BY_CODE = {9001: "m", 9002: "ft", 9003: "ft"}
_UNITS_BY_NAME = {"metre": "m", "meter": "m", "foot": "ft", "us survey foot": "ft", "foot_us": "ft"}
_METRIC_UTM_BLOCKS = {258, 269, 326, 327}

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
    extra bytes included.
    """

    kind = "las"

    def __init__(self, path: Path) -> None:
        self.path = path
        with open(path, "rb") as file:
            self.header, self.vlrs = _read_header(file, path)
            self._box = Box(self.header)
            self._body = body_of(file, path, self.header, self._box, _old_count(file))
        self.header.point_count = self._body.count
        self._has_told, self._outside = False, 0
        self.point_count: int | None = self.header.point_count
        self.lattice = Lattice(tuple(self.header.scales.tolist()), tuple(self.header.offsets.tolist()))
        self.dimensions: tuple[str, ...] = tuple(self.header.point_format.dimension_names)
        self.range_x = (float(self.header.mins[0]), float(self.header.maxs[0]))
        self.unit = _linear_unit(self.header)
        self.coordinate_system = _coordinate_system(self.header)
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
            yield Chunk(points, {name: np.ascontiguousarray(records[name]) for name in attributes})

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

    def evlrs(self) -> list[Any]:
        """Return the extended records that lie completely inside the file, with views of the file as payloads."""
        with open(self.path, "rb") as file:
            data = memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))
        header, minor = self.header, self.header.version.minor
        if minor >= 4:
            return _whole_records(data, header.start_of_first_evlr, header.number_of_evlrs, _EVLR)
        # Waveforms inside a file of version 1.3 are one record at its end.
        has_waveforms = minor == 3 and header.global_encoding.waveform_data_packets_internal
        return _whole_records(data, header.start_of_waveform_data_packet_record, int(has_waveforms), _EVLR)

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
            if body.remark is not None and self.damage is None:
                warn(body.remark)
            if self._outside:
                warn(outside_sentence(self.path, self._outside, done))
        self._has_told, self._outside = True, 0


def _read_header(file: BinaryIO, path: Path) -> tuple[Any, list[Any]]:
    """Read the header, and its records with their payloads as they stand.

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
    vlrs = _whole_records(raw, size, vlr_count, _VLR)
    if len(vlrs) < vlr_count:
        raise FileError(f"{path} has a damaged header: record {len(vlrs) + 1} of {vlr_count:,} reaches into the points")
    return _parsed(raw, path), vlrs


def _parsed(raw: bytes, path: Path) -> Any:
    try:
        header = laspy.LasHeader.read_from(io.BytesIO(raw))
        header.point_format.dtype()
    except Exception as error:  # laspy reports a damaged record as whatever its parser ran into
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


def _whole_records(data: bytes | memoryview, at: int, announced: int, layout: struct.Struct) -> list[Any]:
    """List the variable length records that lie completely inside `data`.

    laspy goes on reading behind the end, and writes the payloads that it understands in its own way.
    """
    found: list[Any] = []
    while len(found) < announced and at + layout.size <= len(data):
        user, number, length, about = layout.unpack_from(data, at)
        at += layout.size + length
        if at > len(data):
            break
        user, about = (text.split(b"\0")[0].decode("ascii", "ignore") for text in (user, about))
        found.append(laspy.VLR(user, number, about, data[at - length : at]))
    return found


def _coordinate_system(header: Any) -> dict[str, object]:
    """Tell what the file says of its coordinate system, by the kind of record that says it; citations are left out."""
    keys = {
        key.id: key.value_offset
        for vlr in header.vlrs.get("GeoKeyDirectoryVlr")
        for key in vlr.geo_keys
        if key.tiff_tag_location == 0
    }
    text = "".join("".join(vlr.string for vlr in header.vlrs.get("WktCoordinateSystemVlr")).split()).strip("\0")
    return {kind: said for kind, said in (("GeoKeys", keys), ("WKT", text)) if said}


def _linear_unit(header: Any) -> str | None:
    """Abbreviation of the horizontal unit, where the coordinate system of the file says it plainly; else None."""
    keys = {key.id: key.value_offset for vlr in header.vlrs.get("GeoKeyDirectoryVlr") for key in vlr.geo_keys}
    if keys.get(_LINEAR_UNIT_KEY) in _UNITS_BY_CODE:
        return _UNITS_BY_CODE[keys[_LINEAR_UNIT_KEY]]
    text = "".join(vlr.string for vlr in header.vlrs.get("WktCoordinateSystemVlr")).lower()
    names = re.findall(r'(?:length)?unit\["([^"]+)"', text)
    unit = next((_UNITS_BY_NAME[name] for name in reversed(names) if name in _UNITS_BY_NAME), None)
    return unit or ("m" if keys.get(_PROJECTED_SYSTEM_KEY, 0) // 100 in _METRIC_UTM_BLOCKS else None)
