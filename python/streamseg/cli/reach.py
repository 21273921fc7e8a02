"""What a run tells of how far neighbors can be: whether that joined next to nothing, or everything."""

from __future__ import annotations

from typing import Any

from ..errors import warn
from .arguments import say

_REACHES = {"distance": "--distance", "eps": "--eps", "search_radius": "--search-radius"}

# Of fewer points nothing is odd.
_FEW = 100


def odd_reach(points: int, segments: int, segmentor: Any, *, has_more: bool, quiet: bool) -> None:
    """Warn if there are nearly as many segments as points; say so if there is only one.

    `has_more` tells whether points are in no segment, or in one that was left out.
    """
    name = next((name for name in _REACHES if getattr(segmentor, name, None) is not None), None)
    if name is None or points < _FEW:
        return
    reach, option = getattr(segmentor, name), _REACHES[name]
    lengths = [reach] if isinstance(reach, (int, float)) else reach
    given = f"{option} {','.join(f'{length:g}' for length in lengths)}"
    if 2 * segments > points:
        warn(
            f"{given} joins next to nothing: {points:,} points came to {segments:,} segments; "
            "streamseg info FILE tells how far points are apart, and proposes what fits"
        )
    elif segments == 1 and not has_more:
        told = f"there is only one segment; if that is too few, {given} is too far"
        say(f"{told}: streamseg info FILE proposes what fits", quiet)
