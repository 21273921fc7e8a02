"""Text clouds in many dialects, with changed bytes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from case import Case, Ended, Verdict, command
from mutation import mutated

_SUFFIXES = (".xyz", ".txt", ".csv", ".pts", ".asc")
_HEADS = (
    "",
    "x y z\n",
    "# x y z\n",
    "//X Y Z\n",
    "id x y z\n",
    "x,y,z\n",
    "\ufeffX;Y;Z\n",
    "300\n",
    "# made by hand\n",
)
_MARKS = (" ", ",", ";", "\t", "  ")
_ENDS = ("\n", "\r\n", "\r")
_TOKENS = ("nan", "1,5", "höhe", "1e400", "-", "0x1p3", "1_000", '"1"', "\0", "#", "1.0D+05", "")


class TextFiles:
    """Rows of three to five numbers, of which some tokens and bytes were changed."""

    cases = 1_000

    def prepare(self, folder: Path) -> None:
        """Nothing is shared."""

    def make(self, random: np.random.Generator, folder: Path, shared: Path) -> Case:
        """Write a changed file."""
        del shared
        mark, end, head = (str(random.choice(some)) for some in (_MARKS, _ENDS, _HEADS))
        rows = [[f"{value:.3f}" for value in row] for row in random.random((300, int(random.integers(3, 6)))) * 10]
        about = []
        for _ in range(int(random.integers(0, 3))):
            row, token = int(random.integers(300)), str(random.choice(_TOKENS))
            rows[row][int(random.integers(len(rows[row])))] = token
            about.append(f"{token!r} in row {row}")
        text = head.replace("\n", end) + end.join(mark.join(row) for row in rows) + end
        raw = text.encode(str(random.choice(("utf-8", "latin-1", "utf-16"), p=(0.8, 0.15, 0.05))), "replace")
        if random.random() < 0.5:
            raw, done = mutated(raw, random)
            about.append(done)
        name = f"hit{random.choice(_SUFFIXES)}"
        (folder / name).write_bytes(raw)
        words = ("segment", name, "out.txt", "--distance", 2.0) if random.random() < 0.7 else ("info", name)

        def judge(ended: Ended) -> tuple[str, str]:
            return {0: "read", 2: "refused or told"}.get(ended.status, f"status {ended.status}"), ""

        return Case(command(*words), judge, f"{name} {head!r} {mark!r} {end!r}: {about}", frozenset({"out.txt"}))

    def judge_all(self, verdicts: list[Verdict]) -> list[Verdict]:
        """Nothing more."""
        del verdicts
        return []


KIND = TextFiles()
