"""The uncompressed points of a LAS, as many as there are."""

from __future__ import annotations

import os
import struct
from typing import TYPE_CHECKING, Any, BinaryIO

from ..errors import FileError
from .opening import reading

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

_PIECE = 1 << 20
_EVLR_HEAD = struct.Struct("<20xQ32x")


class PlainPoints:
    """The points of one LAS as bytes; the attributes are those of `laz.CompressedPoints`."""

    def __init__(self, file: BinaryIO, path: Path, header: Any) -> None:
        self._path, self._size, self._start = path, int(header.point_format.size), int(header.offset_to_point_data)
        self.count = int(header.point_count)
        self.remarks: list[str] = []
        self.reason = "unexpected end of file"
        end = min(_end_of_points(file, header), os.fstat(file.fileno()).st_size)
        room = max(0, end - self._start) // self._size
        self._there = min(self.count, room)
        self.unread, self.fits = room - self._there, room == self.count
        if self.count == 0 and room > 0:
            raise FileError(
                f"{path} announces 0 points in its header, but has room for {room:,}; "
                "was the program stopped that wrote it?"
            )

    def pieces(self, _selection: int = 0) -> Iterator[bytes | bytearray]:
        """Yield whole records; then `reason` says why there are no more."""
        step = max(1, _PIECE // self._size)
        with reading(self._path) as file:
            file.seek(self._start)
            for start in range(0, self._there, step):
                piece = self._read(file, min(step, self._there - start))
                yield piece[: len(piece) // self._size * self._size]

    def _read(self, file: BinaryIO, records: int) -> bytes:
        return file.read(records * self._size)


def _end_of_points(file: BinaryIO, header: Any) -> int:
    """Say where the points end at the latest: with the file, or where extended records start."""
    end, minor = os.fstat(file.fileno()).st_size, header.version.minor
    at, count = 0, 0
    if minor >= 4:
        at, count = int(header.start_of_first_evlr or 0), int(header.number_of_evlrs or 0)
    elif minor == 3 and header.global_encoding.waveform_data_packets_internal:
        at, count = int(header.start_of_waveform_data_packet_record or 0), 1
    start = int(header.offset_to_point_data)
    # Of records that are cut off, the place is right if the points reach just to it.
    is_end = at == start + int(header.point_count) * int(header.point_format.size)
    return at if at >= start and count and (is_end or _are_records(file, at, count, end)) else end


def _are_records(file: BinaryIO, at: int, count: int, end: int) -> bool:
    """Whether so many extended records fit there: what the header says may be damaged."""
    for _ in range(count):
        file.seek(at)
        head = file.read(_EVLR_HEAD.size)
        if len(head) < _EVLR_HEAD.size:
            return False
        at += _EVLR_HEAD.size + _EVLR_HEAD.unpack(head)[0]
        if at > end:
            return False
    return True
