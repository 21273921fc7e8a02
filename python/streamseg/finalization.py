"""Decisions that wait until their region is final: what a stored cloud needs before it is read in stream order."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ._core import Recipe, SlabCounts, SpanByWidth, default_spans
from .preprocessing import spans_for
from .source import Source


def slabs_for(
    source: Source,
    recipe: Recipe,
    *,
    drop_invalid: bool = False,
    on_progress: Callable[[tuple[Any, ...]], None] | None = None,
) -> tuple[SpanByWidth, SlabCounts | None]:
    """Choose the slabs in which the points of a stored cloud wait, and count them.

    The cloud is read once for it, without its attributes, and twice where nothing but its extent tells how wide slabs
    should be.

    Parameters
    ----------
    source : Source
        A stored cloud.
    recipe : Recipe
        What will be done in each window.
    drop_invalid : bool, default False
        Count points with NaN or infinite coordinates too, instead of refusing them.
    on_progress : function, optional
        Called at least once a chunk. An exception that it raises ends the counting.

    Returns
    -------
    spans : SpanByWidth
        As wide as the spans that the segmentor gets if none are given, along that direction out of ``"x"``, ``"y"``,
        270.0 and 180.0 (x and y backward) in which the fewest points wait.
    counts : SlabCounts or None
        How many points each slab will get. None where nothing can be final before all has come, because there is no
        limit to how far away what decides about a point can be; then spans are by width.

    Raises
    ------
    InvalidInput, FileError
        If the points cannot be used or read.

    Examples
    --------
    >>> import numpy as np, streamseg as ss
    >>> from streamseg._core import Recipe
    >>> from streamseg.source import open_source
    >>> line = np.column_stack([np.zeros(100), np.arange(100.0), np.zeros(100)])
    >>> slabs_for(open_source(line[::-1]), Recipe(ss.Dbscan(0.5), [], [], False))[0]
    SpanByWidth(10.0, direction=180.0)
    """
    spans = default_spans(recipe, source.point_count, source.extent_x)
    if not isinstance(spans, SpanByWidth):
        spans, _ = spans_for(source, 0.0)
    if not recipe.is_bounded:
        return spans, None
    counts = SlabCounts(
        source.chunks(()),
        spans.width,
        lattice=source.lattice,
        drop_invalid=drop_invalid,
        on_progress=on_progress,
    )
    return counts.spans, counts
