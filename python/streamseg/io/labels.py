"""Segment ids kept on disk between the run that makes them and the file that is written.

Ids arrive in any order and are wanted in the order of the points, for clouds that do not fit in memory. Pairs of
point id and segment id are appended to one file per 2¹⁹ point ids; reading turns one such file at a time into a
dense table.
"""

from __future__ import annotations

import tempfile
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from ..errors import FileError, InvalidInput, InvalidParameter, StreamsegError
from .claims import ScratchFolder
from .home import Home
from .opening import reading

if TYPE_CHECKING:
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
        self._waiting_pairs = 0
        self._dense: tuple[int, NDArray[np.int64], NDArray[np.bool_]] | None = None
        self._is_open = True
        self.has_any = False
        """Whether any point has been labelled."""
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
        self.has_any = True
        self.largest_id = max(self.largest_id, int(segments.max()))
        for start in range(0, len(points), _BUFFERED_PAIRS):
            part = slice(start, start + _BUFFERED_PAIRS)
            self._waiting.append(np.column_stack((points[part], segments[part])))
            self._waiting_pairs += len(self._waiting[-1])
            if self._waiting_pairs >= _BUFFERED_PAIRS:
                self._flush()

    def read(self, start: int, stop: int) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Segment ids of the points start … stop − 1; see `LabelSource.read`.

        Ids of points that were never added are −1.
        """
        self._require_open()
        if not 0 <= start <= stop:
            raise InvalidParameter(f"range is {start} to {stop}, must be 0 <= start <= stop")
        self._flush()
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
        self._waiting, self._waiting_pairs, self._dense = [], 0, None
        self._folder.remove()

    def __enter__(self) -> LabelSpool:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _flush(self) -> None:
        if not self._waiting:
            return
        pairs = np.concatenate(self._waiting)
        self._waiting, self._waiting_pairs, self._dense = [], 0, None
        buckets = pairs[:, 0] >> _BUCKET_BITS
        if (buckets[1:] < buckets[:-1]).any():
            order = np.argsort(buckets, kind="stable")  # stable: of two ids for one point the later stays later
            pairs, buckets = pairs[order], buckets[order]
        starts = np.concatenate(([0], np.flatnonzero(np.diff(buckets)) + 1, [len(pairs)]))
        for start, stop in zip(starts[:-1].tolist(), starts[1:].tolist(), strict=True):
            path = self._path(int(buckets[start]))
            try:
                with open(path, "ab") as file:
                    file.write(pairs[start:stop].data)
            except OSError as error:
                raise FileError(
                    f"cannot write {path}: {error.strerror}; make room there or choose another temporary folder"
                ) from error

    def _load(self, bucket: int) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        if self._dense is not None and self._dense[0] == bucket:
            return self._dense[1:]
        self._dense = None
        ids = np.full(_BUCKET_POINTS, NO_SEGMENT, np.int64)
        reached = np.zeros(_BUCKET_POINTS, np.bool_)
        path = self._path(bucket)
        if path.exists():
            with reading(path) as file:
                while len(block := np.fromfile(file, np.int64, 2 * _PAIRS_AT_A_TIME)):
                    at = block[::2] - (bucket << _BUCKET_BITS)
                    ids[at] = block[1::2]
                    reached[at] = True
        self._dense = (bucket, ids, reached)
        return ids, reached

    def _path(self, bucket: int) -> Path:
        return self._folder.path / f"{bucket:08d}.pairs"

    def _require_open(self) -> None:
        self._home.check()
        if not self._is_open:
            raise StreamsegError("this label spool is closed; its temporary files are gone")


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
