"""What a run came to, for people: every point is accounted for, and where most have no segment a remedy is named."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from .._core import RadiusOutlierRemoval, StatisticalOutlierRemoval
from ..files import Outcome, Resolved
from ..stream import LeftOut
from ..unlabelled import Unlabelled
from .methods import PARAMETERS

_POINTS = ("point", "points")
_SEGMENTS = ("segment", "segments")
_NOUNS = {
    "final": _SEGMENTS,
    "carry": ("segment as far as was known", "segments as far as was known"),
    "history": ("raw segment id", "raw segment ids"),
}
_LIMITS = ("min_segment_size", "max_segment_size")

# What removes points beforehand, by its option.
_REMOVALS = {StatisticalOutlierRemoval: "--outliers", RadiusOutlierRemoval: "--lonely"}

# Cause → how to turn which parameters so that fewer points have it.
_TURNS: Mapping[str, tuple[tuple[str, tuple[str, ...]], ...]] = {
    "filtered": (("another", ("filter",)),),
    "no_seed": (("another", ("seed_filter",)),),
    "noise": (("a larger", ("eps",)), ("a smaller", ("min_points",))),
    "in_no_plane": (
        ("a larger", ("search_radius", "max_distance", "max_sigma", "min_angle_deg")),
        ("another", ("k", "seed_calculator")),
    ),
    "in_no_region": (("a larger", ("max_curvature", "angle_deg")), ("another", ("search_radius", "k"))),
    "undecided": (("a smaller", ("search_radius", "k")),),
    "too_small": (
        ("a smaller", ("min_segment_size",)),
        ("a larger", ("distance", "eps", "search_radius", "max_distance", "angle_deg")),
    ),
    "too_large": (("a larger", ("max_segment_size",)), ("a smaller", ("distance", "eps", "search_radius"))),
}
_OTHER_TURNS = {"undecided": "wider spans (--span-width)", "by_segmentor": "other parameters of the method (--set)"}


def of_run(
    outcome: Outcome, asked: Mapping[str, Any], output: Path, history: Path | None, result: str
) -> Iterator[str]:
    """Tell of a run that was `asked` so: what was written, who has no segment and why, what could be proven."""
    unlabelled = outcome.unlabelled
    labelled = in_segments(outcome.points, unlabelled.total, outcome.segments, _NOUNS[result])
    yield f"{output}: {labelled}, {_counted(outcome.windows, ('window', 'windows'))}; {outcome.promise}"
    segmentor, removals = asked["segmentor"], _removals(asked["preprocess"])
    words = _words(segmentor, removals, outcome.left_out_by_cause)
    if not outcome.segments:
        yield f"no segment: {_why_none(outcome.points, unlabelled, segmentor, words)}"
    elif unlabelled.total:
        yield f"{_without(unlabelled.total, outcome.points)}: {_all_or_each(unlabelled, words)}"
    if 2 * unlabelled.total > outcome.points:
        causes = list(unlabelled.causes)[: 1 if outcome.segments else 2]
        if remedies := [remedy for cause in causes if (remedy := _remedy(cause, segmentor, removals))]:
            yield f"more points would be in one with {'; or with '.join(remedies)}"
    if outcome.certificate != (0,) * len(outcome.certificate):
        proven = "; equal to the static result, proven" if outcome.is_proven else ""
        yield f"certificate: {outcome.certificate}{proven}"
    if outcome.aliases:
        where = f"they are in {history / 'alias'}" if history else "--history keeps them, --result final applies them"
        yield f"{outcome.aliases:,} ids have become another's after they were written; {where}"
    if history is not None:
        yield f"history in {history}"


def of_resolution(outcome: Resolved, parameters: Mapping[str, Any], output: Path) -> Iterator[str]:
    """Tell what a history came to that was made with these parameters."""
    labelled = in_segments(outcome.points, outcome.without, outcome.segments)
    yield f"{output}: {labelled}, with final segment ids"
    if outcome.without:
        words = _of_sizes(outcome.left_out_by_cause, *(parameters.get(name) for name in _LIMITS))
        untold = outcome.without - outcome.unlabelled.total
        told = [outcome.unlabelled.told(words)] if outcome.unlabelled.total else []
        told += [f"{untold:,} in no segment of any window"] if untold else []
        yield f"{_without(outcome.without, outcome.points)}: {', '.join(told)}"


def in_segments(points: int, without: int, segments: int, nouns: tuple[str, str] = _SEGMENTS) -> str:
    """Tell how many of some points are in how many segments."""
    of_all = f"{points - without:,} of " if without else ""
    return f"{of_all}{_counted(points, _POINTS)} in {_counted(segments, nouns)}"


def _counted(count: int, nouns: tuple[str, str]) -> str:
    return f"{count:,} {nouns[count != 1]}"


def _without(without: int, points: int) -> str:
    share = round(100 * without / points)
    percent = "all" if without == points else f"{min(share, 99)} %" if share else "less than 1 %"
    return f"{_counted(without, ('point has', 'points have'))} no segment ({percent})"


def _all_or_each(unlabelled: Unlabelled, words: Mapping[str, str]) -> str:
    """Tell the causes; of a single one no number, which is known already."""
    told = unlabelled.told(words)
    return told if len(unlabelled.causes) > 1 else f"all {told.partition(' ')[2]}"


def _removals(stages: Sequence[Any]) -> list[str]:
    """Name the options that remove points."""
    return [option for kind, option in _REMOVALS.items() if any(isinstance(stage, kind) for stage in stages)]


def _words(segmentor: Any, removals: list[str], left_out: Mapping[str, LeftOut]) -> dict[str, str]:
    """Say of causes what is known of this run."""
    return {
        "removed": f"removed by {' and '.join(removals)}",
        "filtered": "left out by --filter",
        "in_no_region": "in no region (too rough, or without a normal)",
        "by_segmentor": "given none by the method",
        **_of_sizes(left_out, *(getattr(segmentor, name, None) for name in _LIMITS)),
    }


def _of_sizes(left_out: Mapping[str, LeftOut], smallest: int | None, largest: int | None) -> dict[str, str]:
    limits = {"too_small": ("smaller", smallest), "too_large": ("larger", largest)}
    return {
        cause: f"in {_counted(left_out[cause].segments, _SEGMENTS)} {than} than {_counted(limit, _POINTS)}"
        for cause, (than, limit) in limits.items()
        if cause in left_out and limit is not None
    }


def _why_none(points: int, unlabelled: Unlabelled, segmentor: Any, words: Mapping[str, str]) -> str:
    """Say what became of all points: who is left after each step, and why those have no segment."""
    if not points:
        return "the input has no points"
    if getattr(segmentor, "k", None) == 1:
        return "with --k 1 a point has no neighbor but itself"
    steps, left = [], points
    for cause, step in (
        ("invalid", "leaving out what is not finite"),
        ("removed", words["removed"].removeprefix("removed by ")),
        ("filtered", f'--filter "{getattr(segmentor, "filter", None)}"'),
    ):
        if gone := getattr(unlabelled, cause):
            leaves = "leave" if " and " in step else "leaves"
            steps.append(
                f"{step} {leaves} {f'{left - gone:,}' if left > gone else 'none'} of {_counted(left, _POINTS)}"
            )
            left -= gone
    others = unlabelled._replace(invalid=0, removed=0, filtered=0)
    if len(others.causes) == 1:
        everyone = "all of these are" if steps else f"all {points:,} points are" if points > 1 else "the only point is"
        steps.append(f"{'and ' if steps else ''}{everyone} {others.told(words).partition(' ')[2]}")
    elif others.total:
        steps.append(f"{'and of these' if steps else f'of {points:,} points'} {others.told(words)}")
    return ", ".join(steps)


def _remedy(cause: str, segmentor: Any, removals: list[str]) -> str | None:
    """Name the options that change how many points have this cause, with their values; None if there are none."""
    if cause == "removed":
        return f"a milder {' or '.join(removals)}"
    turns = []
    for how, parameters in _TURNS.get(cause, ()):
        options = [_option(name, value) for name in parameters if (value := getattr(segmentor, name, None)) is not None]
        turns += [f"{how} {_listed(options)}"] if options else []
    turns += [_OTHER_TURNS[cause]] if cause in _OTHER_TURNS else []
    return ", or ".join(turns) or None


def _option(parameter: str, value: Any) -> str:
    """Name an option, with its value if that is a number."""
    option = PARAMETERS[parameter]
    return f"{option} ({value:,.10g})" if isinstance(value, (int, float)) else option


def _listed(words: list[str]) -> str:
    return " or ".join(filter(None, (", ".join(words[:-1]), words[-1])))
