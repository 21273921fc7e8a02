"""Labelled clouds: written in the order of the input, and read back."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Protocol, cast

import numpy as np

from ..errors import FileError, InvalidInput, warn
from .cloud import DEFAULT_CHUNK, Cloud
from .home import Home
from .id_column import checked_id_name, id_type
from .labels import NO_SEGMENT, SEGMENT_DIMENSION, LabelSource, as_whole
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
    id_name: str | None = None,
    expected: int | None = None,
    may_end_early: bool = False,
    progress: Callable[[int], None] | None = None,
) -> int:
    """Read the cloud once more and write its points with their segment ids, in the same order.

    The suffix of `out` decides the format:

    * LAS and LAZ from LAS and LAZ: every dimension, record and identifier of the first file is kept, and
      ``SegmentID`` added, or replaced where there is one. Several files become one; where the first has no coordinate
      system, that of the first file that has one is written. Records that would no longer be true are left out: the
      octree of COPC, and a spatial index when points are missing. Ids are int32; int64 from 2³¹ points on.
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
        Whether an existing `out` may be replaced; see `check_output`.
    id_name : str, default "SegmentID"
        What the dimension or column of ids is called.
    expected : int, optional
        How many points `labels` has reached. Nothing is written if the cloud does not have all of them.
    may_end_early : bool, default False
        Whether it may lack some if damage is met that was not known before. A warning says how many.
    progress : callable, optional
        Called with the number of points done so far.

    Returns
    -------
    int
        Number of points written.

    Raises
    ------
    OutputExists, InvalidParameter, FileError
        See `check_output`; also FileError when the disk is full, or a file of the cloud has changed since
        it was opened.
    InvalidInput
        The files cannot be written as one, or no point has been reached.
    """
    out = Path(out)
    check_output(out, cloud.paths, overwrite, id_name)
    sink = _sink(cloud, out, id_name, labels)
    done = written = labelled = 0
    told, lost, home = cloud.damage, "", Home(f"the writing of {out}")
    with replacing(out, overwrite=overwrite) as file:
        sink.begin(file)
        for count, block in sink.blocks():
            ids, reached = labels.read(done, done + count)
            if ids.shape != (count,) or reached.shape != (count,):
                raise InvalidInput(
                    f"labels of points {done} to {done + count} have shapes {ids.shape} and {reached.shape}, "
                    f"expected ({count},)"
                )
            labelled += int(np.count_nonzero(reached))
            written += sink.append(block, ids, reached)
            done += count
            del block, ids, reached  # before the next are made
            if progress is not None:
                progress(done)
                home.check()
        if done == 0 and cloud.damage is not None:
            raise FileError(cloud.damage)
        if written == 0:
            raise InvalidInput(f"not one point of {cloud.paths[0]} has been labelled, so {out} is not written")
        if expected is not None and labelled != expected:
            if not (may_end_early and labelled < expected and cloud.damage not in (None, told)):
                if may_end_early:
                    cloud.check_unchanged()
                raise _disagreement(cloud, out, labelled, expected)
            lost = f"; {expected - labelled:,} points behind it had been segmented and are not in {out}"
        sink.finish()
        cloud.check_unchanged()
    if cloud.damage not in (None, told):
        # More is decoded for writing than for segmenting, so more damage may be met.
        warn(f"{cloud.damage}{lost}")
    return written


def _disagreement(cloud: Cloud, out: Path, labelled: int, expected: int) -> InvalidInput:
    damage = f" ({cloud.damage})" if cloud.damage else ""
    return InvalidInput(
        f"{labelled:,} points of {cloud.paths[0]} have labels, of {expected:,} that there are{damage}; "
        f"give the input that they were made from; {out} is not written"
    )


def check_kind(cloud: Cloud, out: Path | str, id_name: str | None = None) -> None:
    """Refuse inputs that cannot become one output of this kind, before any work is done.

    Raises
    ------
    InvalidInput
        LAS files whose point formats or sizes do not go together, or text files whose columns differ.
    InvalidParameter
        A name for the ids that they cannot have.
    """
    out = Path(out)
    checked_id_name(id_name, out)
    suffix = out.suffix.lower()
    if (cloud.kind == "las" and suffix in (".las", ".laz")) or (cloud.kind == "text" and suffix in TEXT_SUFFIXES):
        _sink(cloud, out, id_name, None)


def read_labels(
    path: Path | str, chunk: int = DEFAULT_CHUNK, id_name: str | None = None
) -> Iterator[tuple[NDArray[np.float64], NDArray[np.int64]]]:
    """Read a labelled LAS, LAZ or text file in pieces of at most `chunk` points.

    The ids are in the dimension or column `id_name`; ``SegmentID`` if it is not given. Text without a line of names
    has its segment ids in the last column.

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
    name = SEGMENT_DIMENSION if id_name is None else id_name
    if cloud.kind == "npy" and name not in cloud.dimensions:
        raise InvalidInput(f"{path} holds no {name}; give a labelled LAS, LAZ or text file")
    if cloud.kind == "text" and name not in cloud.dimensions:
        source = cast("TextSource", cloud.sources[0])
        if id_name is not None or source.layout.header is not None or len(cloud.dimensions) < 4:
            raise InvalidInput(f"{path} has no column {name}; there are: {', '.join(cloud.dimensions)}")
        name = cloud.dimensions[-1]
    for points, attributes in cloud.chunks(chunk, (name,)):
        ids = attributes[name]
        if cloud.kind == "las" and ids.dtype.kind == "f":  # the dimension says what no data is, which is no segment
            ids = np.where(np.isnan(ids), NO_SEGMENT, ids)
        if (whole := as_whole(ids)) is None:
            raise InvalidInput(
                f"{path} has numbers in column {name} that are no segment ids: they are not whole, or beyond 64 bits"
            )
        yield cloud.lattice.to_coordinates(points), whole


def _sink(cloud: Cloud, out: Path, id_name: str | None, labels: LabelSource | None) -> _Sink:
    name, suffix = checked_id_name(id_name, out), out.suffix.lower()
    if suffix == ".npy":
        return IdSink(cloud)
    if suffix in TEXT_SUFFIXES:
        return LineSink(cloud, name) if cloud.kind == "text" else CoordinateSink(cloud, suffix == ".csv", name)
    from .las_sink import PointSink, RecordSink

    kind = RecordSink if cloud.kind == "las" else PointSink
    return kind(cloud, suffix == ".laz", name, lambda points: id_type(points, _largest_id(labels, points)))


def _largest_id(labels: LabelSource | None, points: int | None) -> int:
    """Tell the largest id there is; of labels that do not know it, by reading them."""
    if labels is None or points is None:
        return NO_SEGMENT
    known: int | None = getattr(labels, "largest_id", None)
    if known is not None:
        return known
    largest = NO_SEGMENT
    for start in range(0, points, DEFAULT_CHUNK):
        ids, reached = labels.read(start, min(start + DEFAULT_CHUNK, points))
        largest = max(largest, int(ids[reached].max(initial=NO_SEGMENT)))
    return largest
