"""The points of a LAS or LAZ file as blocks of bounded size."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, BinaryIO, Protocol

import numpy as np

from .las_plain import PlainPoints

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from numpy.typing import NDArray

    from .las_box import Box

_BLOCK_BYTES = 1 << 24


class Body(Protocol):
    """The points of one file; see `laz.CompressedPoints`."""

    count: int
    unread: int
    fits: bool
    remarks: list[str]
    reason: str

    def pieces(self, selection: int = ...) -> Iterator[bytes | bytearray]:
        """Yield whole records."""


def body_of(file: BinaryIO, path: Path, header: Any, box: Box, old_count: int) -> Body:
    """Open the points of a file as they are stored; of two counts in a header take what fits."""
    body = _body_of(file, path, header, box)
    counts = int(header.point_count), old_count
    if not old_count or counts[0] == counts[1]:
        return body
    if not body.fits:
        header.point_count = old_count
        other = _body_of(file, path, header, box)
        body = other if other.fits else body
    body.remarks.append(
        f"{path.name} announces {counts[0]:,} points in one field of its header, and "
        f"{counts[1]:,} in another; {body.count:,} are read"
    )
    return body


def _body_of(file: BinaryIO, path: Path, header: Any, box: Box) -> Body:
    if not header.are_points_compressed:
        return PlainPoints(file, path, header)
    from .laz import CompressedPoints

    return CompressedPoints(file, path, header, box)


def in_blocks(
    pieces: Iterator[bytes | bytearray], dtype: np.dtype[Any], size: int, count: int
) -> Iterator[NDArray[np.void]]:
    """Make blocks of `size` records, or of fewer that take 16 MB, of pieces of whole records.

    Parameters
    ----------
    count : int
        How many records are to be expected.
    """
    most = max(1, min(size, _BLOCK_BYTES // dtype.itemsize))
    block, filled = np.empty(min(most, count), dtype), 0
    for piece in pieces:
        records = np.frombuffer(piece, dtype)
        while len(records):
            if len(block) == 0:
                block = np.empty(min(most, max(count, len(records))), dtype)
            taken = min(len(records), len(block) - filled)
            block[filled : filled + taken] = records[:taken]
            records, filled = records[taken:], filled + taken
            if filled == len(block):
                count -= filled
                yield block
                block, filled = np.empty(max(0, min(most, count)), dtype), 0
    if filled:
        yield block[:filled]
