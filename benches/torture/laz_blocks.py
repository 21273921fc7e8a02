"""LAZ files of which 4 KB were overwritten: an erased flash page, a sector of zeros, noise."""

from __future__ import annotations

import struct
from pathlib import Path

import laspy
import lazrs
import numpy as np
from case import Case, Ended, Verdict, command
from clips import Clip, clips, opened, read, write_clips

_BLOCK = 4096
_MOST_FILES_WITH_WRONG_POINTS = 0.01


class LazBlocks:
    """4 KB of 0x00, 0xFF or noise at a random place behind the header."""

    cases = 1_000

    def prepare(self, folder: Path) -> None:
        """Write the clips."""
        write_clips(folder)

    def make(self, random: np.random.Generator, folder: Path, shared: Path) -> Case:
        """Overwrite a block of a clip."""
        paths = clips(shared, ".laz")
        clip = opened(paths[int(random.integers(len(paths)))])
        raw = bytearray(clip.path.read_bytes())
        (points_at,) = struct.unpack_from("<I", raw, 96)
        at = int(random.integers(points_at, len(raw)))
        size = min(_BLOCK, len(raw) - at)
        filling = ("0x00", "0xFF", "noise")[int(random.integers(3))]
        block = {"0x00": bytes(size), "0xFF": b"\xff" * size, "noise": random.bytes(size)}[filling]
        raw[at : at + size] = block
        (folder / "hit.laz").write_bytes(raw)
        sound = _points_before(clip.path, at)
        about = f"{clip.path.name}, {size} bytes of {filling} at {at} of {len(raw)}, {sound} points in chunks before"

        def judge(ended: Ended) -> tuple[str, str]:
            return _judge(clip, folder / "out.laz", sound, ended)

        words = ("segment", "hit.laz", "out.laz", "--distance", clip.distance, "--graph", "radius")
        return Case(command(*words), judge, about, frozenset({"out.laz"}))

    def judge_all(self, verdicts: list[Verdict]) -> list[Verdict]:
        """At most one file in 100 may hold wrong points, and never without status 2."""
        wrong = [verdict for verdict in verdicts if verdict.outcome.startswith("told, wrong points")]
        if len(wrong) <= _MOST_FILES_WITH_WRONG_POINTS * len(verdicts):
            return []
        return [one._replace(fault=f"wrong x, y or z written, told ({len(wrong)} files)") for one in wrong]


def _points_before(path: Path, at: int) -> int:
    """Count the points of the chunks that end before a byte."""
    header = laspy.open(path).header
    (record,) = header.vlrs.get("LasZipVlr")
    with path.open("rb") as file:
        file.seek(header.offset_to_point_data)
        table = lazrs.read_chunk_table(file, lazrs.LazVlr(record.record_data))
    ends = header.offset_to_point_data + 8 + np.cumsum([size for _, size in table])
    counts = np.cumsum([count for count, _ in table])
    sound = counts[ends <= at]
    return min(int(sound[-1]), header.point_count) if len(sound) else 0


def _judge(clip: Clip, out: Path, sound: int, ended: Ended) -> tuple[str, str]:
    told = ended.status == 2
    if not out.exists():
        if sound and told:
            return "nothing written", f"{sound:,} sound points were not written: {ended.err.strip()[-200:]}"
        return ("told, nothing before it", "") if told else ("nothing", f"status {ended.status}, and no output")
    las = read(out)
    steps = np.column_stack([las.X, las.Y, las.Z])
    wrong = int((steps != clip.steps[: len(steps)]).any(axis=1).sum()) if len(steps) <= len(clip.steps) else -1
    if not told and (wrong or len(steps) < len(clip.steps)):
        return "silent", f"status {ended.status}, {wrong} wrong of {len(steps)} points, {len(clip.steps)} were there"
    if len(steps) < sound:
        return "lost", f"{sound:,} sound points, {len(steps):,} written"
    if wrong:
        return "told, wrong points written", ""
    if not told:
        damaged = [name for name in las.point_format.dimension_names if name not in ("X", "Y", "Z", "SegmentID")]
        truth = read(clip.path)
        same = all(np.array_equal(np.asarray(las[name]), np.asarray(truth[name])) for name in damaged)
        spoken = " with a warning" if ended.err.strip() else ""
        return (
            f"status 0{spoken}, " + ("every dimension right" if same else "other dimensions wrong, x y z right")
        ), ""
    return "told, what was written is right", ""


KIND = LazBlocks()
