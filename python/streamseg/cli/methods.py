"""Segmentors as the command line has them: one line each, and what users brought along."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

from .._core import (
    ConditionalClustering,
    Dbscan,
    PlaneExtraction,
    Proximity,
    RadiusOutlierRemoval,
    RegionGrowing,
    StatisticalOutlierRemoval,
    VoxelGrid,
)
from ..errors import InvalidParameter
from ..plugins import plugin, plugin_names
from .wording import called


class Method(NamedTuple):
    """A segmentor, and which of its parameters is which option of the command line."""

    make: Callable[..., Any]
    options: Mapping[str, str]
    needs: tuple[str, ...] = ()


METHODS = {
    "proximity": Method(
        Proximity, {"--distance": "distance", "--graph": "graph", "--metric": "metric"}, ("--distance",)
    ),
    "dbscan": Method(Dbscan, {"--eps": "eps", "--min-points": "min_points", "--metric": "metric"}, ("--eps",)),
    "conditional": Method(
        ConditionalClustering,
        {"--criterion": "criterion", "--search-radius": "search_radius", "--search-mode": "search_mode"},
    ),
    "planes": Method(
        PlaneExtraction,
        {
            "--search-radius": "search_radius",
            "--search-mode": "search_mode",
            "--k": "k",
            "--tile-size": "tile_size",
            "--max-distance": "max_distance",
            "--max-sigma": "max_sigma",
            "--angle": "min_angle_deg",
            "--seed-calculator": "seed_calculator",
        },
    ),
    "growing": Method(
        RegionGrowing,
        {
            "--k": "k",
            "--search-radius": "search_radius",
            "--angle": "angle_deg",
            "--curvature": "curvature",
            "--max-curvature": "max_curvature",
            "--residual": "residual",
            "--literal": "literal",
        },
    ),
}

# What every segmentor of ours takes.
OPTIONS = {
    "--min-size": "min_segment_size",
    "--max-size": "max_segment_size",
    "--filter": "filter",
    "--seed-filter": "seed_filter",
    "--sort": "sort",
    "--normals": "normals",
}

# Parameter → option.
PARAMETERS = {name: option for method in METHODS.values() for option, name in {**method.options, **OPTIONS}.items()}


def given(options: Mapping[str, Any]) -> dict[str, Any]:
    """Pick the parameters of segmentors out of all options, which are named as in Python: option → value."""
    names = dict.fromkeys(option for method in METHODS.values() for option in (*method.options, *OPTIONS))
    values = {option: options[option.removeprefix("--").replace("-", "_")] for option in names}
    return {**values, "--search-radius": lengths("--search-radius", values["--search-radius"])}


def segmentor(method: str, given: Mapping[str, Any], settings: Iterable[str]) -> Any:
    """Make the segmentor of a method from the options that were given (those that are None were not)."""
    given = {option: value for option, value in given.items() if value is not None}
    if method not in METHODS:
        return _plugged_in(method, given, settings)
    chosen = METHODS[method]
    parameters = {**chosen.options, **OPTIONS}
    for option in given:
        if option not in parameters:
            allowed = ", ".join(parameters)
            raise InvalidParameter(f"{option} is given with --method {method}, allowed there: {allowed}")
    for option in chosen.needs:
        if option not in given:
            raise InvalidParameter(f"--method {method} needs {option}; streamseg info FILE proposes one")
    if stray := next(iter(settings), None):
        raise InvalidParameter(f"--set {stray} is given with --method {method}, allowed: with methods of plug-ins")
    return chosen.make(**{parameters[option]: value for option, value in given.items()})


def _plugged_in(method: str, given: Mapping[str, Any], settings: Iterable[str]) -> Any:
    if method not in plugin_names():
        names = ", ".join([*METHODS, *plugin_names()])
        raise InvalidParameter(f"--method is '{method}', allowed: {names}")
    if given:
        raise InvalidParameter(f"{next(iter(given))} is given with --method {method}, allowed: --set NAME=VALUE")
    return plugin(method, **dict(map(_setting, settings)))


def _setting(text: str) -> tuple[str, Any]:
    name, equals, value = text.partition("=")
    if not equals or not name.isidentifier():
        raise InvalidParameter(f"--set is '{text}', allowed: NAME=VALUE, such as --set min_cluster_size=50")
    try:
        return name, ast.literal_eval(value)
    except (ValueError, SyntaxError):
        return name, value


def lengths(option: str, text: str | None) -> float | tuple[float, ...] | None:
    """Read one length, or several with commas between them."""
    if text is None:
        return None
    try:
        numbers = tuple(float(number) for number in text.split(","))
    except ValueError:
        raise InvalidParameter(
            f"{option} is '{text}', allowed: a number, or up to three with commas: 1,-0.5,2"
        ) from None
    return numbers[0] if len(numbers) == 1 else numbers


@called(
    **dict.fromkeys(("k", "multiplier", "dialect"), "--outliers"),
    **dict.fromkeys(("radius", "min_neighbors"), "--lonely"),
    size="--voxel",
)
def stages(outliers: str | None, lonely: str | None, voxel: float | None) -> list[Any]:
    """Make the steps before the segmentor, in the order in which they make sense."""
    made: list[Any] = []
    if outliers is not None:
        k, *rest = _parts("--outliers", outliers, "K or K,MULTIPLIER or K,MULTIPLIER,DIALECT", most=3)
        more: dict[str, Any] = {"multiplier": _number("--outliers", rest[0])} if rest else {}
        if rest[1:]:
            more["dialect"] = rest[1]
        made.append(StatisticalOutlierRemoval(_whole("--outliers", k), **more))
    if lonely is not None:
        radius, *rest = _parts("--lonely", lonely, "RADIUS or RADIUS,NEIGHBORS", most=2)
        neighbors = [_whole("--lonely", text) for text in rest]
        made.append(RadiusOutlierRemoval(_number("--lonely", radius), *neighbors))
    if voxel is not None:
        made.append(VoxelGrid(voxel))
    return made


def _parts(option: str, text: str, allowed: str, most: int) -> list[str]:
    parts = text.split(",")
    if len(parts) > most:
        raise InvalidParameter(f"{option} is '{text}', allowed: {allowed}")
    return parts


def _number(option: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InvalidParameter(f"{option} has '{text}' where a number is needed") from None


def _whole(option: str, text: str) -> int:
    try:
        return int(text)
    except ValueError:
        raise InvalidParameter(f"{option} has '{text}' where a whole number is needed") from None
