"""What starts a run: a stream of spans, and whole clouds at once."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ._core import Pipeline, Recipe, SpanByCount, SpanByScanLine, Window
from .callbacks import callback
from .cutting import Asked, Cut, Spans, cut
from .errors import InvalidParameter, warn
from .history import HistoryWriter, check_free
from .plan import MaxMemory, Stages, recipe_for
from .source import Attributes, PathLike, Source, laid_out, needed_by, open_source, with_lines
from .stream import RESULTS, Ids, Progress, Result, Stream
from .threads import checked_threads

# What every segmentor may say of the segments that final results keep.
SIZE_OPTIONS = ("min_segment_size", "max_segment_size", "sort")


def stream(
    source: Any,
    segmentor: Any,
    *,
    spans: Spans | None = None,
    window: Window | None = None,
    max_memory: MaxMemory | None = None,
    history: PathLike | None = None,
    result: Result = "carry",
    threads: int | None = None,
    drop_invalid: bool = False,
    overwrite: bool = False,
    attributes: Attributes | None = None,
    preprocess: Stages = (),
    revisit: bool = False,
    on_progress: Callable[[Progress], None] | None = None,
    with_points: bool = True,
) -> Stream:
    """Segment a cloud as a stream: an iterator over spans as they go out of scope, in order.

    Parameters
    ----------
    source : path, sequence of paths, (n, 3) array, or iterable of (n, 3) arrays
        Where the points come from. Several files are one stream; a file that changes while it is read is refused. An
        array has to stay as it is. An iterable is a live source: it is asked for an array only when one is needed. An
        item may also be a pair ``(points, {"gps_time": …})``.
    segmentor : Segmentor, object with ``fit_predict(X)``, or function of the window
        Labels the points of a window; a function gets a `WindowPoints` and returns (n,) whole numbers, -1 = none. In an
        unsigned type all numbers are labels but the one that -1 becomes there, which is refused.
        If it has them, its attributes ``min_segment_size`` and ``max_segment_size`` (in points) and ``sort`` ("native",
        "ascending" or "descending", by size) say which segments final ids keep and how they are numbered.
    spans : SpanByWidth, SpanByCount, SpanByTime, SpanByScanLine, Plan or "auto", optional
        How the cloud is cut. Default: a live source as given, one span per array; else spans as wide as 20 times the
        segmentor's reach, or of 100 000 points if it has none. "auto" reads a stored cloud once more beforehand and
        chooses spans and windows that keep to `max_memory` wherever the cloud is dense or thin (see `plan`).
    window : Window, default Window(3, 1)
        How many spans are segmented together, and how many of them two windows share. Not with a plan, which says it.
    max_memory : int or str, default "512MB" with spans="auto"
        The most memory that a run from file to file may take, in bytes or such as "256MB" or "1.5 GiB"; means
        ``spans="auto"``.
    history : path, optional
        Folder for the history, which keeps the whole story (needs ``pip install streamseg[history]``).
    result : {"carry", "history", "final"}, default "carry"
        Ids carried over on the fly, with aliases; raw ids; or final ones, which come only when the source has ended.
        Sizes are known then, so only final ids leave out what is too small or too large.
    threads : int, optional
        Windows segmented side by side; each thread beyond the first reads one window ahead. Default: all cores, and 1
        for a live source, so that labels come out as early as they can. Segmentors in Python are called one at a time.
    drop_invalid : bool, default False
        Give points with NaN or infinite coordinates no segment instead of refusing them.
    overwrite : bool, default False
        Replace a history that is already there.
    attributes : mapping of (n,) arrays, or sequence of names, optional
        For an array: its attributes, such as ``{"gps_time": …}``. For a live source the names of those that its items
        bring along and that are to be used instead of computing them. Case, underscores and blanks of names do not
        matter, and the exact spelling wins.
    preprocess : StatisticalOutlierRemoval, RadiusOutlierRemoval or VoxelGrid, or several of them, optional
        What is done before segmenting, in order. Removed points come out as -1; a voxel's points get its label.
        Statistics of the whole cloud take a pass of their own over it before the run.
    revisit : bool, default False
        For streams that come back to where they have been, so that the same object is found once. Where more points can
        only join more, points that have gone out of scope are kept in a store on disk, and those within reach of a new
        window are looked at again with it. Otherwise decisions about a stored cloud wait until their surroundings have
        come: points are counted in a pass of their own, wait on disk where they are many, and come out slab by slab.
        Has no effect where spans by width hold all that they need anyway. Needs a segmentor with a distance or search
        radius.
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
        If the spans break the condition under which streamed equals static, a file is damaged, or not even the smallest
        windows keep to `max_memory`.

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
    asked = Asked(spans, window, max_memory, revisit)
    asked.check()
    threads = checked_threads(threads)
    _check_result(result, segmentor)
    if history is not None:
        check_free(Path(history), overwrite)
    opened = laid_out(open_source(source, attributes), spans, read_twice=asked.reads_first)
    recipe = recipe_for(segmentor, preprocess, opened, drop_invalid)
    chosen = cut(
        opened,
        recipe,
        asked,
        threads=threads,
        drop_invalid=drop_invalid,
        with_history=history is not None,
        on_progress=_named(on_progress),
    )
    core = _pipeline(opened, segmentor, recipe, chosen, drop_invalid, on_progress)
    if core.warning:
        warn(core.warning)
    writer = None
    if history is not None:
        parameters = {
            "segmentor": repr(segmentor),
            **_told(chosen, asked),
            **({"preprocess": repr(preprocess)} if preprocess else {}),
            **{option: getattr(core, option) for option in SIZE_OPTIONS},
        }
        writer = HistoryWriter(
            Path(history),
            source=opened.name,
            parameters=parameters,
            promise=opened.with_caution(core.promise),
            overwrite=overwrite,
        )
    return Stream(opened, core, result, writer, with_points)


def _check_result(result: Any, segmentor: Any) -> None:
    """Refuse kinds of ids that there are not, or that cannot be sorted."""
    if result not in RESULTS:
        raise InvalidParameter(f"result is {result!r}, allowed: {', '.join(map(repr, RESULTS))}")
    sort = getattr(segmentor, "sort", "native")
    if result != "final" and sort in ("ascending", "descending"):
        raise InvalidParameter(
            f"sort is {sort!r} with result={result!r}, allowed: with result='final', "
            "because sizes are known only at the end"
        )


def _told(chosen: Cut, asked: Asked) -> dict[str, Any]:
    """Tell, for the history, how the cloud was cut."""
    told: dict[str, Any] = {"spans": repr(chosen.spans), "window": repr(chosen.window)}
    if asked.revisit:
        told["revisit"] = True
    if chosen.slabs is not None:
        told["slabs"] = repr(chosen.slabs.spans)
    return told


def _named(on_progress: Callable[[Progress], None] | None) -> Callable[[tuple[Any, ...]], None] | None:
    """Give the numbers of the core their names."""
    if on_progress is None:
        return None
    told = callback("on_progress", on_progress)
    return lambda progress: told(Progress(*progress))


def _pipeline(
    source: Source,
    segmentor: Any,
    recipe: Recipe,
    chosen: Cut,
    drop_invalid: bool,
    on_progress: Callable[[Progress], None] | None = None,
) -> Pipeline:
    chunks = source.chunks((*needed_by(chosen.spans), *recipe.reads))
    return Pipeline(
        with_lines(chunks) if isinstance(chosen.spans, SpanByScanLine) else chunks,
        recipe,
        chosen.spans,
        chosen.window,
        stored=source.stored,
        lattice=source.lattice,
        threads=chosen.threads,
        drop_invalid=drop_invalid,
        on_progress=_named(on_progress),
        counts=chosen.slabs,
        brings_back=chosen.brings_back,
        **{option: getattr(segmentor, option) for option in SIZE_OPTIONS if hasattr(segmentor, option)},
    )


def segment(
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
) -> Ids:
    """Segment a cloud as a stream and return the final segment id of every point.

    Parameters
    ----------
    source, segmentor, spans, window, max_memory, threads, drop_invalid, attributes, preprocess, revisit
        As for `stream`. A live source has to end.

    Returns
    -------
    (n,) int64
        Final segment ids in input order, from 1; -1 = none, or a segment that is left out by its size.

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
        max_memory=max_memory,
        threads=threads,
        drop_invalid=drop_invalid,
        attributes=attributes,
        preprocess=preprocess,
        revisit=revisit,
        result="final",
        with_points=False,
    ) as run:
        return in_input_order(run)


def segment_static(
    source: Any,
    segmentor: Any,
    *,
    drop_invalid: bool = False,
    attributes: Attributes | None = None,
    preprocess: Stages = (),
) -> Ids:
    """Segment the whole cloud as one window.

    Parameters
    ----------
    source, segmentor, drop_invalid, attributes, preprocess
        As for `stream`. The cloud has to fit in memory.

    Returns
    -------
    (n,) int64
        Segment ids in input order, from 1; -1 = none, or a segment that is left out by its size.

    Examples
    --------
    >>> import numpy as np, streamseg as ss
    >>> ss.segment_static(np.array([[0.0, 0, 0], [1, 0, 0], [9, 0, 0]]), ss.Proximity(2.0)).tolist()
    [1, 1, 2]
    """
    whole = Cut(SpanByCount(np.iinfo(np.int64).max), Window(1, 0), threads=1, slabs=None, brings_back=False)
    opened = open_source(source, attributes)
    recipe = recipe_for(segmentor, preprocess, opened, drop_invalid)
    core = _pipeline(opened, segmentor, recipe, whole, drop_invalid)
    return in_input_order(Stream(opened, core, "final", None, with_points=False))


def in_input_order(run: Stream) -> Ids:
    """Collect the final ids of a run. They wait on disk, so no memory is needed beside the result."""
    labels = np.empty(0, np.int64)
    for span in run:
        if not len(labels):
            labels = np.full(run.progress.points, -1, np.int64)
        labels[span.point_ids] = span.segment_ids
    return labels
