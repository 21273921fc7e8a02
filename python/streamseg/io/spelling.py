"""When two spellings are one name, as in `src/attribute.rs`."""

from __future__ import annotations


def letters_of(name: str) -> str:
    """Return the name without what does not matter in it: case, underscores and blanks."""
    return name.replace("_", "").replace(" ", "").lower()
