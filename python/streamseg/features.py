"""What the surface is like around each point of a cloud: normals, eigenvalue features, curvature."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ._core import FeatureSurvey, _features
from .errors import warn
from .preprocessing import SpanBy
from .source import Source, laid_out, needed_by, open_source


def features(
    source: Any,
    names: str | Sequence[str],
    *,
    k: int | None = None,
    search_radius: float | Sequence[float] | None = None,
    search_mode: Literal["2d", "2.5d", "3d"] = "3d",
    normals: Literal["least_squares", "robust"] = "least_squares",
    spans: SpanBy | None = None,
    threads: int = 1,
) -> dict[str, NDArray[np.float64]]:
    """Compute features of every point of a whole cloud from its neighbors.

    Parameters
    ----------
    source : path, sequence of paths, (n, 3) array, or iterable of (n, 3) arrays
        The cloud. Coordinates of LAS and LAZ files are computed with as the whole numbers that are stored.
    names : str or sequence of str
        Any of NormalX, NormalY, NormalZ, NormalSigma0, NormalEigenvalue1, NormalEigenvalue2, NormalEigenvalue3,
        Linearity, Planarity, Sphericity, Omnivariance, Anisotropy, Eigenentropy, SurfaceVariation, Verticality,
        NeighborCount, MeanCurvature, GaussianCurvature, MaxCurvature and MinCurvature, in upper or lower case.
        ``docs/features.md`` defines them.
    k : int, optional
        Take the k nearest points, the point itself included; at equal distance those that come first in the cloud.
    search_radius : float or sequence of floats, optional
        Take all points within it, in units of the coordinates; with `k`, the nearest of these. For "2.5d" also
        ``[radius, height]`` (up and down) or ``[radius, lowest, highest]`` (above the point).
    search_mode : {"3d", "2.5d", "2d"}, default "3d"
        A ball, a cylinder, or a disc on the map, which is a cylinder without end. With `k`: "3d" or "2d".
    normals : {"least_squares", "robust"}, default "least_squares"
        Whether planes are fitted to all neighbors alike, or to those that are left when blunders have been removed.
    spans : SpanByWidth, SpanByCount, SpanByTime or SpanByScanLine, optional
        Compute as a stream, so that only a few spans and the features themselves are in memory. By width the values are
        the same to the last bit. With `k` and no `search_radius` a neighbor may lie in a span that is not loaded: then
        the values of the point are NaN. Otherwise than by width, only neighbors in the same span are found.
    threads : int, default 1
        Spans that are worked on side by side.

    Returns
    -------
    dict of (n,) float64
        One array per name as it was given; NaN where a feature has no value, as with fewer than three neighbors.

    Warns
    -----
    StreamsegWarning
        If a file is damaged, or points have no value because their neighbors were not all loaded.

    Raises
    ------
    InvalidParameter
        If a name is unknown, neither `k` nor `search_radius` is given, or one of them is not above 0.
    InvalidInput
        If the points are not an (n, 3) array of finite numbers.
    FileError
        If a file cannot be read.

    Notes
    -----
    Planes: Pearson (1901). Eigenvalue features: Hackel, Wegner and Schindler (2016).

    Examples
    --------
    >>> import numpy as np, streamseg as ss
    >>> x, y = np.meshgrid(np.arange(5.0), np.arange(5.0))
    >>> roof = np.column_stack([x.ravel(), y.ravel(), x.ravel()])
    >>> found = ss.features(roof, ["NormalX", "NormalZ"], k=9)
    >>> [round(float(found[name][12]), 4) for name in found]
    [-0.7071, 0.7071]
    """
    asked = [names] if isinstance(names, str) else list(names)
    opened = laid_out(open_source(source), spans)
    search: dict[str, Any] = {"k": k, "search_radius": search_radius, "search_mode": search_mode, "normals": normals}
    if spans is None:
        columns = _features(opened.chunks(()), asked, **search, lattice=opened.lattice)
    else:
        columns = _streamed(opened, asked, spans, threads, search)
    if damage := opened.damage():
        warn(damage)
    return dict(zip(asked, columns, strict=True))


def _streamed(
    source: Source, names: list[str], spans: SpanBy, threads: int, search: dict[str, Any]
) -> list[NDArray[np.float64]]:
    survey = FeatureSurvey(
        source.chunks(needed_by(spans)),
        names,
        spans,
        stored=source.stored,
        lattice=source.lattice,
        threads=threads,
        **search,
    )
    found = list(survey)
    point_ids = np.concatenate([part.point_ids for part in found]) if found else np.empty(0, np.int64)
    columns = [np.full(len(point_ids), np.nan) for _ in names]
    for number, column in enumerate(columns):
        column[point_ids] = np.concatenate([part.columns[number] for part in found]) if found else []
    if undecided := sum(part.undecided for part in found):
        warn(
            f"{undecided:,} of {len(point_ids):,} points have no value, because their neighbors were not all loaded: "
            "use wider spans, or search_radius beside k"
        )
    return columns
