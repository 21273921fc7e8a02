"""NumPy files with changed bytes, mostly in their headers."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from case import Case, Ended, Verdict, command
from mutation import mutated

_FIELDS = [("x", "<f8"), ("y", "<f8"), ("z", "<f4"), ("i", "<u2")]
_HEADER_BYTES = 128


class NpyFiles:
    """Plain and structured arrays, in C and Fortran order, whose header or body was changed."""

    cases = 1_000

    def prepare(self, folder: Path) -> None:
        """Nothing is shared."""

    def make(self, random: np.random.Generator, folder: Path, shared: Path) -> Case:
        """Write a changed file."""
        del shared
        array = _array(random)
        stream = io.BytesIO()
        np.save(stream, array)
        raw = stream.getvalue()
        if random.random() < 0.8:
            head, about = mutated(raw[:_HEADER_BYTES], random)
            raw = head + raw[_HEADER_BYTES:]
        else:
            raw, about = mutated(raw, random)
        (folder / "hit.npy").write_bytes(raw)
        name = ("segment", "info")[int(random.integers(2))]
        words = ("segment", "hit.npy", "out.npy", "--distance", 2.0) if name == "segment" else ("info", "hit.npy")

        def judge(ended: Ended) -> tuple[str, str]:
            return {0: "read", 2: "refused or told"}.get(ended.status, f"status {ended.status}"), ""

        return Case(command(*words), judge, f"{array.dtype} {array.shape}: {about}", frozenset({"out.npy"}))

    def judge_all(self, verdicts: list[Verdict]) -> list[Verdict]:
        """Nothing more."""
        del verdicts
        return []


def _array(random: np.random.Generator) -> np.ndarray:
    values = random.random((300, 4)) * 10
    match int(random.integers(4)):
        case 0:
            return values
        case 1:
            return np.asfortranarray(values.astype(">f4"))
        case 2:
            return (values * 100).astype(np.int32)[:, :3]
        case _:
            table = np.zeros(300, _FIELDS)
            for column, (name, _) in enumerate(_FIELDS):
                table[name] = values[:, column]
            return table


KIND = NpyFiles()
