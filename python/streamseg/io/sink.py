"""Labelled clouds: written in the order of the input, and read back."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Protocol, cast

import numpy as np

from ..errors import InvalidInput
from .cloud import DEFAULT_CHUNK, Cloud
from .labels import SEGMENT_DIMENSION, LabelSource
from .output import check_output, replacing
from .text import SUFFIXES as TEXT_SUFFIXES
from .text import TextSource
from .text_sink import CoordinateSink, IdSink, LineSink

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray


class _Sink(Protocol):
    def begin(self, file: BinaryIO) -> None: ...

    def blocks(self) -> Iterator[tuple[int, Any]]: ...

    def append(self, block: Any, ids: NDArray[np.int64], kept: NDArray[np.bool_]) -> int: ...

    def finish(self) -> None: ...


def write_labelled(
    cloud: Cloud,
    out: Path | str,
    labels: LabelSource,
    *,
    overwrite: bool = False,
    progress: Callable[[int], None] | None = None,
) -> int:
    """Read the cloud once more and write its points with their segment ids, in the same order.

    The suffix of `out` decides the format:

    * LAS and LAZ from LAS and LAZ: every dimension, record and identifier of the first file is kept, and
      ``SegmentID`` (int64) added, or replaced where there is one. Several files become one. Records that would no
      longer be true are left out: the octree of COPC, and a spatial index when points are missing.
    * LAS and LAZ from other formats: version 1.4, point format 6, scale 0.001 where that fits.
    * text from text: the lines as they are, with the segment id as last column. A comment at the end of a line is
      not kept.
    * text from other formats: ``x y z SegmentID``.
    * ``.npy``: the segment ids alone, (n,) int64.

    The file gets its name only when it is complete. Points that `labels` has not reached are left out; in a
    ``.npy``, where the row is the point id, they are −1 unless they are the last.

    Parameters
    ----------
    cloud : Cloud
    out : Path or str
    labels : LabelSource
    overwrite : bool
        Whether an existing `out` may be replaced.
    progress : callable, optional
        Called with the number of points done so far.

    Returns
    -------
    int
        Number of points written.

    Raises
    ------
    OutputExists, InvalidParameter, FileError
        See `check_output`; also FileError when the disk is full.
    InvalidInput
        The files cannot be written as one, or no point has been reached.
    """
    out = Path(out)
    check_output(out, cloud.paths, overwrite)
    sink = _sink(cloud, out.suffix.lower())
    done = written = 0
    with replacing(out) as file:
        sink.begin(file)
        for count, block in sink.blocks():
            ids, reached = labels.read(done, done + count)
            if ids.shape != (count,) or reached.shape != (count,):
                raise InvalidInput(
                    f"labels of points {done} to {done + count} have shapes {ids.shape} and {reached.shape}, "
                    f"expected ({count},)"
                )
            written += sink.append(block, ids, reached)
            done += count
            del block, ids, reached  # before the next are made
            if progress is not None:
                progress(done)
        if written == 0:
            raise InvalidInput(f"not one point of {cloud.paths[0]} has been labelled, so {out} is not written")
        sink.finish()
    return written


def check_kind(cloud: Cloud, out: Path | str) -> None:
    """Refuse inputs that cannot become one output of this kind, before any work is done.

    Raises
    ------
    InvalidInput
        LAS files whose point formats or sizes do not go together.
    """
    suffix = Path(out).suffix.lower()
    if cloud.kind == "las" and suffix in (".las", ".laz"):
        _sink(cloud, suffix)


def read_labels(
    path: Path | str, chunk: int = DEFAULT_CHUNK
) -> Iterator[tuple[NDArray[np.float64], NDArray[np.int64]]]:
    """Read a labelled LAS, LAZ or text file in pieces of at most `chunk` points.

    Text without a line of names has its segment ids in the last column.

    Yields
    ------
    (n, 3) float64, (n,) int64
        Coordinates in the units of the file, and segment ids; −1 = none.

    Raises
    ------
    InvalidInput
        The file has no segment ids, or no coordinates.
    """
    from . import open_cloud

    path = Path(path)
    cloud = open_cloud(path)
    if cloud.kind == "npy" and SEGMENT_DIMENSION not in cloud.dimensions:
        raise InvalidInput(f"{path} holds no {SEGMENT_DIMENSION}; give a labelled LAS, LAZ or text file")
    name = SEGMENT_DIMENSION
    if cloud.kind == "text" and name not in cloud.dimensions:
        source = cast("TextSource", cloud.sources[0])
        if source.layout.header is not None or len(cloud.dimensions) < 4:
            raise InvalidInput(f"{path} has no column {name}; there are: {', '.join(cloud.dimensions)}")
        name = cloud.dimensions[-1]
    for points, attributes in cloud.chunks(chunk, (name,)):
        ids = attributes[name]
        if ids.dtype.kind == "f" and not (ids == np.rint(ids)).all():
            raise InvalidInput(f"{path} has numbers in column {name} that are no segment ids: they are not whole")
        yield cloud.lattice.to_coordinates(points), ids.astype(np.int64, copy=False)


def _sink(cloud: Cloud, suffix: str) -> _Sink:
    if suffix == ".npy":
        return IdSink(cloud)
    if suffix in TEXT_SUFFIXES:
        return LineSink(cloud) if cloud.kind == "text" else CoordinateSink(cloud, suffix == ".csv")
    from .las_sink import PointSink, RecordSink

    return RecordSink(cloud, suffix == ".laz") if cloud.kind == "las" else PointSink(cloud, suffix == ".laz")
