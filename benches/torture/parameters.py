"""Options with values at and beyond every border, on the command line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from case import Case, Ended, Verdict, command

_NUMBERS = (
    "0",
    "-1",
    "1",
    "2",
    "0.5",
    "1e-300",
    "1e300",
    "nan",
    "inf",
    "-inf",
    "1e400",
    "999999999999",
    "",
    "x",
    "1,2",
    "1,-1,1",
    "0x10",
    "1_0",
    " 3",
    "²",
    "auto",
)
_EXPRESSIONS = (
    "Z < 1",
    "valid(Z)",
    "Z <",
    "Z ==== 1",
    "((((Z))))" * 50,
    "nosuch > 1",
    "n[0].Z > Z",
    "1/0 > Z",
    "Z < Z ? 1 : 0",
    "Normalx > 0.5",
    "",
    "abs(Z-n[0].Z)<0.15",
    "Z < 1e999",
    "NOT Z",
    '"Z"',
    "é > 1",
)
_OPTIONS = {
    "proximity": ("--distance", "--graph", "--metric"),
    "dbscan": ("--eps", "--min-points", "--metric"),
    "conditional": ("--criterion", "--search-radius", "--search-mode"),
    "planes": (
        "--search-radius",
        "--search-mode",
        "--k",
        "--max-distance",
        "--max-sigma",
        "--angle",
        "--tile-size",
        "--seed-calculator",
    ),
    "growing": ("--k", "--search-radius", "--angle", "--curvature", "--max-curvature", "--residual"),
}
_EVERY = (
    "--min-size",
    "--max-size",
    "--filter",
    "--seed-filter",
    "--sort",
    "--normals",
    "--outliers",
    "--lonely",
    "--voxel",
    "--span-width",
    "--direction",
    "--span-count",
    "--span-time",
    "--span-lines",
    "--max-memory",
    "--spans",
    "--overlap",
    "--result",
    "--threads",
)
_FLAGS = ("--revisit", "--drop-invalid", "--overwrite", "--quiet", "--literal")
_WORDS = {
    "--graph": ("radius", "delaunay", "knn"),
    "--metric": ("xyz", "xy", "zz"),
    "--search-mode": ("3d", "2.5d", "2d", "4d"),
    "--curvature": ("surface_variation", "principal", "no"),
    "--sort": ("native", "ascending", "descending", "up"),
    "--normals": ("robust", "least_squares", "best"),
    "--direction": ("x", "y", "30", "nan", "north"),
    "--max-memory": ("256MB", "1B", "1e99GB", "-5MB", "MB", "1.5 GiB"),
    "--result": ("final", "carry", "history", "none"),
}
_USUAL = {"--distance": "1", "--eps": "1", "--search-radius": "1.5", "--k": "8", "--criterion": "abs(Z-n[0].Z)<0.15"}
_FOR_EXPRESSIONS = ("--criterion", "--filter", "--seed-filter", "--seed-calculator")


class Parameters:
    """A method, its options and those of every method, with usual and unusual values."""

    cases = 1_000

    def prepare(self, folder: Path) -> None:
        """Write the cloud that all cases segment."""
        random = np.random.default_rng(2)
        np.save(folder / "cloud.npy", random.random((2_000, 3)) * (30, 10, 2))

    def make(self, random: np.random.Generator, folder: Path, shared: Path) -> Case:
        """Choose options."""
        del folder
        method = str(random.choice(list(_OPTIONS)))
        chosen = {"--method": method}
        for option in _OPTIONS[method]:
            if option in _USUAL and random.random() < 0.7:
                chosen[option] = _USUAL[option]
            elif random.random() < 0.4:
                chosen[option] = _value(random, option)
        for option in random.choice(_EVERY, int(random.integers(0, 4)), replace=False):
            chosen[str(option)] = _value(random, str(option))
        flags = [flag for flag in _FLAGS if random.random() < 0.1]
        words = [
            "segment",
            shared / "cloud.npy",
            "out.npy",
            *(f"{name}={value}" for name, value in chosen.items()),
            *flags,
        ]

        def judge(ended: Ended) -> tuple[str, str]:
            return {0: "done", 2: "refused"}.get(ended.status, f"status {ended.status}"), ""

        return Case(command(*words), judge, " ".join(map(str, words[3:])), frozenset({"out.npy"}))

    def judge_all(self, verdicts: list[Verdict]) -> list[Verdict]:
        """Nothing more."""
        del verdicts
        return []


def _value(random: np.random.Generator, option: str) -> str:
    if option in _FOR_EXPRESSIONS:
        return str(random.choice(_EXPRESSIONS))
    if option in _WORDS and random.random() < 0.8:
        return str(random.choice(_WORDS[option]))
    return str(random.choice(_NUMBERS))


KIND = Parameters()
