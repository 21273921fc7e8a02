"""Whether LAZ can be compressed in threads: a forked process has none of its parent's."""

from __future__ import annotations

import os

_is_forked = False


def can_compress_in_threads() -> bool:
    """Whether this process was started, and not forked: then a compressor would wait for ever."""
    return not _is_forked


def _note_fork() -> None:
    global _is_forked
    _is_forked = True


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_note_fork)
