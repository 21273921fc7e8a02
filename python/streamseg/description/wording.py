"""How what is known of a cloud is said: a label and a sentence, line by line, and commands that can be pasted."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .._core import PlaneExtraction, Proximity, RegionGrowing
from .trial import SMALL

if TYPE_CHECKING:
    from ..io import Cloud
    from .proposal import Proposals
    from .shape import Shape
    from .survey import Survey
    from .trial import Trial

# ASPRS, LAS 1.4, table 17.
_CLASSES = {
    0: "never classified",
    1: "unclassified",
    2: "ground",
    3: "low vegetation",
    4: "medium vegetation",
    5: "high vegetation",
    6: "building",
    7: "low noise",
    8: "key point",
    9: "water",
    10: "rail",
    11: "road",
    12: "overlap",
    13: "wire guard",
    14: "wire",
    15: "tower",
    16: "wire connector",
    17: "bridge",
    18: "high noise",
}

# Layers on the map are told from this share of the points on.
_LAYERED = 0.05

_MOST_CLASSES_TOLD = 20


def of_facts(cloud: Cloud, facts: Survey) -> Iterator[tuple[str, str]]:
    """Say what one reading told."""
    yield "points", f"{facts.points:,}"
    if cloud.damage:
        yield "damage", cloud.damage
    if facts.caution:
        yield "caution", facts.caution
    if facts.invalid:
        yield (
            "invalid",
            f"{facts.invalid:,} of {facts.points:,} points have no finite coordinates; "
            "--drop-invalid gives them no segment",
        )
    if facts.name or facts.unit:
        yield "system", _system(facts)
    if not cloud.lattice.is_identity:
        scale, offset = cloud.lattice.scale, cloud.lattice.offset
        yield "lattice", "scale {:g} {:g} {:g}, offset {:g} {:g} {:g}".format(*scale, *offset)
    if columns := getattr(cloud.sources[0], "columns_said", None):
        yield "columns", columns
    if facts.has_extent:
        for axis, least, most, extent in zip("xyz", facts.low, facts.high, facts.extent, strict=True):
            yield axis, f"{_number(least)} to {_number(most)}, extent {_number(extent)}"
        yield "order", _order(facts)
    if facts.classes:
        yield "classes", _classes(facts.classes)
    if facts.of_many_returns is not None:
        share = _percent(facts.of_many_returns / facts.points)
        yield "returns", f"{share} of the points are of pulses with several returns"


def _system(facts: Survey) -> str:
    unit = facts.unit or "unknown"
    if facts.vertical_unit and facts.vertical_unit != facts.unit:
        unit += f", of heights {facts.vertical_unit}"
    return f"{facts.name or 'coordinate system without a name'}, unit {unit}"


def _order(facts: Survey) -> str:
    along = [axis for axis in "xy" if facts.steps_back.get(axis) == 0]
    words = f"sorted along {' and '.join(along)}" if along else "sorted along neither x nor y"
    if "gps_time" in facts.steps_back:
        words += f", {'in' if facts.steps_back['gps_time'] == 0 else 'not in'} the order of gps_time"
    return words


def _classes(classes: dict[int, int]) -> str:
    told = sorted(classes.items())[:_MOST_CLASSES_TOLD]
    words = "; ".join(f"{count:,} {_class_name(number)}" for number, count in told)
    more = len(classes) - len(told)
    return words + (f"; and {more} classes more" if more else "")


def _class_name(number: int) -> str:
    name = _CLASSES.get(number)
    return f"{name} ({number})" if name else f"class {number}"


def of_shape(shape: Shape, facts: Survey) -> Iterator[tuple[str, str]]:
    """Say what the sample looks like."""
    unit = _unit(facts)
    yield (
        "spacing",
        f"about {shape.spacing:.2g}{unit} in space, {shape.on_the_map:.2g}{unit} on the map "
        "(median distance to the fourth nearest point)",
    )
    if shape.layered >= _LAYERED:
        yield (
            "layers",
            f"{_percent(shape.layered)} of the points lie above or below others on the map",
        )
    if shape.noise is not None:
        yield (
            "surfaces",
            f"{_percent(shape.smooth)} of the points lie on even ground, walls or roofs, with noise of "
            f"about {shape.noise:.2g}{unit}",
        )
    if shape.flat is not None:
        axis = "xyz"[shape.flat]
        yield (
            "flat",
            f"one surface that faces {axis}" + (": upright, if z is up" if axis != "z" else ""),
        )
    elif shape.up is not None:
        yield "up", f"seems to be {'xyz'[shape.up]}, not z: floors and ceilings face it"


def of_proposals(path: Path, proposals: Proposals, *, is_whole: bool, drop_invalid: bool) -> Iterator[tuple[str, str]]:
    """Say what to try, the best first: a command, and what it does."""
    for number, trial in enumerate(proposals.trials):
        words = ["streamseg", "segment", _pasted(path), f"OUT{path.suffix}", *_options(trial)]
        if drop_invalid:
            words.append("--drop-invalid")
        yield ("or" if number else "try"), shlex.join(words)
        yield "", f"{_what(trial.segmentor)}; {_outcome(trial, is_whole=is_whole)}"
        if number == 0 and proposals.remark:
            yield "", proposals.remark


def _pasted(path: Path) -> str:
    return f"./{path}" if str(path).startswith("-") else str(path)


def _options(trial: Trial) -> list[str]:
    """Write the segmentor as the command line has it."""
    segmentor: Any = trial.segmentor
    if isinstance(segmentor, Proximity):
        words = ["--distance", f"{segmentor.distance:g}"]
        words += ["--graph", "radius"] if segmentor.graph == "radius" else []
        return words + _without_small(trial)
    if isinstance(segmentor, PlaneExtraction):
        return [
            *(
                "--method",
                "planes",
                "--k",
                f"{segmentor.k}",
                "--search-radius",
                f"{segmentor.search_radius:g}",
            ),
            *(
                "--max-distance",
                f"{segmentor.max_distance:g}",
                "--max-sigma",
                f"{segmentor.max_sigma:g}",
            ),
            *(
                "--angle",
                f"{segmentor.min_angle_deg:g}",
                "--seed-calculator",
                segmentor.seed_calculator,
            ),
            *("--min-size", f"{segmentor.min_segment_size}"),
        ]
    words = [
        "--method",
        "growing",
        "--k",
        f"{segmentor.k}",
        "--search-radius",
        f"{segmentor.search_radius:g}",
    ]
    return [*words, "--angle", f"{segmentor.angle_deg:g}", *_without_small(trial)]


def _without_small(trial: Trial) -> list[str]:
    return ["--min-size", f"{SMALL}"] if trial.labelled < 1 else []


def _what(segmentor: Any) -> str:
    if isinstance(segmentor, PlaneExtraction):
        return f"planes, with points less than {segmentor.max_distance:g} away"
    if isinstance(segmentor, RegionGrowing):
        return "smooth surfaces, which may bend"
    if segmentor.graph == "radius":
        return f"joins points nearer than {segmentor.distance:g} in space: objects that stand apart"
    return f"joins neighbors on the map nearer than {segmentor.distance:g} in space: what rises steeply comes apart"


def _outcome(trial: Trial, *, is_whole: bool) -> str:
    where = "" if is_whole else "in a sample, "
    return f"{where}{_percent(trial.labelled)} of the points are in segments, {_percent(trial.largest)} in the largest"


def reprojection(path: Path, facts: Survey) -> list[tuple[str, str]] | None:
    """Advise to project degrees first; None if the coordinates are lengths."""
    if not facts.in_degrees:
        return None
    advice = [
        (
            "degrees",
            "x and y are degrees, which are no lengths: project the cloud first, to UTM for example",
        )
    ]
    if path.suffix.lower() in (".las", ".laz") and (code := _utm(facts)) is not None:
        words = ["pdal", "translate", _pasted(path), f"OUT{path.suffix}", "reprojection"]
        if facts.name is None:
            words.append("--filters.reprojection.in_srs=EPSG:4326")
        advice.append(("project", shlex.join([*words, f"--filters.reprojection.out_srs=EPSG:{code}"])))
    return advice


def _utm(facts: Survey) -> int | None:
    """EPSG code of the UTM zone of the middle of the cloud, for WGS 84."""
    if not facts.has_extent:
        return None
    longitude, latitude = ((facts.low + facts.high) / 2)[:2]
    if not (-180 <= longitude < 180 and -80 <= latitude <= 84):
        return None
    return int((32600 if latitude >= 0 else 32700) + (longitude + 180) // 6 + 1)


def _unit(facts: Survey) -> str:
    return f" {facts.unit}" if facts.unit and facts.has_lengths_of_unit else ""


def _number(value: float) -> str:
    return f"{value:.3f}" if abs(value) < 1e15 else f"{value:g}"


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %" if share >= 0.01 or share == 0 else "under 1 %"
