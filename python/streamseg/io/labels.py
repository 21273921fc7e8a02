"""Segment ids kept on disk between the run that makes them and the file that is written.

Ids arrive in any order and are wanted in the order of the points, for clouds that do not fit in memory. Pairs of
point id and segment id are appended to one file per 2¹⁹ point ids; reading turns one such file at a time into a
dense table.
"""

from __future__ import annotations

import os
import tempfile
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from ..errors import FileError, InvalidInput, InvalidParameter, StreamsegError
from .claims import ScratchFolder
from .home import Home

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path
    from types import TracebackType

    from numpy.typing import ArrayLike, NDArray

NO_SEGMENT = -1
SEGMENT_DIMENSION = "SegmentID"
# How LAS describes the dimension with the ids, whatever it is called: by this an output is known.
LAS_SIGN = b"streamseg segment"

_BUCKET_BITS = 19
_BUCKET_POINTS = 1 << _BUCKET_BITS
_BUFFERED_PAIRS = 1 << 18  # 4 MiB
_PAIRS_AT_A_TIME = 1 << 16  # 1 MiB
_PAIR_BYTES = 16


class LabelSource(Protocol):
    """Whatever can say which segment the points of a range belong to."""

    def read(self, start: int, stop: int) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Segment ids of the points start … stop − 1.

        Returns
        -------
        ids : (stop - start,) int64
            −1 = in no segment.
        reached : (stop - start,) bool
            Whether the run got as far as this point; ids of others mean nothing.
        """


class LabelSpool:
    """Collects segment ids in any order and hands them out in point order, in bounded memory.

    Uses about 15 MiB, however long the stream is. A point id that is added
    again takes the later segment id.

    Parameters
    ----------
    folder : Path or str, optional
        Where to put the temporary files, 16 bytes per point; the system's temporary folder if not given. What
        dead runs have left there is removed.

    Examples
    --------
    >>> with LabelSpool() as spool:
    ...     spool.add([3, 0], [7, -1])
    ...     ids, reached = spool.read(0, 4)
    >>> ids.tolist(), reached.tolist()
    ([-1, -1, -1, 7], [True, False, False, True])
    """

    def __init__(self, folder: Path | str | None = None) -> None:
        try:
            self._folder = ScratchFolder(folder)
        except OSError as error:
            raise FileError(f"cannot make a temporary folder in {folder or tempfile.gettempdir()}: {error}") from error
        self._home = Home("this label spool")
        self._waiting: list[NDArray[np.int64]] = []
        # Pairs in the file of each bucket.
        self._written: dict[int, int] = {}
        self._dense: tuple[int, NDArray[np.int64], NDArray[np.bool_]] | None = None
        self._is_open = True
        self.largest_id = NO_SEGMENT
        """The largest segment id that has been added."""

    def add(self, point_ids: ArrayLike, segment_ids: ArrayLike) -> None:
        """Note the segment of each point.

        Parameters
        ----------
        point_ids : (k,) int64
            From 0 on, in any order.
        segment_ids : (k,) int64
            One per point id; −1 = in no segment.

        Raises
        ------
        InvalidInput
            The arrays differ in length, are no integers, or a point id is negative.
        FileError
            The temporary folder is full.
        """
        self._require_open()
        points, segments = _as_ids("point_ids", point_ids), _as_ids("segment_ids", segment_ids)
        if points.shape != segments.shape:
            raise InvalidInput(f"'segment_ids' has shape {segments.shape}, expected {points.shape}: one per point id")
        if len(points) == 0:
            return
        if points.min() < 0:
            raise InvalidInput(f"point id {points.min()} is negative, point ids start at 0")
        self.largest_id = max(self.largest_id, int(segments.max()))
        self._dense = None
        for start in range(0, len(points), _BUFFERED_PAIRS):
            part = slice(start, start + _BUFFERED_PAIRS)
            pairs = np.column_stack((points[part], segments[part]))
            if self._waiting and self._waiting_pairs + len(pairs) > _BUFFERED_PAIRS:
                self._flush()
            self._waiting.append(pairs)

    def read(self, start: int, stop: int) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Segment ids of the points start … stop − 1; see `LabelSource.read`.

        Ids of points that were never added are −1.

        Raises
        ------
        FileError
            A temporary file has gone, or become shorter.
        """
        self._require_open()
        if not 0 <= start <= stop:
            raise InvalidParameter(f"range is {start} to {stop}, must be 0 <= start <= stop")
        ids = np.full(stop - start, NO_SEGMENT, np.int64)
        reached = np.zeros(stop - start, np.bool_)
        at = start
        while at < stop:
            bucket = at >> _BUCKET_BITS
            until = min(stop, (bucket + 1) << _BUCKET_BITS)
            table_ids, table_reached = self._load(bucket)
            inside = slice(at - (bucket << _BUCKET_BITS), until - (bucket << _BUCKET_BITS))
            ids[at - start : until - start] = table_ids[inside]
            reached[at - start : until - start] = table_reached[inside]
            at = until
        return ids, reached

    def close(self) -> None:
        """Remove the temporary files. Closing again does nothing."""
        self._is_open = False
        self._waiting, self._dense = [], None
        self._folder.remove()

    def __enter__(self) -> LabelSpool:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def has_any(self) -> bool:
        """Whether any point has been labelled."""
        return self.count > 0

    @property
    def count(self) -> int:
        """How many labels have been added."""
        return self._waiting_pairs + sum(self._written.values())

    @property
    def _waiting_pairs(self) -> int:
        return sum(map(len, self._waiting))

    def _flush(self) -> None:
        """Write what waits; what cannot be written waits on."""
        self._waiting = [pairs := np.concatenate(self._waiting)]
        buckets = pairs[:, 0] >> _BUCKET_BITS
        if (buckets[1:] < buckets[:-1]).any():
            # Stable: of two ids for one point the later stays later.
            order = np.argsort(buckets, kind="stable")
            pairs, buckets = pairs[order], buckets[order]
        self._waiting = [pairs]
        for stop in [*(np.flatnonzero(np.diff(buckets)) + 1).tolist(), len(pairs)]:
            start = len(pairs) - len(self._waiting[0])
            self._append(int(buckets[start]), pairs[start:stop])
            self._waiting = [pairs[stop:]]
        self._waiting = []

    def _append(self, bucket: int, pairs: NDArray[np.int64]) -> None:
        """Write behind what the file is known to hold: a write that failed may have left half a pair there."""
        path, before = self._path(bucket), self._written.get(bucket, 0)
        try:
            with open(path, "r+b" if before else "wb") as file:
                if file.seek(0, os.SEEK_END) < before * _PAIR_BYTES:
                    raise _gone(path)
                file.seek(before * _PAIR_BYTES)
                file.write(pairs.data)
        except FileNotFoundError:
            raise _gone(path) from None
        except FileError:
            raise
        except OSError as error:
            raise FileError(
                f"cannot write {path}: {error.strerror}; make room there or choose another temporary folder"
            ) from error
        self._written[bucket] = before + len(pairs)

    def _load(self, bucket: int) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        if self._dense is not None and self._dense[0] == bucket:
            return self._dense[1:]
        self._dense = None
        ids = np.full(_BUCKET_POINTS, NO_SEGMENT, np.int64)
        reached = np.zeros(_BUCKET_POINTS, np.bool_)
        for points, segments in self._pairs(bucket):
            at = points - (bucket << _BUCKET_BITS)
            ids[at] = segments
            reached[at] = True
        self._dense = (bucket, ids, reached)
        return ids, reached

    def _pairs(self, bucket: int) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64]]]:
        """Yield what has been added of a bucket: what is on disk, then what waits."""
        if left := self._written.get(bucket, 0):
            path = self._path(bucket)
            try:
                with open(path, "rb") as file:
                    while left:
                        block = np.fromfile(file, np.int64, 2 * min(left, _PAIRS_AT_A_TIME))
                        if len(block) < 2 * min(left, _PAIRS_AT_A_TIME):
                            raise _gone(path)
                        yield block[::2], block[1::2]
                        left -= len(block) // 2
            except FileNotFoundError:
                raise _gone(path) from None
            except FileError:
                raise
            except OSError as error:
                raise FileError(f"cannot read {path}: {error.strerror}") from error
        for waiting in self._waiting:
            inside = waiting[waiting[:, 0] >> _BUCKET_BITS == bucket]
            yield inside[:, 0], inside[:, 1]

    def _path(self, bucket: int) -> Path:
        return self._folder.path / f"{bucket:08d}.pairs"

    def _require_open(self) -> None:
        self._home.check()
        if not self._is_open:
            raise StreamsegError("this label spool is closed; its temporary files are gone")


def _gone(path: Path) -> FileError:
    return FileError(
        f"the temporary file {path} has been removed or cut by something else; "
        "set TMPDIR to a folder that nobody cleans up during the run"
    )


def _as_ids(name: str, values: ArrayLike) -> NDArray[np.int64]:
    array = np.asarray(values)
    if array.ndim != 1:
        raise InvalidInput(f"{name!r} has shape {array.shape}, expected (k,)")
    if array.dtype.kind not in "iu" and array.size:
        raise InvalidInput(f"{name!r} has dtype {array.dtype}, expected int64")
    if (ids := as_whole(array)) is None:
        raise InvalidInput(f"{name!r} has {array.max()}, expected numbers below 2^63")
    return ids


def as_whole(values: NDArray[Any]) -> NDArray[np.int64] | None:
    """Make numbers int64 as they are; none if one of them is not whole, or too large for that."""
    if values.dtype.kind == "f" and not ((values == np.rint(values)) & (np.abs(values) < 2.0**63)).all():
        return None
    if values.dtype.kind == "u" and values.size and int(values.max()) > np.iinfo(np.int64).max:
        return None
    return values.astype(np.int64, copy=False)
