"""A history read from outside, with DuckDB and SciPy: what its Parquet files say to anyone."""

from __future__ import annotations

from pathlib import Path

import duckdb
import numpy as np
from numpy.typing import NDArray

from .segmentor import components

Rows = NDArray[np.int64]

COLUMNS = {
    "point_segment": ("point_id", "segment_id", "span"),
    "segment_segment": ("segment_id", "next_segment_id", "window", "shared_points"),
    "window": (
        *("window", "first_span", "spans", "points", "first_segment_id", "segments"),
        *("decided_edges", "waiting_edges", "decided_points", "waiting_points"),
        *("returned_points", "early_decisions"),
    ),
    "alias": ("segment_id", "becomes", "span"),
    "seedless": ("segment_id", "span"),
}


def table(folder: Path, name: str) -> Rows:
    """All rows of a table, by its first two columns."""
    columns = COLUMNS[name]
    # `window` is a keyword of SQL.
    names = ", ".join(f'"{column}"' for column in columns)
    query = f"SELECT {names} FROM '{folder}/{name}/*.parquet' ORDER BY ALL"
    rows = duckdb.sql(query).fetchnumpy()
    return np.column_stack([np.asarray(rows[column], np.int64) for column in columns])


def raw_ids(folder: Path) -> Rows:
    """The raw segment id of each point, in the order of the stream."""
    points = table(folder, "point_segment")
    assert np.array_equal(points[:, 0], np.arange(len(points))), "each point is in the history once"
    return points[:, 1]


def final_ids(folder: Path) -> Rows:
    """The final segment id of each point: the smallest raw id of its component of the segment-segment graph."""
    raw = raw_ids(folder)
    pairs = table(folder, "segment_segment")[:, :2]
    pairs = pairs[pairs[:, 1] != -1]
    count = 1 + int(max(raw.max(initial=0), pairs.max(initial=0)))
    component = components(count, pairs)
    smallest = np.full(count, count, np.int64)
    np.minimum.at(smallest, component, np.arange(count))
    return np.where(raw == -1, -1, smallest[component][np.maximum(raw, 0)])
