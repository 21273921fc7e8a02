"""Spans and windows that keep to a budget of memory, chosen from where the points of a cloud are."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from ._core import Plan, Recipe, _plan
from .errors import InvalidParameter, warn
from .preprocessing import Stage, prepare
from .source import Attributes, Source, as_stored, open_source

Stages = Stage | Sequence[Stage]

MaxMemory = int | str
"""A number of bytes, or a text with a unit such as "512MB"."""


_NORMAL = ("NormalX", "NormalY", "NormalZ")
_LIKE_A_NORMAL = re.compile(r"n(or|orm|ormals?)?[^a-z0-9]*[xyz]\W*|normals?\W*[012]?\W*", re.IGNORECASE)


def plan(
    source: Any,
    segmentor: Any,
    max_memory: MaxMemory | None = None,
    *,
    preprocess: Stages = (),
    attributes: Attributes | None = None,
    drop_invalid: bool = False,
    with_history: bool = False,
) -> Plan:
    """Choose spans and windows for a stored cloud so that segmenting it keeps to a budget of memory.

    The cloud is read once and its points are counted in slabs as narrow as the segmentor's reach allows. A span is a
    slab or several; a window as many spans as there is memory for, so windows are long where the cloud is thin and
    short where it is dense. The choice depends on the cloud, the segmentor and the budget, not on the machine. It may
    change raw ids, but not the partition.

    Parameters
    ----------
    source : path, sequence of paths, or (n, 3) array
        The cloud.
    segmentor, preprocess, attributes, drop_invalid
        As for `stream`.
    max_memory : int or str, default "512MB"
        The most memory that a run from file to file may take, in bytes or with a unit (MB, GB, MiB, GiB), the
        interpreter and its libraries included. Arrays of the caller come on top.
    with_history : bool, default False
        Whether the run will write a history, which takes memory too.

    Returns
    -------
    Plan
        Give it as ``spans`` to `stream`, `segment` or `segment_file`. ``explain(threads)`` says in words what was
        chosen and why, ``peak(threads)`` how many bytes are expected, ``warning`` whether the budget is too small.

    Raises
    ------
    InvalidParameter
        If the budget cannot be understood, or the source is live.
    InvalidInput, FileError
        If the points cannot be used or read.

    Examples
    --------
    >>> import numpy as np, streamseg as ss
    >>> line = np.column_stack([np.arange(1000.0), np.zeros(1000), np.zeros(1000)])
    >>> chosen = ss.plan(line, ss.Proximity(1.5), "256MB")
    >>> chosen.direction, chosen.windows
    ('x', 1)
    """
    opened = open_source(source, attributes)
    recipe = recipe_for(segmentor, preprocess, opened, drop_invalid)
    return planned(opened, recipe, max_memory, drop_invalid=drop_invalid, with_history=with_history)


def recipe_for(segmentor: Any, stages: Stages, source: Source, drop_invalid: bool) -> Recipe:
    """Prepare all that is done to a window; measures the cloud where a stage needs it."""
    ready = prepare(stages, source, drop_invalid=drop_invalid) if stages else []
    recipe = Recipe(segmentor, ready, list(source.attributes), source.has_more)
    _warn_of_normals(recipe, source)
    return recipe


def _warn_of_normals(recipe: Recipe, source: Source) -> None:
    """Warn if normals are computed although the cloud has something that looks like them."""
    computed = [name for name in recipe.computes if name in _NORMAL]
    alike = [name for name in source.attributes if _LIKE_A_NORMAL.fullmatch(name)]
    if computed and alike:
        warn(
            f"{', '.join(computed)} are computed, though the cloud has {', '.join(alike)}: its normals are used where "
            "it has all of NormalX, NormalY and NormalZ, or of nx, ny and nz"
        )


def planned(
    source: Source, recipe: Recipe, max_memory: MaxMemory | None, *, drop_invalid: bool, with_history: bool
) -> Plan:
    """Make the plan for an opened source."""
    source = as_stored(source)
    if not source.stored:
        raise InvalidParameter(
            "spans is 'auto' for a live source, allowed: for files, arrays and lists of arrays, whose points can be "
            "counted beforehand; give a live source spans by count, time or scan line"
        )
    return _plan(
        source.chunks(()),
        recipe,
        max_memory,
        lattice=source.lattice,
        with_history=with_history,
        drop_invalid=drop_invalid,
    )
