"""The compressed points of a LAZ: every chunk is proven before a point of it is handed out."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from ..errors import FileError, MissingExtra

try:
    from .laz_decoder import CHUNK, EVERYTHING, POINTWISE, REST
except ImportError as error:  # pragma: no cover - depends on the installation
    said = "reading and writing LAZ needs lazrs; install it: pip install laspy[lazrs]"
    raise MissingExtra(said) from error

from .laz_layout import Layout, LayoutFinder, compression_of
from .laz_processes import Decoders, Undecodable
from .opening import telling

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from .las_box import Box
    from .laz_decoder import Request


class CompressedPoints:
    """The points of one LAZ as bytes.

    Attributes
    ----------
    count : int
        How many there are: what the header announces, or more if the chunks say so.
    unread : int
        How many points more than that the file holds, at most; they are not read. Known after reading.
    fits : bool
        Whether the chunks are as many as the count needs, as far as is known without decoding.
    remarks : list of str
        Sentences on what is wrong with the file, though all points can be read.
    reason : str
        Why no more than those that were read could be read.
    """

    def __init__(self, file: BinaryIO, path: Path, header: Any, box: Box) -> None:
        self._path, self._size, self._box = path, int(header.point_format.size), box
        self._compression = compression_of(header, path)
        self._finder = LayoutFinder(path, header, self._compression)
        self.count, self.unread = int(header.point_count), 0
        self.remarks: list[str] = []
        self.reason = ""
        self._proven = 0
        self._layout = self._finder.quickly(file)
        if self._layout is not None:
            self._hold_against_header(self._layout)
        if self._compression.chunk_size is None and self._layout is None:
            with Decoders() as decoders:
                self._layout = self._found(decoders)
        self.fits = self._finder.fits(int(header.point_count), self._layout)
        if self._compression.compressor == POINTWISE:
            self.remarks.append(
                f"{path.name} is compressed in one piece, as LASzip 1 did: it is decoded on one core, and damage "
                "would cost all points after it; rewrite it in chunks with laszip or PDAL"
            )
        if self.count == 0 and self._finder.has_data:
            raise FileError(
                f"{path} announces 0 points in its header, but holds compressed points; "
                "was the program stopped that wrote it?"
            )

    def pieces(self, selection: int = EVERYTHING) -> Iterator[bytes | bytearray]:
        """Yield whole records of all chunks, up to the damage; then `reason` says what it is.

        The first reading decodes and proves everything. Later ones decode the selected layers only.
        """
        left = self.count * self._size
        selection = selection if self._proven == EVERYTHING else EVERYTHING
        with telling(self._path), Decoders() as decoders:
            layout = self._layout = self._layout or self._found(decoders)
            self.unread, self.reason = layout.unread, layout.reason
            try:
                for piece in self._decoded(decoders, layout, selection):
                    yield piece[:left]
                    left -= len(piece)
                    if left <= 0:  # the header announces fewer points than this chunk has
                        break
            except Undecodable as error:
                self.reason = str(error)
            else:
                self._proven |= selection

    def _decoded(self, decoders: Decoders, layout: Layout, selection: int) -> Iterator[bytes | bytearray]:
        requests = self._requests(layout, selection)
        waiting: list[Request] = []
        while True:
            while decoders.has_room and (request := next(requests, None)):
                decoders.ask(request)
                waiting.append(request)
            if not waiting:
                return
            request = waiting.pop(0)
            pieces = decoders.pieces()
            try:
                yield from pieces if request.kind == CHUNK else self._credible(pieces)
            except Undecodable as error:
                if request.kind == REST or self._compression.compressor != POINTWISE:
                    raise
                # Its only chunk may be cut off; what comes before that is right.
                self._layout = layout._replace(last=REST, reason=str(error))
                requests = self._requests(self._layout, selection)

    def _requests(self, layout: Layout, selection: int) -> Iterator[Request]:
        at, last = layout.start, len(layout.counts) - 1
        for index, (length, count) in enumerate(zip(layout.lengths, layout.counts, strict=True)):
            kind = layout.last if index == last else CHUNK
            if count:
                request = self._finder.request(kind, at, int(length), int(count))
                yield request._replace(selection=selection, proven=self._proven)
            at += int(length)

    def _credible(self, pieces: Iterator[bytes | bytearray]) -> Iterator[bytes | bytearray]:
        """Let pass what cannot be proven up to the first point outside of the header's bounding box."""
        for piece in pieces:
            steps = np.frombuffer(piece, np.uint8).reshape(-1, self._size)[:, :12]
            outside = np.flatnonzero(~self._box.holds(np.ascontiguousarray(steps).view("<i4")))
            if len(outside) and self._box.is_credible:
                yield piece[: int(outside[0]) * self._size]
                return
            yield piece

    def _found(self, decoders: Decoders) -> Layout:
        try:
            layout = self._finder.thoroughly(decoders, self._box.holds)
        except Undecodable as error:
            layout = Layout(0, np.zeros(0, np.int64), np.zeros(0, np.int64), reason=str(error))
        self._hold_against_header(layout)
        return layout

    def _hold_against_header(self, layout: Layout) -> None:
        """Take the number of points from the chunks, where they say more than the header."""
        held = int(layout.counts.sum())
        if held > self.count + layout.unread:
            self.remarks.append(
                f"{self._path.name} announces {self.count:,} points in its header, but holds {held:,}; all are read"
            )
            self.count = held
        if layout.has_lost_table and held == self.count:
            self.remarks.append(
                f"{self._path.name} has lost its chunk table, which says where chunks of points "
                f"start; all {held:,} points were found without it"
            )
