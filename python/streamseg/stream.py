"""The framework as an iterator over spans, and whole clouds at once."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._core import (
    Pipeline,
    Recipe,
    Settlement,
    SpanByCount,
    SpanByScanLine,
    SpanByTime,
    SpanByWidth,
    Window,
    default_spans,
)
from .errors import InvalidInput, InvalidParameter, StreamInUse, StreamsegError, warn
from .history import HistoryWriter
from .source import Attributes, PathLike, Source, needed_by, open_source

if TYPE_CHECKING:
    from ._core import SettledSpan
    from ._core import Span as CoreSpan

Ids = NDArray[np.int64]
SpanBy = SpanByWidth | SpanByCount | SpanByTime | SpanByScanLine
Result = Literal["history", "carry", "final"]
RESULTS = ("history", "carry", "final")

_NO_ALIASES: Ids = np.empty((0, 2), np.int64)


class Progress(NamedTuple):
    """How far a run is."""

    points: int
    """Points that have come out."""
    windows: int
    """Windows woven."""
    live_segments: int
    """Segments in scope."""
    segment_ids: int
    """Raw segment ids given."""
    segments: int
    """Segments there are, as far as is known: raw ids less joins."""
    weaving: float
    """Seconds that the weaver has taken."""


@dataclass(frozen=True, eq=False)
class Span:
    """A span as it goes out of scope."""

    index: int
    """Number of the span, from 0."""
    point_ids: Ids
    """Positions of the points in the stream, (n,), ascending."""
    segment_ids: Ids
    """Segment of each point, (n,), -1 = none: raw, carried or final ids, as asked for."""
    aliases: Ids
    """Late joins since the last span, (m, 2): an id that was handed out, and the smaller one it has become."""
    _core: CoreSpan | SettledSpan = field(repr=False)

    @property
    def points(self) -> NDArray[np.float64]:
        """Coordinates, (n, 3), in the units of the source."""
        return self._core.points

    def __len__(self) -> int:
        return len(self.point_ids)


class Stream:
    """Spans as they go out of scope, in order. Made by `stream`.

    An iterator and a context manager: leaving the ``with`` block stops the source; if there is a history, what has come
    so far is still segmented and written, and the history is closed.

    Attributes
    ----------
    exactness : str
        The class of the run: "A" (exact by locality), "B" (exact with a halo) or "C" (measured).
    is_identical : bool
        Whether streamed and static are sure to be the same partition.
    promise : str
        One sentence on how the result relates to the static one.
    warning : str or None
        One sentence, if the spans break the segmentor's condition.
    """

    def __init__(
        self,
        source: Source,
        core: Pipeline,
        result: Result,
        history: HistoryWriter | None,
        with_points: bool,
    ) -> None:
        self._source = source
        self._core = core
        self._result = result
        self._history = history
        self._stopped = False
        self._ended = False
        self._closed = False
        self._told_damage = False
        self._settlement: Settlement | None = None
        if result == "final":
            self._settlement = Settlement(scale=source.scale, offset=source.offset, with_points=with_points)
        self._settled = False
        self._kept = -1
        self._failure: Exception | None = None
        self.exactness = core.exactness
        self.is_identical = core.is_identical
        self.promise = core.promise
        self.warning = core.warning

    def __iter__(self) -> Iterator[Span]:
        return self

    def __next__(self) -> Span:
        if self._closed:
            raise StopIteration
        if self._settlement is not None:
            return self._next_settled(self._settlement)
        core = self._next_woven()
        ids = core.raw_ids if self._result == "history" else core.carried_ids
        aliases = _NO_ALIASES if self._result == "history" else core.aliases
        span = Span(core.index, core.point_ids, ids, aliases, core)
        self._core.acknowledge()
        return span

    def __enter__(self) -> Stream:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, exception: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    @property
    def progress(self) -> Progress:
        """How far the run is."""
        return Progress(*self._core.progress())

    @property
    def live_entries(self) -> tuple[int, int]:
        """Entries of the point-segment and of the segment-segment look-up table, counted one by one."""
        return self._core.live_entries()

    def resolve(self, ids: ArrayLike) -> Ids:
        """Turn ids that this stream has given, raw or carried, into final ids.

        Parameters
        ----------
        ids : (n,) array of int64
            Any ids of this stream; -1 stays -1.

        Returns
        -------
        (n,) int64
            The smallest id of each one's whole. Final when the stream has ended; before that, as far as is known.

        Raises
        ------
        InvalidInput
            If the ids are not whole numbers in one dimension.
        """
        asked = np.asarray(ids)
        if asked.ndim != 1 or (asked.size and asked.dtype.kind not in "iu"):
            raise InvalidInput(f"ids is {asked.dtype} of shape {asked.shape}, expected whole numbers of shape (n,)")
        return self._core.resolve(np.ascontiguousarray(asked, np.int64))

    def stop(self) -> None:
        """Ask the source for no further span; what has come is still segmented and comes out."""
        self._core.stop()
        self._stopped = True

    def close(self) -> None:
        """Stop the source and close the history; spans that nobody took are written there all the same."""
        if not self._ended:
            self.stop()
            if self._history is not None:
                with contextlib.suppress(StopIteration):
                    while True:
                        self._next_woven()
                        self._core.acknowledge()
            self._end(complete=False)
        self._closed = True

    def _next_woven(self) -> CoreSpan:
        """Take the next span from the core and write it; the same again until it is acknowledged.

        An interrupt, or an exception in a callback, loses nothing: the next call goes on.
        """
        try:
            span = next(self._core)
        except StopIteration:
            damage = self._source.damage()
            self._end(complete=damage is None and not self._stopped)
            if damage and not self._told_damage:
                self._told_damage = True
                warn(damage)
            raise
        except StreamInUse:
            raise
        except BaseException:
            if self._core.is_ended():
                self._end(complete=False)
            raise
        if self._history is not None:
            self._write(self._history, span)
        return span

    def _write(self, history: HistoryWriter, span: CoreSpan) -> None:
        try:
            history.write(span, with_aliases=self._result == "carry")
        except StreamsegError:
            # Without a history the spans can still come out.
            self._history = None
            raise

    def _end(self, *, complete: bool) -> None:
        if self._history is not None:
            self._history.close(complete=complete)
            self._history = None
        self._ended = True

    def _next_settled(self, settlement: Settlement) -> Span:
        if not self._settled:
            self._keep_all(settlement)
            self._core.settle(settlement)
            self._settled = True
        for settled in settlement:
            return Span(settled.index, settled.point_ids, settled.segment_ids, _NO_ALIASES, settled)
        if self._failure is not None:
            failure, self._failure = self._failure, None
            raise failure
        raise StopIteration

    def _keep_all(self, settlement: Settlement) -> None:
        try:
            while True:
                span = self._next_woven()
                if span.index != self._kept:
                    settlement.keep(span)
                    self._kept = span.index
                self._core.acknowledge()
        except StopIteration:
            pass
        except Exception as failure:
            if not self._core.is_ended() and not isinstance(failure, StreamsegError):
                raise  # a callback's; the run can go on
            # What came before the failure is finished output; it goes first.
            self._failure = failure


def stream(
    source: Any,
    segmentor: Any,
    *,
    spans: SpanBy | None = None,
    window: Window | None = None,
    history: PathLike | None = None,
    result: Result = "carry",
    threads: int | None = None,
    drop_invalid: bool = False,
    overwrite: bool = False,
    attributes: Attributes | None = None,
    on_progress: Callable[[Progress], None] | None = None,
    with_points: bool = True,
) -> Stream:
    """Segment a cloud as a stream: an iterator over spans as they go out of scope, in order.

    Parameters
    ----------
    source : path, sequence of paths, (n, 3) array, or iterable of (n, 3) arrays
        Where the points come from. Several files are one stream. An iterable is a live source: it is asked for an array
        only when one is needed. An item may also be a pair ``(points, {"gps_time": …})``.
    segmentor : Proximity, object with ``fit_predict(X)``, or function of the window
        Labels the points of a window; a function gets a `WindowPoints` and returns (n,) whole numbers, -1 = none.
    spans : SpanByWidth, SpanByCount, SpanByTime or SpanByScanLine, optional
        How the cloud is cut. Default: a live source as given, one span per array; else spans as wide as 20 times the
        segmentor's reach, or of 100 000 points if it has none.
    window : Window, default Window(3, 1)
        How many spans are segmented together, and how many of them two windows share.
    history : path, optional
        Folder for the history, which keeps the whole story (needs ``pip install streamseg[history]``).
    result : {"carry", "history", "final"}, default "carry"
        Ids carried over on the fly, with aliases; raw ids; or final ones, which come only when the source has ended.
    threads : int, optional
        Windows segmented side by side; each thread beyond the first reads one window ahead. Default: all cores, and 1
        for a live source, so that labels come out as early as they can. Segmentors in Python are called one at a time.
    drop_invalid : bool, default False
        Give points with NaN or infinite coordinates no segment instead of refusing them.
    overwrite : bool, default False
        Replace a history that is already there.
    attributes : mapping of (n,) arrays, or sequence of names, optional
        For an array: its attributes, such as ``{"gps_time": …}``. For a live source the names of those that its items
        bring along and that are to be used instead of computing them. Case and underscores of names do not matter.
    on_progress : function of a Progress, optional
        Called at least once a window. An exception it raises interrupts the run, which can then go on, or be stopped.
    with_points : bool, default True
        With ``result="final"``: whether the spans' coordinates are kept until they come out.

    Returns
    -------
    Stream
        Iterate it, best in a ``with`` block.

    Warns
    -----
    StreamsegWarning
        If the spans break the condition under which streamed equals static, or a file is damaged.

    Raises
    ------
    InvalidParameter, InvalidInput, SegmentorError, FileError
        All of them a `StreamsegError`. Spans that were finished before a failure come out before it is raised.

    Examples
    --------
    >>> import numpy as np, streamseg as ss
    >>> walk = (np.array([[i, 0.0, 0.0]]) for i in range(10))
    >>> with ss.stream(walk, ss.Proximity(1.5)) as spans:
    ...     print([span.segment_ids.tolist() for span in spans][:3])
    [[1], [1], [1]]
    """
    if result not in RESULTS:
        raise InvalidParameter(f"result is {result!r}, allowed: {', '.join(map(repr, RESULTS))}")
    opened = open_source(source, attributes)
    recipe = Recipe(segmentor, list(opened.attributes), opened.has_more)
    if opened.can_be_stored and isinstance(spans, SpanByWidth):
        opened = opened._replace(stored=True)
    if spans is None and opened.stored:
        spans = default_spans(recipe, opened.point_count, opened.extent_x)
    core = _pipeline(opened, recipe, spans, window or Window(), threads, drop_invalid, on_progress)
    if core.warning:
        warn(core.warning)
    writer = None
    if history is not None:
        parameters = {"segmentor": repr(segmentor), "spans": repr(spans), "window": repr(window or Window())}
        writer = HistoryWriter(
            Path(history), source=opened.name, parameters=parameters, promise=core.promise, overwrite=overwrite
        )
    return Stream(opened, core, result, writer, with_points)


def _pipeline(
    source: Source,
    recipe: Recipe,
    spans: SpanBy | None,
    window: Window,
    threads: int | None,
    drop_invalid: bool,
    on_progress: Callable[[Progress], None] | None,
) -> Pipeline:
    if threads is None:
        threads = _cores() if source.stored else 1
    elif threads < 1:
        raise InvalidParameter(f"threads is {threads}, allowed: a whole number of at least 1")
    return Pipeline(
        source.chunks((*needed_by(spans), *recipe.reads)),
        recipe,
        spans,
        window,
        stored=source.stored,
        scale=source.scale,
        offset=source.offset,
        threads=threads,
        drop_invalid=drop_invalid,
        on_progress=None if on_progress is None else lambda progress: on_progress(Progress(*progress)),
    )


def _cores() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def segment(
    source: Any,
    segmentor: Any,
    *,
    spans: SpanBy | None = None,
    window: Window | None = None,
    threads: int | None = None,
    drop_invalid: bool = False,
    attributes: Attributes | None = None,
) -> Ids:
    """Segment a cloud as a stream and return the final segment id of every point.

    Parameters
    ----------
    source, segmentor, spans, window, threads, drop_invalid, attributes
        As for `stream`. A live source has to end.

    Returns
    -------
    (n,) int64
        Final segment ids in input order, from 1; -1 = none.

    Examples
    --------
    >>> import numpy as np, streamseg as ss
    >>> ss.segment(np.array([[0.0, 0, 0], [1, 0, 0], [9, 0, 0]]), ss.Proximity(2.0)).tolist()
    [1, 1, 2]
    """
    with stream(
        source,
        segmentor,
        spans=spans,
        window=window,
        threads=threads,
        drop_invalid=drop_invalid,
        attributes=attributes,
    ) as run:
        return run.resolve(_in_input_order(run))


def segment_static(
    source: Any,
    segmentor: Any,
    *,
    drop_invalid: bool = False,
    attributes: Attributes | None = None,
) -> Ids:
    """Segment the whole cloud as one window.

    Parameters
    ----------
    source, segmentor, drop_invalid, attributes
        As for `stream`. The cloud has to fit in memory.

    Returns
    -------
    (n,) int64
        Segment ids in input order, from 1; -1 = none.

    Examples
    --------
    >>> import numpy as np, streamseg as ss
    >>> ss.segment_static(np.array([[0.0, 0, 0], [1, 0, 0], [9, 0, 0]]), ss.Proximity(2.0)).tolist()
    [1, 1, 2]
    """
    whole = SpanByCount(np.iinfo(np.int64).max)
    opened = open_source(source, attributes)
    recipe = Recipe(segmentor, list(opened.attributes), opened.has_more)
    core = _pipeline(opened, recipe, whole, Window(1, 0), 1, drop_invalid, None)
    return _in_input_order(Stream(opened, core, "carry", None, with_points=False))


def _in_input_order(run: Stream) -> Ids:
    """Collect the ids of a run, which the caller wants all of."""
    taken = [(span.point_ids, span.segment_ids) for span in run]
    if not taken:
        return np.empty(0, np.int64)
    point_ids = np.concatenate([ids for ids, _ in taken])
    labels = np.full(len(point_ids), -1, np.int64)
    labels[point_ids] = np.concatenate([ids for _, ids in taken])
    return labels
