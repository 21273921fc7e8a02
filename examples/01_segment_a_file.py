"""From file to file: make a scene, segment it, draw it, look at the history with SQL."""

import tempfile
from pathlib import Path

import streamseg as ss

folder = Path(tempfile.mkdtemp(prefix="streamseg-"))
scene = ss.scenes.write(folder / "strip.laz", "airborne", 300_000, seed=3)

outcome = ss.segment_file(
    scene,
    folder / "labelled.laz",
    ss.Proximity(1.0),
    spans=ss.SpanByWidth(20.0),
    history=folder / "strip.history",
)
print(f"{outcome.points:,} points in {outcome.segments:,} segments, {outcome.windows} windows: {outcome.promise}")

picture = folder / "labelled.png"
ss.preview(folder / "labelled.laz", picture, shade="height")
print(f"to look at: {picture}")
