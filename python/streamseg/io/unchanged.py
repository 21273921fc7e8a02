"""Whether a file is still what it was: it is read more than once, and only their place tells points apart.

A reading compares size and time of the file with those at its opening, before and after. Both can be
kept while the points are not, so a checksum of the points is compared too, block by block. Numbers of
inodes say nothing more, and some network file systems give new ones now and then.
"""

from __future__ import annotations

import os
import stat
import zlib
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np

from ..errors import FileError, InvalidInput
from .opening import require_file

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from numpy.typing import NDArray

# Points that have one checksum: some 4 bytes of memory for each 6 MB of points.
_BLOCK = 250_000


class Witness:
    """Knows a file since it was opened: to be made before that."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._stamp = _stamp(path)
        self._sums: list[int] = []
        self._whole: tuple[int, int] | None = None
        self._expected: tuple[str, object] | None = None

    @property
    def digest(self) -> str | None:
        """The number of points and a checksum of them, once the file was read to its end."""
        if self._whole is None:
            return None
        points, last = self._whole
        blocks = np.array([*self._sums[: points // _BLOCK], last], "<u4").tobytes()
        return f"{points}:{zlib.crc32(blocks):08x}"

    def expect(self, digest: object, origin: str) -> None:
        """Have readings refuse other points than those of this digest: `origin` is of them."""
        self._expected = (origin, digest)

    def check(self) -> None:
        """Refuse a file that has changed, as far as the file system says so.

        Raises
        ------
        FileError
            Its size or its time is another, or it is no file any more.
        """
        now = _stamp(self._path)
        if now is None:
            require_file(self._path)
        if now != self._stamp:
            raise self._has_changed()

    @contextmanager
    def reading(self) -> Iterator[Reading]:
        """Watch a reading of the whole file, which tells what it has read.

        Raises
        ------
        FileError
            The file has changed since it was opened, or while it is read.
        InvalidInput
            Its points are not those that are expected.
        """
        self.check()
        reading = Reading(self)
        try:
            yield reading
        except Exception:
            # What cannot be read may be what was being changed.
            self.check()
            raise
        self.check()
        reading.end()

    def compare(self, block: int, checksum: int) -> None:
        """Refuse a block of points that was another when it was read before."""
        if block == len(self._sums):
            self._sums.append(checksum)
        elif self._sums[block] != checksum:
            raise self._has_changed()

    def compare_whole(self, points: int, last: int, is_damaged: bool) -> None:
        """Refuse other points than were read before; of a damaged file not always all are."""
        if self._whole is None:
            self._whole = (points, last)
        elif self._whole != (points, last) and not (is_damaged and self._whole[0] != points):
            raise self._has_changed()
        if self._expected is not None and not is_damaged and self.digest != self._expected[1]:
            raise InvalidInput(
                f"{self._path} has other points than {self._expected[0]} was made from; give the input as it was"
            )

    def _has_changed(self) -> FileError:
        return FileError(
            f"{self._path} has changed since it was opened, so its points cannot be told from others any more and no "
            "labelled file is written; run again when nothing writes to it"
        )


class Reading:
    """One reading of a file, from its first point on."""

    def __init__(self, witness: Witness) -> None:
        self._witness = witness
        self._points = self._checksum = 0
        self.is_damaged = False

    def add(self, points: NDArray[np.float64]) -> None:
        """Take note of the next points, (n, 3), in the units that the file has them in."""
        points = np.ascontiguousarray(points)
        while len(points):
            room = _BLOCK - self._points % _BLOCK
            self._checksum = zlib.crc32(points[:room].data, self._checksum)
            self._points += len(points[:room])
            if self._points % _BLOCK == 0:
                self._witness.compare(self._points // _BLOCK - 1, self._checksum)
                self._checksum = 0
            points = points[room:]

    def end(self) -> None:
        """Take note that there are no more."""
        self._witness.compare_whole(self._points, self._checksum, self.is_damaged)


def _stamp(path: Path) -> tuple[int, int] | None:
    """Size and time of a file; none if it is gone, or is a pipe or the like."""
    try:
        said = os.stat(path)
    except (OSError, ValueError):  # no path at all is told when the file is opened
        return None
    return (said.st_size, said.st_mtime_ns) if stat.S_ISREG(said.st_mode) else None
