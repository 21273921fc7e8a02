"""How many windows are segmented side by side."""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from .errors import InvalidParameter, InvalidType

# More threads than this are a slip.
_MOST = 1024


def cores() -> int:
    """How many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def checked_threads(threads: Any) -> int | None:
    """Refuse what is no sensible number of threads; None is left to be chosen."""
    if threads is None:
        return None
    if isinstance(threads, bool) or not isinstance(threads, (int, np.integer)):
        raise InvalidType(f"threads is {threads!r}, allowed: a whole number of at least 1")
    number = int(threads)
    if not 1 <= number <= _MOST:
        given = number if abs(number) < 2**63 else "too large"
        raise InvalidParameter(f"threads is {given}, allowed: a whole number of at least 1, and at most {_MOST}")
    return number
