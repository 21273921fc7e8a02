"""What a run tells of how far neighbors can be: whether that joined next to nothing, or everything."""

from __future__ import annotations

from typing import Any

from ..errors import warn
from ..files import Outcome
from .arguments import say

_REACHES = {"distance": "--distance", "eps": "--eps", "search_radius": "--search-radius"}

# Of fewer points nothing is odd.
_FEW = 100


def odd_reach(outcome: Outcome, segmentor: Any, *, quiet: bool) -> None:
    """Warn if there are nearly as many segments as points; say so if there is only one."""
    name = next((name for name in _REACHES if getattr(segmentor, name, None) is not None), None)
    if name is None or outcome.points < _FEW:
        return
    reach, option = getattr(segmentor, name), _REACHES[name]
    lengths = [reach] if isinstance(reach, (int, float)) else reach
    given = f"{option} {','.join(f'{length:g}' for length in lengths)}"
    segments = outcome.segments + outcome.left_out.segments
    if 2 * segments > outcome.points:
        warn(
            f"{given} joins next to nothing: {outcome.points:,} points came to {segments:,} segments; "
            "streamseg info FILE tells how far points are apart, and proposes what fits"
        )
    elif segments == 1 and not outcome.left_out.points:
        told = f"there is only one segment; if that is too few, {given} is too far"
        say(f"{told}: streamseg info FILE proposes what fits", quiet)
