"""How much of a file is taken at a time, in bytes, whatever the file announces."""

from __future__ import annotations

BLOCK_BYTES = 2 << 20

# One point of a cloud takes no more than this, be it a line of text or a row of an array.
LONGEST_POINT = 1 << 20

MOST_COLUMNS = 10_000
