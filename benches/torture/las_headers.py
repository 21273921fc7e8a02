"""LAS and LAZ files with changed bytes in header and records."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
from case import Case, Ended, Verdict, command
from clips import Clip, clips, opened, read, write_clips

_LATTICE_AT, _SMALLEST_HEADER = 131, 227
_VALUES = (0, 1, 0x7F, 0x80, 0xFF)


class LasHeaders:
    """One to four bytes, or a whole field, before the points or in them where they are not compressed."""

    cases = 1_000

    def prepare(self, folder: Path) -> None:
        """Write the clips."""
        write_clips(folder, clips_per_cloud=2)

    def make(self, random: np.random.Generator, folder: Path, shared: Path) -> Case:
        """Change some bytes of a clip."""
        suffix = (".las", ".laz")[int(random.integers(2))]
        paths = clips(shared, suffix)
        clip = opened(paths[int(random.integers(len(paths)))])
        raw = bytearray(clip.path.read_bytes())
        (points_at,) = struct.unpack_from("<I", raw, 96)
        in_body = suffix == ".las" and random.random() < 0.2
        places = []
        for _ in range(int(random.integers(1, 5))):
            at = int(random.integers(points_at, len(raw)) if in_body else random.integers(0, points_at))
            how = int(random.integers(4))
            if how == 0:
                raw[at] ^= 1 << int(random.integers(8))
            elif how == 1:
                raw[at] = int(random.choice(_VALUES))
            elif how == 2:
                raw[at : at + 8] = random.bytes(min(8, len(raw) - at))
            else:
                size = min(8, len(raw) - at)
                raw[at : at + size] = struct.pack("<d", float(random.choice((np.nan, np.inf, 1e300, -1e9))))[:size]
            places.append(at)
        if random.random() < 0.1:
            del raw[int(random.integers(0, len(raw))) :]
            places.append(len(raw))
        hit = folder / f"hit{suffix}"
        hit.write_bytes(raw)

        def judge(ended: Ended) -> tuple[str, str]:
            return _judge(clip, hit, folder / "out.laz", ended)

        words = ("segment", hit.name, "out.laz", "--distance", clip.distance, "--graph", "radius")
        about = f"{clip.path.name}, changed at {places}"
        return Case(command(*words), judge, about, frozenset({"out.laz"}))

    def judge_all(self, verdicts: list[Verdict]) -> list[Verdict]:
        """Nothing more: what cannot be known is counted by its outcome."""
        del verdicts
        return []


def _judge(clip: Clip, hit: Path, out: Path, ended: Ended) -> tuple[str, str]:
    told = ended.status == 2
    if not out.exists():
        return ("refused", "") if told else ("nothing", f"status {ended.status}, and no output")
    spoken = bool(ended.err.strip())
    truth = read(clip.path)
    try:
        las = read(out)
    except UnicodeDecodeError:  # names are kept byte by byte
        return "a name is no UTF-8, which laspy cannot read: cannot be known", ""
    low, high = np.asarray(truth.header.mins), np.asarray(truth.header.maxs)
    given = np.asarray(las.xyz)
    if len(given) != len(truth.points):
        if not spoken:
            return "silent", f"{len(given):,} of {len(truth.points):,} points, and not a word"
        return "told, not all points written", ""
    with np.errstate(invalid="ignore"):
        same = np.isclose(given, truth.xyz, rtol=0, atol=1e-6).all()
        step = np.asarray(truth.header.scales)
        is_outside = ~((given >= low - step) & (given <= high + step)).all()
    if same:
        return "coordinates right" + (", a word" if spoken else ""), ""
    if spoken:
        return "told, coordinates changed", ""
    if is_outside and _lattice_and_box(clip.path) == _lattice_and_box(hit):
        return "silent", "coordinates outside the header's box, and not a word"
    return "coordinates changed inside the box or together with it: cannot be known", ""


def _lattice_and_box(path: Path) -> bytes:
    """Read scales, offsets and the box: where they are changed, nothing tells what lies outside."""
    with open(path, "rb") as file:
        file.seek(_LATTICE_AT)
        return file.read(_SMALLEST_HEADER - _LATTICE_AT)


KIND = LasHeaders()
