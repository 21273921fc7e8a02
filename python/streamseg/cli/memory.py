"""What the process asks of the C library and the kernel, so that its memory depends on the run and not on chance."""

from __future__ import annotations

import ctypes
import sys

# mallopt(3) of glibc, prctl(2) of Linux.
_MMAP_THRESHOLD, _ARENA_MAX = -3, -8
_SET_THP_DISABLE = 41
_LARGE = 1 << 18


def give_memory_back() -> None:
    """Have what is freed go back to the system, and have no thread keep memory of its own.

    By default glibc learns from every freed buffer, up to 32 MiB, to keep such sizes, and has a heap for each thread.
    What is kept then depends on which thread had what to do: on the number of cores, and on what else the machine
    does. Huge pages, where the kernel has some to spare, count as a whole where only a part is used.
    """
    if sys.platform != "linux":
        return
    try:
        library = ctypes.CDLL(None)
    except OSError:  # an interpreter that loads no libraries
        return
    # Other C libraries than glibc have no mallopt.
    if hasattr(library, "mallopt"):
        library.mallopt(_MMAP_THRESHOLD, _LARGE)
        library.mallopt(_ARENA_MAX, 1)
    library.prctl(_SET_THP_DISABLE, 1, 0, 0, 0)
