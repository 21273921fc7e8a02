"""Outliers removed and clouds thinned, span by span, and the pass that measures a cloud for it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from ._core import (
    RadiusOutlierRemoval,
    SpanByCount,
    SpanByScanLine,
    SpanByTime,
    SpanByWidth,
    StatisticalOutlierRemoval,
    ThinnedSpan,
    Thinning,
    VoxelGrid,
    _halo_of,
    _measure,
)
from .errors import InvalidParameter, warn
from .source import Attributes, Source, laid_out, needed_by, open_source
from .threads import checked_threads

Stage = StatisticalOutlierRemoval | RadiusOutlierRemoval | VoxelGrid
SpanBy = SpanByWidth | SpanByCount | SpanByTime | SpanByScanLine

# Of a cloud without stray points a window of three spans has about three times as many.
_POINTS_PER_SPAN = 200_000

# How many points of a chunk, and of all chunks, tell how far a cloud reaches.
_SAMPLE = 5_000
_LARGEST_SAMPLE = 100_000


def preprocess(
    source: Any,
    stages: Stage | Iterable[Stage],
    *,
    spans: SpanBy | None = None,
    threads: int = 1,
    drop_invalid: bool = False,
    attributes: Attributes | None = None,
) -> Iterator[ThinnedSpan]:
    """Remove outliers from a cloud, or thin it, as a stream: an iterator over what is left of each span.

    Each point that stays, and each voxel, comes out exactly once, in the span that its point id belongs to, as soon as
    all that decides about it has been loaded.

    Parameters
    ----------
    source : path, sequence of paths, (n, 3) array, or iterable of (n, 3) arrays
        Where the points come from. An iterable is a live source, unless it is a list and spans are by width.
    stages : StatisticalOutlierRemoval, RadiusOutlierRemoval or VoxelGrid, or several of them
        What is done, in order.
    spans : SpanByWidth, SpanByCount, SpanByTime or SpanByScanLine, optional
        How the cloud is cut. Default: by width, some 200 000 points each; a live source as given. Only by width the
        result is that of the whole cloud, whatever the width; otherwise each span is preprocessed by itself.
    threads : int, default 1
        Spans that are worked on side by side.
    drop_invalid : bool, default False
        Leave out points with NaN or infinite coordinates instead of refusing them.
    attributes : mapping of (n,) arrays, optional
        For an array: the attributes that the spans need, such as ``gps_time``.

    Yields
    ------
    ThinnedSpan
        With ``index``, ``points`` (m, 3) float64 in units of the coordinates, and ``point_ids`` (m,) int64, ascending.

    Warns
    -----
    StreamsegWarning
        If a file is damaged.

    Raises
    ------
    InvalidParameter
        If a stage is none of those, or a live source should give the statistics of the whole cloud beforehand.
    InvalidInput, FileError
        If the points cannot be used or read.

    Examples
    --------
    >>> import numpy as np, streamseg as ss
    >>> walk = np.column_stack([np.arange(10.0), np.zeros(10), np.zeros(10)])
    >>> [span.points[:, 0].tolist() for span in ss.preprocess(walk, ss.VoxelGrid(5.0), spans=ss.SpanByWidth(5.0))]
    [[2.0], [7.0]]
    """
    opened = laid_out(open_source(source, attributes), spans)
    at_a_time = checked_threads(threads) or 1
    ready = prepare(stages, opened, threads=at_a_time, drop_invalid=drop_invalid)
    if spans is None and opened.stored:
        spans, _ = spans_for(opened, 2 * _finite(_halo_of(ready)))
    core = Thinning(
        opened.chunks(needed_by(spans)),
        ready,
        spans,
        stored=opened.stored,
        lattice=opened.lattice,
        threads=at_a_time,
        drop_invalid=drop_invalid,
    )
    return _told_of_damage(core, opened)


def prepare(
    stages: Stage | Iterable[Stage], source: Any, *, threads: int = 1, drop_invalid: bool = False
) -> list[Stage]:
    """Measure a stored cloud for the stages that need statistics of all of it.

    Mean and standard deviation are exact, whatever the order of the points and the number of threads. The cloud is read
    two or three times for each stage that needs it: to find how wide spans should be, to measure, and once more if
    points have neighbors far away.

    Parameters
    ----------
    stages : StatisticalOutlierRemoval, RadiusOutlierRemoval or VoxelGrid, or several of them
        In the order in which they will be applied: a cloud is measured as the stages before have left it.
    source : path, sequence of paths, (n, 3) array
        The cloud.
    threads : int, default 1
        Spans that are worked on side by side.
    drop_invalid : bool, default False
        Leave out points with NaN or infinite coordinates instead of refusing them.

    Returns
    -------
    list of stages
        The same, with the statistics filled in.

    Raises
    ------
    InvalidParameter
        If something is no stage, or the source is live and a stage needs the statistics of the whole cloud.
    InvalidInput, FileError
        If the points cannot be used or read.

    Examples
    --------
    >>> import numpy as np, streamseg as ss
    >>> line = np.column_stack([np.arange(100.0), np.zeros(100), np.zeros(100)])
    >>> ss.prepare(ss.StatisticalOutlierRemoval(k=2), line)[0].statistics[:2]
    (100, 1.01)
    """
    ready: list[Stage] = []
    opened = open_source(source)
    for stage in listed(stages):
        if isinstance(stage, StatisticalOutlierRemoval) and stage.statistics == "global" and opened.stored:
            ready.append(_measured(stage, ready, opened, checked_threads(threads) or 1, drop_invalid))
        else:
            ready.append(stage)
    _halo_of(ready)  # refuses what is no stage, or cannot be one here
    return ready


def listed(stages: Stage | Iterable[Stage]) -> list[Stage]:
    """One stage or several, as a list."""
    if isinstance(stages, (StatisticalOutlierRemoval, RadiusOutlierRemoval, VoxelGrid)):
        return [stages]
    try:
        return list(stages)
    except TypeError:
        allowed = "StatisticalOutlierRemoval, RadiusOutlierRemoval and VoxelGrid"
        raise InvalidParameter(f"preprocess is {stages!r}, allowed: {allowed}, or a list of them") from None


def _measured(
    stage: StatisticalOutlierRemoval, earlier: list[Stage], source: Source, threads: int, drop_invalid: bool
) -> StatisticalOutlierRemoval:
    halo = _halo_of(earlier)
    if halo == np.inf:
        raise InvalidParameter(
            f"{stage!r} comes after a stage with running statistics, so the whole cloud cannot be measured beforehand; "
            "use the same statistics for both"
        )
    spans, width = spans_for(source, halo)
    statistics = _measure(
        lambda: source.chunks(()),
        stage,
        earlier,
        spans=spans,
        width=width,
        lattice=source.lattice,
        threads=threads,
        drop_invalid=drop_invalid,
    )
    return StatisticalOutlierRemoval(stage.k, stage.multiplier, stage.dialect, statistics)


def spans_for(source: Source, at_least: float) -> tuple[SpanByWidth, float]:
    """Spans for a stored cloud with some 200 000 points each, along its longer side, and their width."""
    count, size, thinning, sample = 0, 0, 1, [np.zeros((0, 2))]
    for points, _ in source.chunks(()):
        chunk = np.asarray(points).reshape(-1, 3)
        count += len(chunk)
        sample.append(chunk[:: max(1, len(chunk) // _SAMPLE) * thinning, :2].astype(np.float64))
        size += len(sample[-1])
        if size > _LARGEST_SAMPLE:
            step = -(-size // (_LARGEST_SAMPLE // 2))
            sample = [np.concatenate(sample)[::step]]
            size, thinning = len(sample[0]), thinning * step
    places = np.concatenate(sample)
    places = places[np.isfinite(places).all(axis=1)]
    # Stray points far away do not make the cloud longer.
    low, high = np.quantile(places, [0.05, 0.95], axis=0) if len(places) else np.zeros((2, 2))
    lengths = (high - low) / 0.9 * np.asarray(source.scale or (1.0, 1.0, 1.0))[:2]
    axis = int(np.argmax(lengths))
    share = min(1.0, _POINTS_PER_SPAN / max(1, count))
    width = max(float(lengths[axis]) * share, at_least) or 1.0
    return SpanByWidth(width, "xy"[axis]), width


def _finite(halo: float) -> float:
    return halo if np.isfinite(halo) else 0.0


def _told_of_damage(core: Thinning, source: Source) -> Iterator[ThinnedSpan]:
    yield from core
    if damage := source.damage():
        warn(damage)
