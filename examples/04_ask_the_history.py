"""The history keeps the whole story: ask it with SQL which windows joined what, and resolve it."""

import tempfile
from pathlib import Path

import duckdb
import numpy as np

import streamseg as ss

folder = Path(tempfile.mkdtemp(prefix="streamseg-")) / "run.history"
strip = ss.scenes.columns("airborne", 200_000, seed=4)
with ss.stream(strip["xyz"], ss.Proximity(1.0), spans=ss.SpanByWidth(10.0), history=folder) as stream:
    carried = np.concatenate([span.segment_ids for span in stream])

question = f"""
    SELECT next_segment_id, "window", count(*) AS joined, sum(shared_points) AS points
    FROM '{folder}/segment_segment/*.parquet'
    WHERE next_segment_id > 0 GROUP BY ALL HAVING joined > 1 ORDER BY joined DESC, points DESC LIMIT 5
"""
for segment, window, joined, points in duckdb.sql(question).fetchall():
    print(f"in window {window}, segment {segment} joined {joined} earlier ones over {points:,} shared points")

resolved = np.empty(len(carried), np.int64)
for point_ids, segment_ids in ss.History(folder).resolve():
    resolved[point_ids] = segment_ids
print(f"{len(np.unique(resolved)):,} segments, resolved from {ss.History(folder).manifest['segment_ids']:,} raw ids")
