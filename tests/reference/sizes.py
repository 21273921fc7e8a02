"""Limits of size and order by size, applied to final ids that are all in memory."""

from __future__ import annotations

from contextlib import AbstractContextManager
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

from streamseg._core import Pipeline

Ids = NDArray[np.int64]


class Limits(NamedTuple):
    """What can be asked for."""

    min_segment_size: int = 1
    max_segment_size: int | None = None
    sort: str = "native"

    def of_every_run(self) -> AbstractContextManager[Any]:
        """Apply to every run, whatever its segmentor."""

        def pipeline(*given: Any, **options: Any) -> Pipeline:
            return Pipeline(*given, **{**options, **self._asdict()})

        return patch("streamseg.run.Pipeline", pipeline)

    def select(self, final: Ids) -> Ids:
        """What final ids become: from the sizes of all segments at once."""
        sizes = np.bincount(final[final != -1], minlength=1)
        most = np.inf if self.max_segment_size is None else self.max_segment_size
        kept = np.flatnonzero((sizes > 0) & (sizes >= self.min_segment_size) & (sizes <= most))
        becomes = np.full(len(sizes) + 1, -1, np.int64)
        if self.sort == "native":
            becomes[kept] = kept
        else:
            sign = 1 if self.sort == "ascending" else -1
            becomes[kept[np.argsort(sign * sizes[kept], kind="stable")]] = np.arange(1, len(kept) + 1)
        return becomes[final]

    def left_out(self, final: Ids) -> tuple[int, int]:
        """Segments and points that are left out."""
        gone = final[(final != -1) & (self.select(final) == -1)]
        return len(np.unique(gone)), len(gone)
