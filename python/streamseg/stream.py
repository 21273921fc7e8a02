"""A run of the framework as an iterator over spans."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from types import TracebackType
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._core import Pipeline, Settlement
from .certificate import Certificate
from .errors import InvalidInput, InvalidParameter, InvalidType, StreamInUse, StreamsegError, warn
from .history import HistoryWriter
from .source import Source
from .unlabelled import Unlabelled

if TYPE_CHECKING:
    from ._core import SettledSpan, Turn
    from ._core import Span as CoreSpan

Ids = NDArray[np.int64]
Result = Literal["history", "carry", "final"]
RESULTS = ("history", "carry", "final")

_NO_ALIASES: Ids = np.empty((0, 2), np.int64)

# Who presses Ctrl-C waits no longer than this for windows under way, in seconds.
PATIENCE = 1.0
_LONGEST_PATIENCE = 1e9


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
    """Segments there are, as far as is known: raw ids less joins. With final ids: those that are kept."""
    weaving: float
    """Seconds that the weaver has taken."""


class LeftOut(NamedTuple):
    """What final ids leave out: segments that are too small or too large, or hold no seed."""

    segments: int
    """How many segments."""
    points: int
    """How many points they have."""


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

    An iterator and a context manager: leaving the ``with`` block stops the source. If there is a history, what has come
    so far is still segmented and written to it. Then it is closed. Left by a KeyboardInterrupt, the stream waits a
    second for that: windows that are not segmented by then are given up.

    One thread at a time takes spans; another that tries gets a `StreamInUse`. Any thread may `stop` or `close` it at
    any time. A forked process that goes on with it gets a `StreamInUse`, too. Closing it there does nothing.

    Attributes
    ----------
    exactness : str
        The class of the run: "A" (exact by locality), "B" (exact with a halo) or "C" (measured).
    is_identical : bool
        Whether streamed and static are sure to be the same partition.
    is_in_stream_order : bool
        Whether spans are cut in the order of the stream, so that none holds all points of its part of the map.
    promise : str
        One sentence on how the result relates to the static one, with the caution if there is one.
    caution : str or None
        One sentence, if distances between the points are not what they seem: coordinates in degrees, mixed units.
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
        self._ended = False
        self._closing = False
        self._closed = False
        self._told_damage = False
        self._settlement: Settlement | None = None
        if result == "final":
            self._settlement = Settlement(lattice=source.lattice, with_points=with_points)
        # Segments kept; by cause, segments left out and their points: once it is known.
        self._selected: tuple[int, dict[str, int], dict[str, int]] | None = None
        # The last span that came out of the core, and the points without a segment up to there: set in one step.
        self._taken = (-1, Unlabelled())
        self._failure: Exception | None = None
        self.exactness = core.exactness
        self.is_identical = core.is_identical
        self.is_in_stream_order = core.is_in_stream_order
        self.caution = source.caution
        self.promise = source.with_caution(core.promise)
        self.warning = core.warning

    def __iter__(self) -> Iterator[Span]:
        return self

    def __next__(self) -> Span:
        if self._closed:
            raise StopIteration
        with self._turn():
            return self._next() if self._settlement is None else self._next_settled(self._settlement)

    def _turn(self) -> Turn:
        """Take the turn, for a ``with`` block; no variable keeps it: exceptions keep those alive."""
        try:
            return self._core.turn()
        except StreamInUse:
            if self._closing and self._core.is_at_home():
                raise StopIteration from None
            raise

    def _next(self) -> Span:
        core = self._next_woven()
        self._take(core)
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
        is_interrupted = kind is not None and not issubclass(kind, Exception)
        self._close(patience=PATIENCE if is_interrupted else None)

    @property
    def progress(self) -> Progress:
        """How far the run is."""
        progress = Progress(*self._core.progress())
        return progress if self._selected is None else progress._replace(segments=self._selected[0])

    @property
    def certificate(self) -> Certificate:
        """What the run could prove so far; after the end, whether streamed and static are sure to be the same."""
        return Certificate(*self._core.certificate())

    @property
    def is_proven(self) -> bool:
        """Whether the run has ended, without a failure, and is sure to have given the static partition."""
        return self.is_identical and self._core.is_whole() and self.certificate.is_complete

    @property
    def left_out(self) -> LeftOut:
        """What the limits of the segmentor leave out of final ids; nothing until the first final ids come."""
        left_out = self.left_out_by_cause.values()
        return LeftOut(sum(each.segments for each in left_out), sum(each.points for each in left_out))

    @property
    def left_out_by_cause(self) -> dict[str, LeftOut]:
        """The same by cause: "no_seed", "too_small" and "too_large", those that there are."""
        if self._selected is None:
            return {}
        _, segments, points = self._selected
        return {cause: LeftOut(segments[cause], points[cause]) for cause in segments if segments[cause]}

    @property
    def unlabelled(self) -> Unlabelled:
        """How many points that came out have no segment, by cause; nothing until the first final ids come."""
        unlabelled = self._taken[1]
        if self._result != "final":
            return unlabelled
        return Unlabelled() if self._selected is None else unlabelled.with_more(self._selected[2])

    @property
    def live_entries(self) -> tuple[int, int]:
        """Entries of the point-segment and of the segment-segment look-up table, counted one by one."""
        return self._core.live_entries()

    def resolve(self, ids: ArrayLike, *, limits: bool = False) -> Ids:
        """Turn ids that this stream has given, raw or carried, into final ids.

        Parameters
        ----------
        ids : (n,) array of int64
            Any ids of this stream, but none that were numbered anew by size; -1 stays -1.
        limits : bool, default False
            Whether the segmentor's limits of size, its seeds and its order apply, as with ``result="final"``: what they
            leave out becomes -1. Without, the points of segments that are too small can be found.

        Returns
        -------
        (n,) int64
            The smallest id of each one's whole. Final when the stream has ended; before that, as far as is known.

        Raises
        ------
        InvalidInput
            If the ids are not whole numbers in one dimension, or not those of this stream.
        InvalidParameter
            If limits are to apply before the stream has ended.
        """
        asked = np.asarray(ids)
        if asked.ndim != 1 or (asked.size and asked.dtype.kind not in "iu"):
            raise InvalidInput(f"ids is {asked.dtype} of shape {asked.shape}, expected whole numbers of shape (n,)")
        given = self._core.progress()[3]
        if odd := asked[(asked < -1) | (asked == 0) | (asked > given)][:1].tolist():
            raise InvalidInput(f"ids has {odd[0]}, which this stream has not given; it has given 1 to {given}")
        if limits and not self._core.is_ended():
            raise InvalidParameter(
                "limits is True before the stream has ended, allowed: after that; sizes are not known before"
            )
        return self._core.resolve(np.ascontiguousarray(asked, np.int64), limits)

    def stop(self, patience: float | None = None) -> None:
        """Ask the source for no further span; what has come is still segmented and comes out.

        May be called from any thread, from a callback or from the source itself; it never waits. A live source that is
        waited for cannot be interrupted. The stream goes on when its next array comes, or its end. That array is still
        segmented.

        Parameters
        ----------
        patience : float, optional
            After so many seconds, windows that are not segmented yet are given up. Points that only they have do not
            come out. Default: none is given up.

        Raises
        ------
        InvalidParameter
            The patience is negative or no number.
        """
        self._core.stop(None if patience is None else _checked_patience(patience))

    def discard_empty_history(self) -> None:
        """Have the folder of the history removed if the run fails before the first span."""
        if self._history is not None:
            self._history.is_kept_empty = False

    def close(self) -> None:
        """Stop the source and close the history; spans that nobody took are written there all the same.

        If another thread is taking a span just then, this only asks to stop, as `stop` does. That thread gets what has
        come, then the end. It closes the history, too.
        """
        self._close(patience=None)

    def _close(self, patience: float | None) -> None:
        if not self._ended and self._core.is_at_home():
            self._closing = True
            self.stop(patience)
            try:
                with self._turn():
                    self._write_the_rest()
            except StopIteration:
                return  # whoever has the turn goes on
        self._closed = True

    def _write_the_rest(self) -> None:
        if self._history is not None:
            with contextlib.suppress(StopIteration):
                while True:
                    self._next_woven()
                    self._core.acknowledge()
        self._end(complete=False)

    def _next_woven(self) -> CoreSpan:
        """Take the next span from the core and write it; the same again until it is acknowledged.

        An interrupt, or an exception in a callback, loses nothing: the next call goes on.
        """
        try:
            span = next(self._core)
        except StopIteration:
            damage = self._source.damage()
            self._end(complete=damage is None and self._core.is_whole())
            if damage and not self._told_damage:
                self._told_damage = True
                warn(damage)
            raise
        except StreamInUse:
            raise
        except BaseException:
            if self._core.is_at_home() and self._core.is_ended():
                self._end(complete=False)
            raise
        if self._history is not None:
            self._write(self._history, span)
        return span

    def _take(self, span: CoreSpan) -> None:
        """Count the points of a span that have no segment: once, however often it is given."""
        last, unlabelled = self._taken
        if span.index != last:
            self._taken = (span.index, unlabelled.with_more(span.unlabelled))

    def _write(self, history: HistoryWriter, span: CoreSpan) -> None:
        try:
            history.write(span, with_aliases=self._result == "carry")
        except StreamsegError:
            # Without a history the spans can still come out.
            self._history = None
            raise

    def _end(self, *, complete: bool) -> None:
        if self._history is not None:
            try:
                self._history.close(
                    complete=complete, certificate=self.certificate._asdict(), digests=self._source.digests()
                )
            except StreamsegError:
                # Told once: what was segmented comes out all the same.
                self._history, self._ended = None, True
                raise
            self._history = None
        ended_before, self._ended = self._ended, True
        is_first = not ended_before and self._core.is_whole()
        if self.exactness == "B" and is_first and (undecided := self.certificate.undecided_points):
            warn(
                f"{undecided:,} points were left undecided, because their neighbors were not all loaded: the result "
                "may differ from the static one there; give a search_radius or wider spans, or the cloud as a file or "
                "an array"
            )

    def _next_settled(self, settlement: Settlement) -> Span:
        if self._selected is None:
            self._keep_all(settlement)
            self._selected = self._core.settle(settlement)
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
                if span.index != self._taken[0]:
                    settlement.keep(span)
                self._take(span)
                self._core.acknowledge()
        except StopIteration:
            pass
        except Exception as failure:
            if not self._core.is_ended() and not isinstance(failure, StreamsegError):
                raise  # a callback's; the run can go on
            # What came before the failure is finished output; it goes first.
            self._failure = failure


def _checked_patience(patience: object) -> float:
    if isinstance(patience, bool) or not isinstance(patience, (int, float, np.integer, np.floating)):
        raise InvalidType(f"patience is {type(patience).__name__}, allowed: a number of seconds, or None")
    if not patience >= 0:  # NaN is refused, too
        raise InvalidParameter(f"patience is {patience}, allowed: 0 or more seconds, or None")
    return float(min(patience, _LONGEST_PATIENCE))
