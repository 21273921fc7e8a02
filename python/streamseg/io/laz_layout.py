"""Where the chunks of a LAZ lie, and how many points each has.

A chunk table at the end of the file says so. What it says is held against the file. Where it is
lost, chunks compressed in layers still say their sizes. Others are decoded one after the other, and
each ends where its decoder does.
"""

from __future__ import annotations

import os
import struct
from typing import TYPE_CHECKING, BinaryIO, NamedTuple

import numpy as np

from ..errors import FileError
from . import laz_decoder
from .laz_decoder import CHUNK, ENDS_EARLY, EXTENT, LAYERED, PAIR, POINTWISE, REST, TABLE, Request
from .laz_processes import Undecodable

if TYPE_CHECKING:
    from pathlib import Path
    from typing import Any

    from numpy.typing import NDArray

    from .laz_processes import Decoders

_SMALLEST_RECORD = laz_decoder.ITEMS_AT + 2
_HEAD_OF_RECORD = struct.Struct("<HHBBHII")
_MOST_POINTS = (1 << 32) - 2  # of a chunk; one more means that chunks vary in size
_ITEM_SIZES = {6: 20, 7: 8, 8: 6, 9: 29, 10: 30, 11: 6, 12: 8, 13: 29}
_EXTRA_BYTES = (0, 14)
_REWRITE = "rewrite it with laszip, las2las or PDAL, which may know it"
# The least that a coder spends on a point is 0.006 bits, on that nothing but time has changed.
_MOST_POINTS_A_BYTE = 2048
_TABLE_ENDS = "the chunk table ends there"
_CHUNK_IS_DAMAGED = "the chunk after it is damaged"


class Compression(NamedTuple):
    """What the laszip record says; `chunk_size` is None where chunks vary in size."""

    record: bytes
    compressor: int
    chunk_size: int | None
    layers: int


class Layout(NamedTuple):
    """The chunks that can be tried.

    lengths, counts : (k,) bytes and points of each chunk; the first starts at `start`
    last : CHUNK, or REST if the last chunk is cut off, or has fewer points than announced
    reason : why there are no more, if there should be
    has_lost_table : whether they had to be found without
    unread : how many points more than announced there may be, at most
    """

    start: int
    lengths: NDArray[np.int64]
    counts: NDArray[np.int64]
    last: int = CHUNK
    reason: str = _TABLE_ENDS
    has_lost_table: bool = False
    unread: int = 0

    def first(self, chunks: int, reason: str) -> Layout:
        """Leave out all chunks but the first few."""
        return self._replace(lengths=self.lengths[:chunks], counts=self.counts[:chunks], reason=reason, last=CHUNK)


def compression_of(header: Any, path: Path) -> Compression:
    """Read the laszip record.

    Raises
    ------
    FileError
        It is missing, contradicts the header, or tells of a compression that cannot be read.
    """
    records = header.vlrs.get("LasZipVlr")
    if not records or len(records[0].record_data) < _SMALLEST_RECORD:
        raise FileError(f"{path} has a damaged header: its points are compressed, but the laszip record is missing")
    record = bytes(records[0].record_data)
    compressor, coder, major, minor, _, _, chunk_size = _HEAD_OF_RECORD.unpack_from(record)
    items = laz_decoder.items_of(record)
    is_layered = any(kind >= 10 for kind, _, _ in items)
    is_known = coder == 0 and compressor in ((LAYERED,) if is_layered else (POINTWISE, laz_decoder.CHUNKED))
    for kind, size, version in items:
        is_in_place = (kind in (10, 11, 12, 13, 14)) == is_layered
        fits = size > 0 if kind in _EXTRA_BYTES else size == _ITEM_SIZES.get(kind)
        is_known &= is_in_place and fits and version in ((3,) if is_layered else (1, 2))
    if not is_known:
        said = ", ".join(f"{kind}.{version}" for kind, _, version in items) or "none"
        raise FileError(
            f"{path} is compressed in a way that cannot be read here (LASzip {major}.{minor}, "
            f"compressor {compressor}, coder {coder}, items {said}): {_REWRITE}"
        )
    size = sum(size for _, size, _ in items)
    if size != header.point_format.size:
        raise FileError(
            f"{path} has a damaged header: its laszip record describes points of {size} bytes, "
            f"the header of {header.point_format.size}"
        )
    varies = chunk_size > _MOST_POINTS
    if compressor != POINTWISE and chunk_size == 0:
        raise FileError(f"{path} has a damaged header: its laszip record tells of chunks of 0 points")
    return Compression(record, compressor, None if varies else chunk_size, len(laz_decoder.layers_of(record)))


class LayoutFinder:
    """Finds the chunks of one file."""

    def __init__(self, path: Path, header: Any, compression: Compression) -> None:
        self._path, self._header, self._compression = path, header, compression
        self._size = int(header.point_format.size)
        self._start = int(header.offset_to_point_data) + (0 if compression.compressor == POINTWISE else 8)

    def quickly(self, file: BinaryIO) -> Layout | None:
        """Find chunks that say how long they are; None if others have to be asked for."""
        self._end = os.fstat(file.fileno()).st_size
        self._table_at = self._place_of_table(file)
        self._chunks = 0
        if self._table_at is not None:
            (self._chunks,) = struct.unpack("<I", _bytes_at(file, self._table_at + 4, 4))
        self.has_data = (self._end if self._table_at is None else self._table_at) > self._start
        if self._compression.compressor == POINTWISE:
            return self._one_chunk()
        return self._chain(file) if self._compression.layers else None

    def fits(self, count: int, layout: Layout | None) -> bool:
        """Whether that count is what the chunks hold, as far as is known without decoding."""
        if layout is not None:
            return int(layout.counts.sum()) == count
        return self._compression.chunk_size is not None and self._chunks == -(-count // self._compression.chunk_size)

    def thoroughly(self, decoders: Decoders, is_inside: Any) -> Layout:
        """Find the others, by the table or without.

        Parameters
        ----------
        is_inside : function
            Tells of (n, 3) steps which lie in the bounding box of the header.
        """
        table = self._table(decoders)
        if self._compression.chunk_size is None:
            if table is None:
                raise Undecodable("the chunk table is damaged, and chunks vary in size")
            return Layout(self._start, table[:, 1], table[:, 0])
        if table is None:
            return self._recovered(decoders, self._compression.chunk_size, is_inside)
        return self._by_table(table[:, 1], self._compression.chunk_size)

    def request(self, kind: int, start: int, length: int, points: int) -> Request:
        """Ask for a part of this file."""
        path = str(self._path.absolute()).encode("utf-8", "surrogateescape")
        return Request(kind, path, self._compression.record, start, length, points, self._size)

    def _place_of_table(self, file: BinaryIO) -> int | None:
        """Say where the chunk table is, unless that contradicts the file."""
        if self._compression.compressor == POINTWISE or self._end < self._start:
            return None
        (at,) = struct.unpack("<q", _bytes_at(file, self._start - 8, 8))
        if at < self._start:  # written to a pipe: the position follows the table
            (at,) = struct.unpack("<q", _bytes_at(file, self._end - 8, 8))
        return at if self._start <= at <= self._end - 8 else None

    def _one_chunk(self) -> Layout:
        count = min(int(self._header.point_count), _MOST_POINTS)
        return Layout(self._start, np.array([self._end - self._start]), np.array([count]))

    def _chain(self, file: BinaryIO) -> Layout:
        """Go from chunk to chunk by their own sizes, to where the chunk table is."""
        counts_of = struct.Struct(f"<{1 + self._compression.layers}I")
        most = self._compression.chunk_size or _MOST_POINTS
        at, left = self._start, int(self._header.point_count)
        lengths: list[int] = []
        counts: list[int] = []
        reason = _TABLE_ENDS
        while at != self._table_at and at < self._end:
            is_past = self._table_at is None or self._table_at < at
            if left <= 0 and (is_past or _is_table(_bytes_at(file, at, 8), len(counts))):
                break
            if at + self._size + counts_of.size > self._end:
                reason = ENDS_EARLY
                break
            count, *sizes = counts_of.unpack(_bytes_at(file, at + self._size, counts_of.size))
            length = self._size + counts_of.size + sum(sizes)
            is_possible = 0 < count <= min(most, 1 + _MOST_POINTS_A_BYTE * sizes[0])
            if not is_possible or at + length > self._end:
                reason = _CHUNK_IS_DAMAGED
                break
            lengths.append(length)
            counts.append(count)
            at, left = at + length, left - count
        has_lost_table = not _is_table(_bytes_at(file, at, 8), len(counts))
        return _layout(self._start, lengths, counts, reason=reason, has_lost_table=has_lost_table)

    def _table(self, decoders: Decoders) -> NDArray[np.int64] | None:
        """Read points and bytes of each chunk from the chunk table, unless they contradict the file."""
        if self._table_at is None:
            return None
        if self._chunks * self._size > self._table_at - self._start:
            return None
        try:
            read = decoders.whole(self.request(TABLE, self._start - 8, 0, 0))
        except Undecodable:
            return None
        table = np.frombuffer(read, "<i8").reshape(-1, PAIR.size // 8)
        is_possible = (table >= 0).all() and (table < 1 << 40).all()
        is_possible &= (table[:, 0] <= 1 + _MOST_POINTS_A_BYTE * table[:, 1]).all()
        if not is_possible or table[:, 1].sum() != self._table_at - self._start:
            return None
        # Some writers end with a chunk that has no point.
        is_empty = len(table) and (table[-1, 0] == 0 or table[-1, 1] < self._size)
        return table[:-1] if is_empty else table

    def _by_table(self, lengths: NDArray[np.int64], size: int) -> Layout:
        announced = int(self._header.point_count)
        counts = np.full(len(lengths), size)
        needed = -(-announced // size)
        if len(lengths) < needed:  # how many points the last one has, nothing says
            return Layout(self._start, lengths, counts, REST)
        if len(lengths) == needed:
            counts[-1] = announced - (needed - 1) * size
        unread = int(counts.sum()) - announced
        return Layout(self._start, lengths[:needed], counts[:needed], unread=unread)

    def _recovered(self, decoders: Decoders, size: int, is_inside: Any) -> Layout:
        """Decode one chunk after the other to find out where they end."""
        at, left = self._start, int(self._header.point_count)
        lengths: list[int] = []
        counts: list[int] = []
        last, reason = CHUNK, ENDS_EARLY
        while left > 0 and at < self._end:
            counts.append(min(size, left))
            left -= counts[-1]
            try:
                found = decoders.whole(self.request(EXTENT, at, self._end - at, counts[-1]))
                lengths.append(struct.unpack("<Q", found)[0])
            except Undecodable as error:
                is_cut_off = self._table_at is None and str(error) == reason
                last, reason = (REST, reason) if is_cut_off else (CHUNK, _CHUNK_IS_DAMAGED)
                lengths.append(self._end - at)
            at += lengths[-1]
        with open(self._path, "rb") as file:
            file.seek(at)
            is_proven = left == 0 and (at in (self._table_at, self._end) or _is_table(file.read(8), len(counts)))
        if counts and self._table_at is not None and not is_proven:
            # If the last one is not what is damaged, it reaches to the table, which its decoder finds out.
            lengths[-1] = self._table_at - (at - lengths[-1])
        layout = _layout(self._start, lengths, counts, last, reason, has_lost_table=True)
        if is_proven and reason != _CHUNK_IS_DAMAGED:
            return layout
        layout = self._before_nonsense(layout, is_inside)
        if last == CHUNK and (self._table_at is None or layout.lengths[-1:].sum() < 0):
            return layout.first(min(len(layout.counts), len(counts) - 1), _CHUNK_IS_DAMAGED)
        return layout

    def _before_nonsense(self, layout: Layout, is_inside: Any) -> Layout:
        """Leave out what is read after a damaged chunk: from then on, chunks start far away."""
        starts = layout.start + np.concatenate([[0], np.cumsum(layout.lengths)[:-1]]).astype(np.int64)
        firsts = np.empty((len(layout.counts), 3), "<i4")
        with open(self._path, "rb") as file:
            for index in range(len(firsts)):
                file.seek(int(starts[index]))
                firsts[index] = np.frombuffer(file.read(12).ljust(12, b"\0"), "<i4")
        inside = np.flatnonzero(is_inside(firsts))
        if not len(inside) or inside[-1] == len(firsts) - 1:
            return layout
        return layout.first(int(inside[-1]), _CHUNK_IS_DAMAGED)


def _layout(start: int, lengths: list[int], counts: list[int], *others: Any, **named: Any) -> Layout:
    return Layout(start, np.array(lengths, np.int64), np.array(counts, np.int64), *others, **named)


def _bytes_at(file: BinaryIO, at: int, length: int) -> bytes:
    """Read bytes that may be behind the end, should the file become shorter: what is missing is 0."""
    file.seek(at)
    return file.read(length).ljust(length, b"\0")


def _is_table(head: bytes, chunks: int) -> bool:
    """Whether a table of so many chunks, or one more that is empty, starts like this."""
    return head in (struct.pack("<II", 0, chunks), struct.pack("<II", 0, chunks + 1))
