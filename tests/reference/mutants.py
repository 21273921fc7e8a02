"""Tries mutants of text or ``.npy`` files: ``mutants.py KIND NUMBER FOLDER``, seeded.

Ends with a trace at the first that is neither read nor told in one sentence, hangs, or takes too much memory.
Prints how many were read, were read up to some damage, and were refused.
"""

from __future__ import annotations

import faulthandler
import io
import random
import re
import resource
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from streamseg.errors import StreamsegError, StreamsegWarning
from streamseg.io import open_cloud, read_labels, write_labelled

_MOST_MEMORY = 400 << 20  # bytes beyond what the imports take
_LONGEST_SENTENCE = 800


class Counted:
    """Labels that are the ids of the points."""

    def read(self, start: int, stop: int) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        return np.arange(start, stop), np.ones(stop - start, np.bool_)


def saved(array: NDArray[Any]) -> bytes:
    file = io.BytesIO()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # names beyond Latin-1 need version 3
        np.save(file, array)
    return file.getvalue()


def arrays() -> list[bytes]:
    others = [("i", "u2"), ("t", "M8[s]"), ("v", "V3"), ("c", "f2", (2,))]
    of_python_2 = b"{'descr': '<f8', 'fortran_order': False, 'shape': (2L, 3L), }".ljust(64)
    return [
        saved(np.zeros(300, [("x", "f8"), ("y", "f4"), ("z", "i8"), *others])),
        saved(np.zeros(9, [("x", "f8"), ("y", "f8"), ("z", "f8"), ("höhe 高", "u1")])),
        saved(np.ones((300, 5), ">f4")),
        saved(np.asfortranarray(np.ones((300, 4), "i8"))),
        b"\x93NUMPY\x01\x00\x40\x00" + of_python_2 + bytes(48),
    ]


def texts() -> list[bytes]:
    rows = [f"{i / 8} {i * i} {-i}.5 {i % 7} {i}e2" for i in range(200)]
    contents = [
        "\n".join(rows),
        "# a comment\n# id x y z i\n" + "\n".join(rows) + "\n",
        "//X Y Z R G\n200\r\n" + "\r\n".join(rows),
        "100\n" + "\n".join(rows[:100]) + "\n100\n" + "\n".join(rows[100:]) + "\n",
        '\ufeffid,x,y,"z",höhe,\n' + "\n".join(row.replace(" ", ",") + "," for row in rows),
        "x;y;z;n;i\n" + "\n".join(row.replace(" ", ";") + " # c" for row in rows),
        "x\ty\tz\tname\ti\n" + "\r".join("\t".join((*row.split()[:3], '"a b"', "")) for row in rows),
    ]
    return [content.encode() for content in contents]


BASES = {"npy": arrays, "text": texts}
SUFFIXES = {"npy": [".npy"], "text": [".txt", ".csv", ".pts"]}
WORDS = [
    *(bytes([code]) for code in b"\0\r\n\"'#,;\t -()[{O<Lx\x1a\xff"),
    *(b"// nan 1e999 1_0 |O V0 True None 1000000000 \\ud800 \xef\xbb\xbf \xff\xfe \xc2\xa0".split(b" ")),
    *(b"#id x y z\n", b"\n7\n", b"9" * 40, b"9" * 5000, bytes(2_000_000)),
]


def mutated(bases: list[bytes], chance: random.Random) -> bytes:
    data = bytearray(chance.choice(bases))
    for _ in range(chance.choice((1, 1, 1, 2, 5))):
        # The beginning decides most.
        at = chance.randrange(min(len(data), chance.choice((20, 140, 10**9))) + 1)
        stop = at + chance.choice((1, 1, 2, 9, 300))
        word = chance.choice(WORDS)
        how = chance.choice(["flip", "remove", "repeat", "insert", "replace", "noise", "cut"])
        if how == "flip" and at < len(data):
            data[at] ^= 1 << chance.randrange(8)
        elif how == "remove":
            del data[at:stop]
        elif how == "repeat":
            data[at:at] = data[at:stop]
        elif how == "insert":
            data[at:at] = word
        elif how == "replace":
            data[at : at + len(word)] = word
        elif how == "noise":
            data[at:stop] = chance.randbytes(stop - at)
        elif how == "cut" and chance.random() < 0.3:
            del data[at:]
    return bytes(data)


def attempt(path: Path) -> str:
    """Read all there is, write it, and read it again: what happens?"""
    cloud = open_cloud(path)
    points = np.concatenate([chunk.points for chunk in cloud.chunks(77)])
    damage = cloud.damage
    for name in cloud.dimensions[:30]:
        try_attribute(cloud, name)
    if cloud.kind == "text":
        out = path.with_name("out.txt")
        assert write_labelled(cloud, out, Counted(), overwrite=True) == len(points)
        if damage is None:
            again, ids = (np.concatenate(parts) for parts in zip(*read_labels(out), strict=True))
            assert np.array_equal(again, points, equal_nan=True), (points, again)
            assert ids.tolist() == list(range(len(points)))
    return "read" if damage is None else "damaged"


def try_attribute(cloud: Any, name: str) -> None:
    """Columns may hold words, or have the name of another."""
    try:
        for chunk in cloud.chunks(1000, [name]):
            assert len(chunk.attributes[name]) == len(chunk.points)
    except StreamsegError as error:
        require_sentence(error)


def require_sentence(error: StreamsegError) -> None:
    if "\n" in str(error) or len(str(error)) > _LONGEST_SENTENCE:
        raise AssertionError("no sentence") from error


def outcome(path: Path, seed: int) -> str:
    # Whoever hangs is ended, with a trace of where.
    faulthandler.dump_traceback_later(60, exit=True)
    try:
        return attempt(path)
    except StreamsegError as error:
        require_sentence(error)
        return "refused"
    except BaseException:
        print(f"seed {seed}: {path.read_bytes()[:300]!r}", file=sys.stderr)
        raise
    finally:
        faulthandler.cancel_dump_traceback_later()


def limit_memory() -> None:
    used = re.search(r"VmSize:\s+(\d+) kB", Path("/proc/self/status").read_text())
    assert used is not None
    limit = int(used[1]) * 1024 + _MOST_MEMORY
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))


def main(kind: str, number: int, folder: Path) -> None:
    warnings.simplefilter("error")
    warnings.simplefilter("ignore", StreamsegWarning)
    limit_memory()
    bases = BASES[kind]()
    counts = {"read": 0, "damaged": 0, "refused": 0}
    for seed in range(number):
        path = folder / f"a{SUFFIXES[kind][seed % len(SUFFIXES[kind])]}"
        path.write_bytes(mutated(bases, random.Random(seed)))
        counts[outcome(path, seed)] += 1
    print(*counts.values())


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), Path(sys.argv[3]))
