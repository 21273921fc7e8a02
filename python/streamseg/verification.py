"""Whether streamed equals static, tried out on a cloud; and if not, where they differ, and why."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._core import Window
from .certificate import Certificate
from .comparison import Difference, Ids, compare
from .cutting import Spans
from .errors import InvalidInput, StreamsegWarning, warn
from .plan import MaxMemory, Stages
from .preprocessing import Stage, listed
from .run import in_input_order, segment_static, stream
from .source import Attributes, Source, open_source
from .stream import Progress, Stream
from .unlabelled import Unlabelled

# What a whole cloud takes in memory, about: the triangulation of its map is the largest part of it.
_BYTES_PER_POINT = 300

_PAIRS_APART = (
    "the spans are in stream order, so points in reach of each other need not share a window; "
    "use spans by width, or revisit=True"
)
_NOTHING_PROVEN = (
    "the spans are in stream order and do not say which part of the map they hold, so nothing can be proven at the "
    "borders of windows; use spans by width, or revisit=True"
)
_NO_PROMISE = "the method makes no promise: the order of the points, or a window as a whole, decides in it"
_DEFECT = "nothing that is known to part the two has happened, so this is a defect of streamseg: please report it"


@dataclass(frozen=True, eq=False)
class Verification:
    """What came of segmenting a cloud streamed and static. ``str()`` tells all of it to people."""

    is_identical: bool
    """Whether the two are the same partition, points without a segment included."""
    adjusted_rand_index: float
    """How well they agree: 1 if they are the same, about 0 if they have nothing to do with each other."""
    points: int
    """Points of the cloud."""
    static_segments: int
    """Segments of the static result."""
    streamed_segments: int
    """Segments of the streamed result."""
    differing: Ids
    """The points that differ, (m,), ascending."""
    differences: tuple[Difference, ...]
    """The first of them, one for each pair of segments that they are in."""
    positions: NDArray[np.float64]
    """Coordinates of the points that `differences` names, (k, 3), in the units of the source."""
    reasons: tuple[str, ...]
    """Why they may differ, the likeliest first; empty if they do not."""
    certificate: Certificate
    """What the streamed run could prove by itself."""
    is_proven: bool
    """Whether it could prove that it is the static result."""
    promise: str
    """What it said of itself beforehand."""
    damage: str | None
    """What could not be read, if the source is damaged; the points before it were compared."""
    unlabelled: Unlabelled
    """How many points have no segment in the streamed result, by cause."""
    static_unlabelled: int
    """How many points have no segment in the static result."""
    caution: str | None = None
    """Why distances between the points are not what they seem, such as coordinates in degrees."""

    def __str__(self) -> str:
        return "\n".join(self._lines())

    def _lines(self) -> Iterator[str]:
        if self.is_identical:
            yield f"identical: {self.points:,} points in {self.static_segments:,} segments, streamed and static"
            if self.static_unlabelled:
                yield f"{self.static_unlabelled:,} of the points have no segment: {self.unlabelled}"
        else:
            yield (
                f"not identical: {self.streamed_segments:,} segments streamed, {self.static_segments:,} static; "
                f"adjusted Rand index {_short_of_one(self.adjusted_rand_index)}; "
                f"{len(self.differing):,} of {self.points:,} points differ"
            )
            if self.static_unlabelled or self.unlabelled.total:
                yield (
                    f"{self.unlabelled.total:,} points have no segment streamed, {self.static_unlabelled:,} static; "
                    f"streamed: {self.unlabelled}"
                )
            yield from self._table()
            yield "why, the likeliest first:"
            yield from (f"  {number}. {reason}" for number, reason in enumerate(self.reasons, 1))
        yield f"certificate: {self.certificate}{'; equal to the static result, proven' if self.is_proven else ''}"
        if self.is_identical and not self.is_proven:
            yield f"promise: {self.promise}"
        elif self.caution:
            yield f"but {self.caution}"

    def _table(self) -> Iterator[str]:
        yield f"{'first point':>14} {'x':>14} {'y':>14} {'z':>10} {'static':>10} {'streamed':>10} {'points':>10}"
        for difference, (x, y, z) in zip(self.differences, self.positions, strict=True):
            point, static, streamed, count = difference
            yield f"{point:>14} {x:>14.3f} {y:>14.3f} {z:>10.3f} {static:>10} {streamed:>10} {count:>10,}"


def verify(
    source: Any,
    segmentor: Any,
    *,
    spans: Spans | None = None,
    window: Window | None = None,
    max_memory: MaxMemory | None = None,
    threads: int | None = None,
    drop_invalid: bool = False,
    attributes: Attributes | None = None,
    preprocess: Stages = (),
    revisit: bool = False,
    on_progress: Callable[[Progress], None] | None = None,
) -> Verification:
    """Segment a cloud as a stream and as a whole, and compare the two.

    Parameters
    ----------
    source, segmentor, spans, window, max_memory, threads, drop_invalid, attributes, preprocess, revisit, on_progress
        As for `stream`. The cloud is read several times, so it cannot be an iterator, and has to fit in memory.

    Returns
    -------
    Verification
        Whether they are identical; if not, how well they agree, the first points that differ, and why.

    Warns
    -----
    StreamsegWarning
        As `stream` does, and if the static result may need more memory than this machine has.

    Raises
    ------
    InvalidInput
        If the source can be read only once, or brings other points the second time.
    InvalidParameter, SegmentorError, FileError
        As `stream` does.

    Examples
    --------
    >>> import numpy as np, streamseg as ss
    >>> cloud = np.column_stack([np.arange(100.0), np.zeros((100, 2))])
    >>> print(ss.verify(cloud, ss.Proximity(1.5, metric="xy"), spans=ss.SpanByWidth(10.0)))
    identical: 100 points in 1 segments, streamed and static
    certificate: nothing to count; equal to the static result, proven
    """
    if isinstance(source, Iterator):
        raise InvalidInput(
            f"source is {type(source).__name__}, which can be read only once, and verify reads it several times; "
            "give a path, an array, or a list of arrays"
        )
    opened, stages = open_source(source, attributes), listed(preprocess)
    _warn_of_size(opened.point_count)
    run = stream(
        opened,
        segmentor,
        spans=spans,
        window=window,
        max_memory=max_memory,
        result="final",
        threads=threads,
        drop_invalid=drop_invalid,
        preprocess=stages,
        on_progress=on_progress,
        with_points=False,
        revisit=revisit,
    )
    with run:
        streamed = in_input_order(run)
    with warnings.catch_warnings():
        # They have been given.
        warnings.simplefilter("ignore", StreamsegWarning)
        static = segment_static(opened, segmentor, drop_invalid=drop_invalid, preprocess=stages)
    if len(static) != len(streamed):
        raise InvalidInput(f"source has {len(streamed):,} points when read once and {len(static):,} when read again")
    reasons = _reasons(run, stages, is_in_stream_order=run.is_in_stream_order and not revisit)
    return _judge(opened, run, static, streamed, reasons)


def _judge(source: Source, run: Stream, static: Ids, streamed: Ids, reasons: list[str]) -> Verification:
    """Compare the two results; the reasons hold if they differ."""
    found = compare(static, streamed)
    is_identical = not len(found.differing)
    return Verification(
        is_identical=is_identical,
        adjusted_rand_index=found.adjusted_rand_index,
        points=len(static),
        static_segments=_count(static),
        streamed_segments=_count(streamed),
        differing=found.differing,
        differences=found.differences,
        positions=_positions(source, [difference.point_id for difference in found.differences]),
        reasons=() if is_identical else tuple(reasons),
        certificate=run.certificate,
        is_proven=run.is_proven,
        promise=run.promise,
        damage=source.damage(),
        caution=source.caution,
        unlabelled=run.unlabelled,
        static_unlabelled=int(np.count_nonzero(static < 0)),
    )


def _reasons(run: Stream, stages: list[Stage], *, is_in_stream_order: bool) -> list[str]:
    """Tell why the two differ, from what is known of the run; the likeliest first."""
    reasons = [run.warning] if run.warning else []
    if is_in_stream_order and not run.is_identical:
        reasons.append(_PAIRS_APART if run.exactness == "A" else _NOTHING_PROVEN)
    reasons += [
        f"{stage!r} judges a point by those that came before it, so it depends on the spans"
        for stage in stages
        if getattr(stage, "statistics", None) == "running"
    ]
    reasons += run.certificate.doubts
    if run.is_identical:
        return reasons or [_DEFECT]
    if run.exactness == "C" and not (is_in_stream_order or run.certificate.early_decisions):
        reasons.append(_NO_PROMISE)
    return reasons or [run.promise]


def _positions(source: Source, point_ids: list[int]) -> NDArray[np.float64]:
    """Read the coordinates of a few points."""
    wanted = np.array(point_ids, np.int64)
    positions = np.full((len(wanted), 3), np.nan)
    begin = 0
    for points, _ in source.chunks(()) if point_ids else ():
        chunk = np.asarray(points, np.float64)
        is_here = (wanted >= begin) & (wanted < begin + len(chunk))
        positions[is_here] = chunk[wanted[is_here] - begin]
        begin += len(chunk)
        if begin > wanted.max():
            break
    return positions * (source.scale or 1.0) + (source.offset or 0.0)


def _count(ids: Ids) -> int:
    return int(np.count_nonzero(np.unique(ids) >= 0))


def _warn_of_size(points: int | None) -> None:
    """Warn if the whole cloud may not fit in memory."""
    if points is None or not hasattr(os, "sysconf"):
        return
    needed, there_is = points * _BYTES_PER_POINT, os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    if needed > there_is:
        warn(
            f"the static result of {points:,} points may need {needed / 1e9:,.0f} GB of memory, this machine has "
            f"{there_is / 1e9:,.0f} GB; verify a part of the cloud"
        )


def _short_of_one(index: float) -> str:
    """Write an index with 6 digits; never as 1, which only the same partition has."""
    return f"{index:.6f}" if index < 0.999_999_5 else "above 0.999999"
