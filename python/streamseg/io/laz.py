"""The compressed points of a LAZ: every chunk is proven before a point of it is handed out."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from ..errors import FileError, MissingExtra

try:
    from .laz_decoder import CHUNK, EVERYTHING, POINTWISE, REST
except ImportError as error:  # pragma: no cover - depends on the installation
    raise MissingExtra("reading and writing LAZ needs lazrs; install it: pip install laspy[lazrs]") from error

from .laz_layout import Layout, LayoutFinder, compression_of
from .laz_processes import Decoders, Undecodable

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from .laz_decoder import Request
    from .las_box import Box


class CompressedPoints:
    """The points of one LAZ as bytes.

    Attributes
    ----------
    count : int
        How many there are: what the header announces, or more if the chunks say so.
    unread : int
        How many points more than that the file holds, at most, that are not read; known after reading.
    fits : bool
        Whether the chunks are as many as the count needs, as far as is known without decoding.
    remark : str or None
        One sentence on what is wrong with the file, though all points can be read.
    reason : str
        Why no more than those that were read could be read.
    """

    def __init__(self, file: BinaryIO, path: Path, header: Any, box: Box) -> None:
        self._path, self._size, self._box = path, int(header.point_format.size), box
        self._compression = compression_of(header, path)
        self._finder = LayoutFinder(path, header, self._compression)
        self.count, self.unread = int(header.point_count), 0
        self.remark: str | None = None
        self.reason = ""
        self._proven = 0
        self._layout = self._finder.quickly(file)
        if self._compression.chunk_size is None and self._layout is None:
            with Decoders() as decoders:
                self._layout = self._found(decoders)
        self.fits = self._finder.fits(self.count, self._layout)
        if self._layout is not None:
            self._hold_against_header(self._layout)
        if self.count == 0 and self._finder.has_data:
            raise FileError(
                f"{path} announces 0 points in its header, but holds compressed points; was the program stopped that "
                "wrote it?"
            )

    def pieces(self, selection: int = EVERYTHING) -> Iterator[bytes]:
        """Yield whole records of all chunks, up to the damage if there is any; then `reason` says what it is.

        Layers outside of the selection are not decoded. What has been proven once is not proven again.
        """
        left = self.count * self._size
        with Decoders() as decoders:
            layout = self._layout or self._found(decoders)
            self._layout, self.unread = layout, layout.unread
            for piece in self._decoded(decoders, layout, selection):
                yield piece[:left]
                left -= len(piece)
        self._proven |= selection
        self.reason = self._layout.reason

    def _decoded(self, decoders: Decoders, layout: Layout, selection: int) -> Iterator[bytes]:
        requests = self._requests(layout, selection)
        waiting: list[Request] = []
        done = 0
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
                if request.kind == CHUNK and self._compression.compressor == POINTWISE:
                    self._layout = layout._replace(last=REST, reason=str(error))
                    requests = self._requests(self._layout, selection)
                    continue
                self._layout = layout.first(done, str(error))
                return
            done += 1

    def _requests(self, layout: Layout, selection: int) -> Iterator[Request]:
        at, last = layout.start, len(layout.counts) - 1
        for index, (length, count) in enumerate(zip(layout.lengths, layout.counts, strict=True)):
            kind = layout.last if index == last else CHUNK
            request = self._finder.request(kind, at, int(length), int(count))
            yield request._replace(selection=selection, proven=self._proven)
            at += int(length)

    def _credible(self, pieces: Iterator[bytes]) -> Iterator[bytes]:
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
            self.remark = (
                f"{self._path.name} announces {self.count:,} points in its header, but holds {held:,}; all are read"
            )
            self.count = held
        elif layout.has_lost_table and held == self.count:
            self.remark = (
                f"{self._path.name} has lost its chunk table, which says where chunks of points start; "
                f"all {held:,} points were found without it"
            )
