"""LAS and LAZ files written point by point, below a header that is given byte by byte.

laspy's own writer loses what it does not understand: bytes behind the end of a text, dates that are none, the last
letter of a text that fills its field. Here only those fields change that tell of the points and of what lies where.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Any, BinaryIO

import lazrs
import numpy as np

from .las_records import EVLR, VLR, WAVEFORMS, Record, new_record
from .laz_threads import can_compress_in_threads

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from .las_layout import Layout
    from .lattice import Lattice

HEADER_BYTES = {0: 227, 1: 227, 2: 227, 3: 235, 4: 375, 5: 393}
WKT_BIT = 0b1_0000

ENCODING_AT, MINOR_AT = 6, 25
_SIZES_AT, _FORMAT_AT = 94, 104
_LEGACY_COUNTS_AT, _SCALE_AT, _BOX_AT = 107, 131, 179
_WAVEFORMS_AT, _EVLRS_AT, _COUNTS_AT, _TIMES_AT = 227, 235, 247, 375
_COMPRESSED = 0x80
_FIRST_NEW_FORMAT = 6
_MOST_LEGACY_POINTS = 2**32 - 1

_LASZIP_KEY, _LASZIP_ABOUT = ("laszip encoded", 22204), "http://laszip.org"
_CHUNK_SIZE_AT, _CHUNK_BYTES = 12, 1 << 24
_ITEMS_AT, _ITEM_BYTES, _WAVEFORM_ITEM = 34, 6, 9


class LasWriter:
    """A LAS or LAZ file that is being written, laid out as given.

    In the header only that changes which tells of the points.
    """

    def __init__(self, file: BinaryIO, layout: Layout, lattice: Lattice, compressed: bool) -> None:
        point_format, records = layout.point_format, list(layout.records)
        self._file, self._header = file, bytearray(layout.header)
        self._minor, self._format, self._lattice = layout.minor_version, int(point_format.id), lattice
        self.dtype: np.dtype[Any] = point_format.dtype()
        self._points = 0
        self._by_return = np.zeros(16, np.int64)
        self._low, self._high = np.full(3, np.inf), np.full(3, -np.inf)
        self._times = (np.inf, -np.inf)
        self._compressor: Any = None
        if compressed:
            vlr, makes_compressor = _compression(self._format, point_format)
            records.append(new_record(_LASZIP_KEY, _LASZIP_ABOUT, laszip_record(vlr.record_data())))
        heads = b"".join(record.packed_head(VLR) + bytes(record.data) for record in records)
        begin = len(layout.header) + len(heads) + len(layout.padding)
        struct.pack_into("<HII", self._header, _SIZES_AT, len(layout.header), begin, len(records))
        struct.pack_into(
            "<BH", self._header, _FORMAT_AT, self._format | (_COMPRESSED if compressed else 0), self.dtype.itemsize
        )
        struct.pack_into("<6d", self._header, _SCALE_AT, *lattice.scale, *lattice.offset)
        file.write(bytes(self._header) + heads + layout.padding)
        if compressed:
            self._compressor = makes_compressor(file, vlr)

    def write(self, points: NDArray[np.void]) -> None:
        """Write points, of `dtype`."""
        if not len(points):
            return
        if self._compressor is None:
            self._file.write(points.data)
        else:
            self._compressor.compress_many(np.frombuffer(points, np.uint8))
        self._points += len(points)
        for axis, name in enumerate("XYZ"):
            self._low[axis] = min(self._low[axis], points[name].min())
            self._high[axis] = max(self._high[axis], points[name].max())
        mask = 0b1111 if self._format >= _FIRST_NEW_FORMAT else 0b111
        self._by_return += np.bincount(points["bit_fields"] & mask, minlength=16)
        if "gps_time" in (self.dtype.names or ()):
            times = points["gps_time"]
            self._times = (min(self._times[0], times.min()), max(self._times[1], times.max()))

    def finish(self, evlrs: Sequence[Record]) -> None:
        """Write what stands behind the points, and the final header."""
        if self._compressor is not None:
            self._compressor.done()
        at = self._file.seek(0, 2)
        starts: dict[tuple[str, int], int] = {}
        first = at if evlrs else 0
        for record in evlrs:
            starts.setdefault(record.key, at)
            self._file.write(record.packed_head(EVLR))
            for block in [record.data] if isinstance(record.data, bytes) else record.data.blocks():
                self._file.write(block)
            at += EVLR.size + len(record.data)
        self._count()
        if self._minor >= 3:
            struct.pack_into("<Q", self._header, _WAVEFORMS_AT, starts.get(WAVEFORMS, 0))
        if self._minor >= 4:
            struct.pack_into("<QI", self._header, _EVLRS_AT, first, len(evlrs))
        self._file.seek(0)
        self._file.write(bytes(self._header))

    def _count(self) -> None:
        """Note in the header how many points there are, and where."""
        header, returns = self._header, self._by_return[1:].tolist()
        is_legacy = self._minor < 4 or (self._format < _FIRST_NEW_FORMAT and self._points <= _MOST_LEGACY_POINTS)
        legacy = [self._points, *returns[:5]] if is_legacy else [0] * 6
        struct.pack_into("<6I", header, _LEGACY_COUNTS_AT, *legacy)
        if self._minor >= 4:
            struct.pack_into("<16Q", header, _COUNTS_AT, self._points, *returns)
        if self._minor >= 5 and self._times[0] <= self._times[1]:
            struct.pack_into("<2d", header, _TIMES_AT, self._times[1], self._times[0])
        scale, offset = np.array(self._lattice.scale), np.array(self._lattice.offset)
        low, high = self._low * scale + offset, self._high * scale + offset
        if not self._points:
            low = high = np.zeros(3)
        struct.pack_into("<6d", header, _BOX_AT, *np.column_stack([high, low]).ravel().tolist())


def _compression(point_format_id: int, point_format: Any) -> tuple[Any, Callable[[BinaryIO, Any], Any]]:
    """Choose chunks, of 50,000 points as usual or 16 MB, and what compresses them.

    In threads, each holds the points of a chunk. One after the other, none does: wide points are compressed so.
    """
    vlr = lazrs.LazVlr.new_for_compression(point_format_id, point_format.num_extra_bytes)
    most = _CHUNK_BYTES // point_format.size
    if vlr.chunk_size() <= most:
        return vlr, lazrs.ParLasZipCompressor if can_compress_in_threads() else lazrs.LasZipCompressor
    record = bytearray(vlr.record_data())
    struct.pack_into("<I", record, _CHUNK_SIZE_AT, most)
    return lazrs.LazVlr(bytes(record)), lazrs.LasZipCompressor


def adapted_header(header: bytes, minor: int, says_wkt: bool) -> bytes:
    """Make a header of another version; what users have behind it stays."""
    standard = HEADER_BYTES[header[MINOR_AT]]
    longer = bytearray(header[:standard].ljust(HEADER_BYTES[minor], b"\0") + header[standard:])
    longer[MINOR_AT] = minor
    longer[ENCODING_AT] = longer[ENCODING_AT] & ~WKT_BIT | (WKT_BIT if says_wkt else 0)
    return bytes(longer)


def laszip_record(data: bytes) -> bytes:
    """Correct the versions of items in the record that LASzip reads.

    lazrs says that old waveforms are written by version 2 of their encoding, and writes version 1: there is no other.
    """
    record = bytearray(data)
    for at in range(_ITEMS_AT, len(record) - _ITEM_BYTES + 1, _ITEM_BYTES):
        if struct.unpack_from("<H", record, at)[0] == _WAVEFORM_ITEM:
            struct.pack_into("<H", record, at + 4, 1)
    return bytes(record)
