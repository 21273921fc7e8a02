"""A cloud that has not finished arriving: labels of early spans come out while later ones have not been measured."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

import streamseg as ss


def scanner() -> Iterator[NDArray[np.float64]]:
    """Deliver 20 000 points at a time, for ever."""
    for number, points in enumerate(ss.scenes.spans("street", 20_000)):
        print(f"  the scanner delivers span {number}")
        yield points


with ss.stream(scanner(), ss.Proximity(0.5)) as stream:
    for span in stream:
        segments = len(np.unique(span.segment_ids))
        print(f"span {span.index} is out of scope: {len(span):,} points in {segments:,} segments")
        if span.index == 4:
            break

print(f"stopped after {stream.progress.windows} windows; {stream.promise}")
