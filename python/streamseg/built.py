"""Whether the compiled core belongs to this package: it keeps the stub that it was built with."""

from __future__ import annotations

from pathlib import Path

from . import _core
from .errors import warn

_STUB = Path(__file__).with_name("_core.pyi")


def check_core() -> None:
    """Warn of a compiled core that was built for another state of the package."""
    if _STUB.is_file() and _STUB.read_text(encoding="utf-8") != getattr(_core, "_stub", ""):
        warn("the compiled core of streamseg is not that of this package: build it again (make, or pip install .)")


check_core()
