"""How a cloud is cut into spans and windows: as asked for, as suits the segmentor, by a plan, or in slabs that wait."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, NamedTuple

from ._core import (
    Plan,
    Recipe,
    SlabCounts,
    SpanByCount,
    SpanByScanLine,
    SpanByTime,
    SpanByWidth,
    Window,
    default_spans,
)
from .errors import InvalidParameter, InvalidType, warn
from .finalization import slabs_for
from .plan import MaxMemory, planned
from .source import Source
from .threads import cores

SpanBy = SpanByWidth | SpanByCount | SpanByTime | SpanByScanLine
Spans = SpanBy | Plan | Literal["auto"]


class Asked(NamedTuple):
    """What the caller says of spans and windows."""

    spans: Spans | None
    window: Window | None
    max_memory: MaxMemory | None
    revisit: bool

    @property
    def is_auto(self) -> bool:
        """Whether spans and windows are to be chosen."""
        return isinstance(self.spans, str) or (self.spans is None and self.max_memory is not None)

    @property
    def reads_first(self) -> bool:
        """Whether the cloud may be read before it is segmented."""
        return self.is_auto or self.revisit

    def check(self) -> None:
        """Refuse what does not go together, before anything is read."""
        spans, window, max_memory = self.spans, self.window, self.max_memory
        is_auto = isinstance(spans, str) and spans == "auto"
        if not (spans is None or is_auto or isinstance(spans, (SpanBy, Plan))):
            raise InvalidParameter(
                f"spans is {spans!r}, allowed: 'auto', SpanByWidth, SpanByCount, SpanByTime, SpanByScanLine or a Plan"
            )
        if not (window is None or isinstance(window, Window)):
            raise InvalidType(f"window is {window!r}, allowed: a Window, such as Window(3, 1)")
        if not isinstance(self.revisit, bool):
            raise InvalidType(f"revisit is {self.revisit!r}, allowed: True or False")
        if max_memory is not None and not self.is_auto:
            raise InvalidParameter(
                f"max_memory is {max_memory!r} with {spans!r}, allowed: with spans='auto' or no spans"
            )
        if window is not None and (self.is_auto or isinstance(spans, Plan)):
            raise InvalidParameter(
                f"window is {window!r} with a plan, allowed: none; the plan says how large windows are"
            )


class Cut(NamedTuple):
    """How a cloud is cut."""

    spans: SpanBy | Plan | None
    """None = as the source gives them."""
    window: Window
    threads: int
    slabs: SlabCounts | None
    """The counted slabs in which points wait until their part of the map is final."""
    brings_back: bool
    """Whether points that have gone out of scope come back."""


def cut(
    source: Source,
    recipe: Recipe,
    asked: Asked,
    *,
    threads: int | None,
    drop_invalid: bool,
    with_history: bool,
    on_progress: Callable[[tuple[Any, ...]], None] | None,
) -> Cut:
    """Choose what was not asked for; reads the cloud where that depends on all of it."""
    spans = _spans(source, recipe, asked, drop_invalid=drop_invalid, with_history=with_history)
    window = asked.window or Window()
    if threads is None:
        threads = cores() if source.stored else 1
    if isinstance(spans, Plan):
        window, threads = spans.window, min(threads, spans.at_a_time)
        if spans.warning:
            warn(spans.warning)
    if not asked.revisit:
        return Cut(spans, window, threads, slabs=None, brings_back=False)
    coming_back = recipe.coming_back(spans, window, stored=source.stored, lattice=source.lattice)
    slabs = None
    if coming_back == "wait":
        by_width, slabs = slabs_for(source, recipe, drop_invalid=drop_invalid, on_progress=on_progress)
        spans = spans if slabs else by_width
    return Cut(spans, window, threads, slabs, brings_back=coming_back == "bring back")


def _spans(
    source: Source, recipe: Recipe, asked: Asked, *, drop_invalid: bool, with_history: bool
) -> SpanBy | Plan | None:
    if isinstance(asked.spans, str) or asked.is_auto:
        return planned(source, recipe, asked.max_memory, drop_invalid=drop_invalid, with_history=with_history)
    if asked.spans is None and source.stored and not source.can_be_stored:
        spans: SpanBy | None = default_spans(recipe, source.point_count, source.extent_x)
        return spans
    return asked.spans
