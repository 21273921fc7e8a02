"""What people are told: by the names that they typed, and of a plug-in's failure only what is the plug-in's."""

from __future__ import annotations

import re
import traceback

# Parameters whose options are called otherwise.
_OPTIONS = {
    "width": "--span-width",
    "points": "--span-count",
    "seconds": "--span-time",
    "lines": "--span-lines",
    "size": "--voxel",
    "radius": "--lonely",
    "min_neighbors": "--lonely",
    "multiplier": "--outliers",
    "dialect": "--outliers",
    "angle_deg": "--angle",
    "min_angle_deg": "--angle",
    "min_segment_size": "--min-size",
    "max_segment_size": "--max-size",
}
_SAME = (
    *("distance", "graph", "metric", "eps", "min_points", "search_radius", "search_mode", "max_distance", "max_sigma"),
    *("tile_size", "k", "curvature", "max_curvature", "residual", "normals", "sort", "direction", "spans", "overlap"),
    *("threads", "history"),
)
_ALL = {**{name: f"--{name.replace('_', '-')}" for name in _SAME}, **_OPTIONS}
_LONGEST_NUMBER = 40


def as_typed(message: str) -> str:
    """Name the option that was typed where a message begins with the name of a parameter."""
    name, *rest = re.split(r"(?= (?:is|and) )", message, maxsplit=1)
    if name in _ALL and rest:
        message = _ALL[name] + "".join(rest)
        message = re.sub(r"\b[a-z]+(?:_[a-z]+)+\b", lambda found: _ALL.get(found[0], found[0]), message)
    return re.sub(rf"\d{{{_LONGEST_NUMBER},}}", lambda found: f"{found[0][:10]}… ({len(found[0])} digits)", message)


def of_plugin(error: BaseException) -> str | None:
    """Tell what a segmentor in Python raised, in which window and where in its own code; None if it was not that."""
    raised_in = getattr(error, "_streamseg_raised_in", None)
    if raised_in is None:
        return None
    frames = traceback.extract_tb(error.__traceback__)
    called = [place for place, frame in enumerate(frames) if frame.name == "_next_woven"]
    own = traceback.format_list(frames[called[0] + 1 :] if called else frames)
    name, window = raised_in
    what = "".join(traceback.format_exception_only(type(error), error)).strip()
    return f"segmentor '{name}' raised in window {window}: {what}\n{''.join(own)}".rstrip()
