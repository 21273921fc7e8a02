"""What a run gets of the options that `segment`, `verify` and `info --plan` share."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from .._core import Recipe, SpanByCount, SpanByScanLine, SpanByTime, SpanByWidth, Window, default_spans
from ..cutting import Spans
from ..errors import InvalidParameter
from . import methods
from .wording import called

_AS_THEY_ARE = ("max_memory", "threads", "drop_invalid", "revisit")
_CUTS: Mapping[str, Callable[[Any], Spans]] = {
    "--span-width": SpanByWidth,
    "--span-count": SpanByCount,
    "--span-time": SpanByTime,
    "--span-lines": SpanByScanLine,
}
_OF_SPANS = (*_CUTS, "--direction", "--spans", "--overlap")


def chosen(options: Mapping[str, Any], planner: str | None = None) -> dict[str, Any]:
    """Make the keywords of `stream` from options, which are named as in Python.

    The planner is what was typed to have spans and windows chosen; without it, the options tell.
    """
    segmentor = methods.segmentor(options["method"], methods.given(options), options["settings"] or ())
    values = {option: options[option.removeprefix("--").replace("-", "_")] for option in _OF_SPANS}
    given = {option: value for option, value in values.items() if value is not None}
    if given.get("--span-width") == "auto":
        planner = planner or "--span-width auto"
        del given["--span-width"]
    if options["max_memory"] is not None:
        planner = planner or "--max-memory"
    if planner and given:
        raise InvalidParameter(f"{next(iter(given))} is given with {planner}, which chooses it; leave it out")
    return {
        "segmentor": segmentor,
        "preprocess": methods.stages(options["outliers"], options["lonely"], options["voxel"]),
        "spans": "auto" if planner else _spans(segmentor, given),
        "window": _window(given.get("--spans"), given.get("--overlap")),
        **{name: options[name] for name in _AS_THEY_ARE},
    }


@called(width="--span-width", points="--span-count", seconds="--span-time", lines="--span-lines")
def _spans(segmentor: Any, given: Mapping[str, Any]) -> Spans | None:
    cuts = [option for option in _CUTS if option in given]
    if len(cuts) > 1:
        raise InvalidParameter(f"{' and '.join(cuts)} are given, allowed: one of {', '.join(_CUTS)}")
    if not cuts and "--direction" not in given:
        return None
    if cuts and cuts != ["--span-width"]:
        if "--direction" in given:
            raise InvalidParameter(f"--direction is given with {cuts[0]}, allowed: with --span-width")
        return _CUTS[cuts[0]](given[cuts[0]])
    direction = given.get("--direction", "x")
    width = _width(given["--span-width"]) if cuts else _usual_width(segmentor, direction)
    return SpanByWidth(width, _azimuth(direction))


def _window(spans: int | None, overlap: int | None) -> Window | None:
    return None if spans is None and overlap is None else Window(spans, overlap)


def _width(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InvalidParameter(f"--span-width is '{text}', allowed: a number above 0, or auto") from None


def _usual_width(segmentor: Any, direction: str) -> float:
    usual = default_spans(Recipe(segmentor, [], [], True), None, None)
    if not isinstance(usual, SpanByWidth):
        raise InvalidParameter(f"--direction is {direction} without --span-width, allowed: with one for {segmentor!r}")
    return usual.width


def _azimuth(direction: str) -> str | float:
    try:
        return float(direction)
    except ValueError:
        return direction
