"""The bytes in front of the points of a LAS or LAZ file, checked, taken apart and put together again unchanged.

Headers are kept as bytes and only the fields that must change are patched, so that whatever a writer put there
(dates, identifiers, reserved bytes, records nobody knows) survives. Field positions are those of the ASPRS LAS
specification 1.4 R15, table 3; 1.5 appends to them.
"""

from __future__ import annotations

import io
import os
import re
import struct
from dataclasses import dataclass, replace
from math import isfinite
from typing import TYPE_CHECKING, BinaryIO

from ..errors import FileError
from .lattice import Lattice, Triple

if TYPE_CHECKING:
    from pathlib import Path

LASZIP_USER = b"laszip encoded"
EXTRA_BYTES_USER, EXTRA_BYTES_RECORD = b"LASF_Spec", 4
WAVEFORM_RECORD = 65535
COPC_USER = b"copc"

_HEADER_SIZES = {0: 227, 1: 227, 2: 227, 3: 235, 4: 375, 5: 393}
_MAX_HEADER_BYTES = 1 << 30
_COMPRESSED_BITS = 0xC0
_LARGEST_POINT_FORMAT = 10
_LINEAR_UNIT_KEY, _PROJECTED_SYSTEM_KEY = 3076, 3072
_UNITS_BY_CODE = {9001: "m", 9002: "ft", 9003: "ft"}
_UNITS_BY_NAME = {"metre": "m", "meter": "m", "foot": "ft", "us survey foot": "ft", "foot_us": "ft"}
_METRIC_UTM_BLOCKS = {258, 269, 326, 327}
_VLR = struct.Struct("<H16sHH32s")
_EVLR = struct.Struct("<H16sHQ32s")


@dataclass(frozen=True)
class Vlr:
    """One variable length record, as it stands in the file."""

    user_id: bytes
    record_id: int
    data: bytes
    reserved: int = 0
    description: bytes = b""

    @property
    def user(self) -> bytes:
        """The user id without its padding."""
        return self.user_id.split(b"\0")[0]

    def is_record(self, user: bytes, record_id: int) -> bool:
        """Whether this is the record that `user` numbers `record_id`."""
        return self.user == user and self.record_id == record_id

    def to_bytes(self) -> bytes:
        """Return the record with its 54 byte header."""
        return _VLR.pack(self.reserved, self.user_id, self.record_id, len(self.data), self.description) + self.data


@dataclass(frozen=True)
class Evlr:
    """Where one extended variable length record lies: header of 60 bytes and data, from `start` to `stop`."""

    user: bytes
    record_id: int
    start: int
    stop: int


@dataclass(frozen=True)
class LasHeader:
    """Header, records and the bytes between them and the first point."""

    header: bytes
    vlrs: tuple[Vlr, ...]
    tail: bytes

    def field(self, layout: str, at: int) -> tuple[int | float, ...]:
        """Unpack little-endian `layout` at byte `at` of the header."""
        return struct.unpack_from("<" + layout, self.header, at)

    def integer(self, layout: str, at: int) -> int:
        """Unpack one integer."""
        return int(self.field(layout, at)[0])

    def patched(self, layout: str, at: int, *values: int | float) -> LasHeader:
        """Return a copy whose bytes at `at` hold `values`."""
        changed = bytearray(self.header)
        struct.pack_into("<" + layout, changed, at, *values)
        return replace(self, header=bytes(changed))

    @property
    def minor(self) -> int:
        """Minor version: 4 for LAS 1.4."""
        return self.integer("B", 25)

    @property
    def point_format(self) -> int:
        """Point data record format, 0 to 10."""
        return self.integer("B", 104) & ~_COMPRESSED_BITS

    @property
    def is_compressed(self) -> bool:
        """Whether the points are LAZ."""
        return bool(self.integer("B", 104) & _COMPRESSED_BITS)

    @property
    def record_length(self) -> int:
        """Bytes per point, extra bytes included."""
        return self.integer("H", 105)

    @property
    def points_at(self) -> int:
        """Byte position of the first point."""
        return self.integer("I", 96)

    @property
    def point_count(self) -> int:
        """Number of points the header announces."""
        legacy = self.integer("I", 107)
        return (self.integer("Q", 247) or legacy) if self.minor >= 4 else legacy

    @property
    def lattice(self) -> Lattice:
        """Scale and offset."""
        values = self.field("6d", 131)
        return Lattice(_triple(values[:3]), _triple(values[3:]))

    @property
    def bounds(self) -> tuple[Triple, Triple]:
        """Smallest and largest coordinate per axis, as the header announces them."""
        values = self.field("6d", 179)
        return _triple(values[1::2]), _triple(values[0::2])

    def find(self, user: bytes, record_id: int) -> Vlr | None:
        """Find a variable length record."""
        return next((vlr for vlr in self.vlrs if vlr.is_record(user, record_id)), None)

    def to_bytes(self) -> bytes:
        """Everything in front of the first point, with sizes and counts brought up to date."""
        records = b"".join(vlr.to_bytes() for vlr in self.vlrs)
        points_at = len(self.header) + len(records) + len(self.tail)
        return self.patched("II", 96, points_at, len(self.vlrs)).header + records + self.tail

    @classmethod
    def read(cls, file: BinaryIO, path: Path) -> LasHeader:
        """Read and check the header of an open file.

        Raises
        ------
        FileError
            The file is empty, is no LAS, or its header is cut off or contradicts itself.
        """
        length = os.fstat(file.fileno()).st_size
        start = file.read(_HEADER_SIZES[0])
        if not start:
            raise FileError(f"{path} is empty, a LAS or LAZ file was expected")
        if start[:4] != b"LASF":
            raise FileError(f"{path} is no LAS or LAZ file: it starts with {start[:4]!r} where b'LASF' is expected")
        if len(start) < _HEADER_SIZES[0]:
            raise FileError(f"{path} is cut off inside its header, after {len(start)} bytes")
        points_at = struct.unpack_from("<I", start, 96)[0]
        if points_at > min(length, _MAX_HEADER_BYTES):
            raise FileError(
                f"{path} is cut off before its first point: it has {length:,} bytes, "
                f"the points should start at byte {points_at:,}"
            )
        return cls._parse(start + file.read(points_at - len(start)), path)

    @classmethod
    def _parse(cls, raw: bytes, path: Path) -> LasHeader:
        minor = raw[25]
        size, points_at, vlr_count = struct.unpack_from("<HII", raw, 94)
        if raw[24] != 1 or minor not in _HEADER_SIZES:
            raise FileError(f"{path} is LAS version {raw[24]}.{minor}; versions 1.0 to 1.5 can be read")
        if not _HEADER_SIZES[minor] <= size <= points_at or len(raw) < points_at:
            raise FileError(
                f"{path} has a damaged header: its size is given as {size} bytes, {_HEADER_SIZES[minor]} or more are "
                f"needed in front of the first point at byte {points_at:,}"
            )
        vlrs, stop = _parse_vlrs(raw, size, vlr_count, path)
        header = cls(raw[:size], vlrs, raw[stop:])
        if header.point_format > _LARGEST_POINT_FORMAT:
            raise FileError(f"{path} has point format {header.point_format}; formats 0 to 10 can be read")
        lattice = header.lattice
        if not all(isfinite(v) for v in lattice.scale + lattice.offset) or min(lattice.scale) <= 0:
            raise FileError(
                f"{path} has a damaged header: scale {lattice.scale} and offset {lattice.offset} must be finite "
                "numbers, and the scale above 0"
            )
        return header


def new_vlr(user: bytes, record_id: int, data: bytes, description: bytes) -> Vlr:
    """Make a record; ids and descriptions are padded when it is written."""
    return Vlr(user, record_id, data, 0, description)


def find_evlrs(file: BinaryIO, header: LasHeader) -> list[Evlr]:
    """List the extended records that lie completely inside the file."""
    length = os.fstat(file.fileno()).st_size
    if header.minor >= 4:
        at, count = header.integer("Q", 235), header.integer("I", 243)
    elif header.minor == 3 and header.integer("H", 6) & 2:  # waveforms inside the file: one record at its end
        at, count = header.integer("Q", 227), 1
    else:
        return []
    found = []
    while count > 0 and header.points_at <= at <= length - _EVLR.size:
        file.seek(at)
        _, user_id, record_id, size, _ = _EVLR.unpack(file.read(_EVLR.size))
        stop = at + _EVLR.size + size
        if stop > length:
            break
        found.append(Evlr(user_id.split(b"\0")[0], record_id, at, stop))
        at, count = stop, count - 1
    return found


def header_stream(header: LasHeader) -> BinaryIO:
    """Make a stream for a parser that only has to understand the dimensions: other records are left out."""
    described = header.find(EXTRA_BYTES_USER, EXTRA_BYTES_RECORD)
    header = replace(header, vlrs=() if described is None else (described,), tail=b"")
    if header.minor >= 4:
        header = header.patched("I", 243, 0)
    return io.BytesIO(header.to_bytes())


def linear_unit(header: LasHeader) -> str | None:
    """Abbreviation of the horizontal unit, where the coordinate system of the file says it plainly; else None."""
    keys = header.find(b"LASF_Projection", 34735)
    shorts = struct.unpack(f"<{len(keys.data) // 2}H", keys.data[: len(keys.data) // 2 * 2]) if keys else ()
    found = {shorts[i]: shorts[i + 3] for i in range(4, len(shorts) - 3, 4)}
    if found.get(_LINEAR_UNIT_KEY) in _UNITS_BY_CODE:
        return _UNITS_BY_CODE[found[_LINEAR_UNIT_KEY]]
    wkt = header.find(b"LASF_Projection", 2112)
    text = wkt.data.decode("utf-8", "replace").lower() if wkt else ""
    names = re.findall(r'(?:length)?unit\["([^"]+)"', text)
    unit = next((_UNITS_BY_NAME[name] for name in reversed(names) if name in _UNITS_BY_NAME), None)
    return unit or ("m" if found.get(_PROJECTED_SYSTEM_KEY, 0) // 100 in _METRIC_UTM_BLOCKS else None)


def _parse_vlrs(raw: bytes, at: int, count: int, path: Path) -> tuple[tuple[Vlr, ...], int]:
    vlrs = []
    for index in range(count):
        data_at = at + _VLR.size
        stop = data_at + (struct.unpack_from("<H", raw, at + 20)[0] if data_at <= len(raw) else 0)
        if stop > len(raw):
            raise FileError(f"{path} has a damaged header: record {index + 1} of {count:,} reaches into the points")
        reserved, user_id, record_id, _, description = _VLR.unpack_from(raw, at)
        vlrs.append(Vlr(user_id, record_id, raw[data_at:stop], reserved, description))
        at = stop
    return tuple(vlrs), at


def _triple(values: tuple[int | float, ...]) -> Triple:
    x, y, z = (float(value) for value in values)
    return x, y, z
