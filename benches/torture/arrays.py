"""Arrays of every type, shape, layout and value, in Python."""

from __future__ import annotations

import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from case import Case, Ended, Verdict

_TYPES = ("f2", "f4", "f8", ">f8", "i1", "i4", "u8", "?", "c16", "O", "S5", "U3", "M8[s]", "g")
_VALUES = (0.0, -0.0, 1e-300, 1e300, -1e17, np.inf, -np.inf, np.nan, 2.0**53 + 2, 0.1)


class Arrays:
    """Points that nobody would give, or that somebody gives every day."""

    cases = 1_000

    def prepare(self, folder: Path) -> None:
        """Nothing is shared."""

    def make(self, random: np.random.Generator, folder: Path, shared: Path) -> Case:
        """Make an array and a way to give it."""
        del folder, shared
        points, about = _points(random)
        way = int(random.integers(4))
        drop_invalid = bool(random.random() < 0.5)

        def task() -> None:
            import streamseg as ss

            warnings.simplefilter("ignore")
            segmentor = ss.Proximity(1.0, graph=str(random.choice(("radius", "delaunay"))))
            try:
                match way:
                    case 0:
                        labels = ss.segment(points, segmentor, drop_invalid=drop_invalid)
                    case 1:
                        labels = ss.segment(points, segmentor, spans=ss.SpanByWidth(4.0), drop_invalid=drop_invalid)
                    case 2:
                        labels = ss.segment_static(points, segmentor, drop_invalid=drop_invalid)
                    case _:
                        parts = [points[start : start + 50] for start in range(0, len(points), 50)]
                        labels = ss.segment(iter(parts), segmentor, drop_invalid=drop_invalid)
            except ss.StreamsegError as error:
                print(error, file=sys.stderr)
                sys.exit(2)
            if len(labels) != len(points):
                sys.exit(3)

        def judge(ended: Ended) -> tuple[str, str]:
            if ended.status == 3:
                return "points lost", "not one label a point"
            return {0: "labelled", 2: "refused"}.get(ended.status, f"status {ended.status}"), ""

        return Case(task, judge, f"way {way}, {about}")

    def judge_all(self, verdicts: list[Verdict]) -> list[Verdict]:
        """Nothing more."""
        del verdicts
        return []


def _points(random: np.random.Generator) -> tuple[Any, str]:
    shape = ((300, 3), (300, 3), (300, 3), (0, 3), (1, 3), (3,), (300, 2), (300, 4), (2, 150, 3))[random.integers(9)]
    values = random.random(shape) * 20
    for _ in range(int(random.integers(0, 4)) if values.size else 0):
        values.flat[int(random.integers(values.size))] = float(random.choice(_VALUES))
    kind = str(random.choice(_TYPES))
    try:
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            values = values.astype(kind)
    except (TypeError, ValueError):
        kind = "f8"
    match int(random.integers(4)):
        case 0:
            values = np.asfortranarray(values)
        case 1:
            values = values[::-1]
        case 2:
            values = np.ma.masked_array(values) if values.dtype.kind in "fiu" else values
    return values, f"{kind} {shape}"


KIND = Arrays()
