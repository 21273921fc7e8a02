"""Which segmentations to propose: what does best on a sample comes first.

Formulas that turn the spacing into a distance are right for one kind of cloud. So distances and methods are tried, and
what comes of them decides.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from .._core import Proximity
from .trial import Trial, best_distance, growing, planes, rounded, tried

if TYPE_CHECKING:
    from .sample import Blocks
    from .shape import Shape

# A room or a facade: as much as this of the points lies in planes.
_IN_PLANES = 0.8

# Most neighborhoods of a cloud of surfaces are even.
_SMOOTH = 0.5

# Planes and surfaces leave rough points out; with as much as this in a segment they are worth a line.
_SOME, _MOST = 0.5, 0.7

# No segmentation is useful that leaves more than this of the points in one segment.
_ONE_PIECE = 0.9

# A distance at which a surface surely hangs together, in spacings, and in distances at which it falls apart.
_SURELY, _FARTHER = 2.5, 1.5


class Proposals(NamedTuple):
    """Trials, the best first.

    trials : at least one
    remark : what else there is to say of the first, if anything
    """

    trials: list[Trial]
    remark: str | None = None


def propose(blocks: Blocks, shape: Shape) -> Proposals:
    """Try what may fit, and keep what does."""
    in_planes, smooth = planes(blocks, shape), growing(blocks, shape)
    surfaces = [trial for trial in (in_planes, smooth) if trial is not None and _is_found(trial, shape)]
    in_space, on_map = (best_distance(blocks, shape, graph) for graph in ("radius", "delaunay"))
    near = sorted((in_space, on_map), key=lambda each: _cost(each[0], shape))
    useful = [trial for trial, is_stable in near if is_stable and trial.cost < 1]
    most = [trial for trial in surfaces if trial.labelled >= _MOST]
    if in_planes in most and in_planes.labelled >= _IN_PLANES:
        return _of(most, useful, surfaces)
    if useful or most:
        return _of(useful, most, surfaces)
    nearest = near[0][0]
    if nearest.cost < 1 and shape.smooth < _SMOOTH:
        return _of(
            [nearest],
            surfaces,
            remark="with a slightly greater distance nearly all of it is one segment",
        )
    surely = max(_SURELY * shape.spacing, _FARTHER * in_space[0].segmentor.distance)
    whole = tried(blocks, shape, Proximity(rounded(surely), graph="radius"))
    if whole.largest > _ONE_PIECE:
        return _of(
            [whole],
            surfaces,
            remark="the cloud is one piece at any distance at which it does not fall apart",
        )
    return _of([nearest], surfaces, remark="nothing that was tried does well; this comes nearest")


def _of(*ranked: list[Trial], remark: str | None = None) -> Proposals:
    """Put one after the other, each once."""
    trials: list[Trial] = []
    for trial in (trial for rank in ranked for trial in rank):
        if trial not in trials:
            trials.append(trial)
    return Proposals(trials, remark)


def _cost(trial: Trial, shape: Shape) -> float:
    """Rank distances: where points lie above each other on the map, its triangulation says little."""
    on_map = trial.segmentor.graph == "delaunay"
    return trial.cost * (1 + (shape.layered if on_map else 0.0))


def _is_found(trial: Trial, shape: Shape) -> bool:
    """Tell whether surfaces are worth a line: most neighborhoods are pieces of them, and not all of one."""
    return shape.smooth >= _SMOOTH and trial.labelled >= _SOME and trial.largest < _ONE_PIECE
