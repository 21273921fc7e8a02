"""Two partitions of the same points: whether they are one, how well they agree, and where they do not.

Source: the adjusted index of Hubert and Arabie, "Comparing partitions" (1985), here in whole numbers of pairs.
Departure: points without a segment count as one part, but only ever match points without a segment.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Ids = NDArray[np.int64]
Mask = NDArray[np.bool_]

NONE = -1


class Difference(NamedTuple):
    """Points that are together in both partitions, but are not what is the same segment in both."""

    point_id: int
    """The first of them."""
    static_segment: int
    """Their segment in the first partition, -1 = none."""
    streamed_segment: int
    """Their segment in the second partition, -1 = none."""
    points: int
    """How many they are."""


class Comparison(NamedTuple):
    """How two partitions of the same points are related."""

    adjusted_rand_index: float
    """1 for the same partition, about 0 for unrelated ones."""
    differing: Ids
    """The points that differ, (m,), ascending; none only if the partitions are the same."""
    differences: tuple[Difference, ...]
    """The points that differ, in groups, in the order of the first of each; at most as many groups as asked for."""


def compare(static: Ids, streamed: Ids, most: int = 5) -> Comparison:
    """Compare two partitions, which may use any numbers; -1 = none.

    A segment of one is the same segment in the other if each is the one with which the other shares most points. All
    points beside that differ.

    Parameters
    ----------
    static, streamed : (n,) int64
        Two segment ids of each point.
    most : int, default 5
        How many differences are told.

    Examples
    --------
    >>> import numpy as np
    >>> from streamseg.comparison import compare
    >>> compare(np.array([1, 1, 1, 2]), np.array([7, 7, 9, 8])).differences
    (Difference(point_id=2, static_segment=1, streamed_segment=9, points=1),)
    """
    rows, row_of_point = np.unique(static, return_inverse=True)
    columns, column_of_point = np.unique(streamed, return_inverse=True)
    # A cell is what a row and a column share.
    cells, first, cell_of_point, counts = np.unique(
        row_of_point * len(columns) + column_of_point, return_index=True, return_inverse=True, return_counts=True
    )
    row, column = np.divmod(cells, max(len(columns), 1))
    is_same = _largest(row, column, counts, (rows[row] == NONE) == (columns[column] == NONE))
    others = np.flatnonzero(~is_same)
    told = others[np.argsort(first[others])][:most]
    return Comparison(
        _adjusted_rand_index(counts, np.bincount(row_of_point), np.bincount(column_of_point)),
        np.flatnonzero(~is_same[cell_of_point]),
        tuple(
            Difference(int(first[cell]), int(rows[row[cell]]), int(columns[column[cell]]), int(counts[cell]))
            for cell in told
        ),
    )


def _largest(row: Ids, column: Ids, counts: Ids, is_possible: Mask) -> Mask:
    """Which possible cells are the largest of their row and of their column, the first of equally large ones."""
    is_largest = is_possible.copy()
    for line, across in ((row, column), (column, row)):
        order = np.lexsort((across, -counts, ~is_possible, line))
        is_first = np.diff(line[order], prepend=-1) != 0
        of_line = np.zeros(len(line), np.bool_)
        of_line[order[is_first]] = True
        is_largest &= of_line
    return is_largest


def _adjusted_rand_index(cells: Ids, rows: Ids, columns: Ids) -> float:
    """Compute the index from the sizes of the cells, rows and columns; exact until the last division."""
    together, in_rows, in_columns = map(_pairs, (cells, rows, columns))
    points = int(cells.sum())
    pairs = points * (points - 1) // 2
    expected = in_rows * in_columns
    most = (in_rows + in_columns) * pairs
    if most == 2 * expected:
        # Each of the two is one part, or nothing but single points.
        return 1.0
    return 2 * (together * pairs - expected) / (most - 2 * expected)


def _pairs(sizes: Ids) -> int:
    """How many pairs there are in parts of these sizes."""
    return int((sizes * (sizes - 1) // 2).sum())
