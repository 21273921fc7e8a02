"""What the tests share: the measured clouds, and how long properties are searched for a counterexample."""

from __future__ import annotations

import functools
import os
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import settings

# The slow twins in tests/reference are imported as `reference`.
sys.path.insert(0, str(Path(__file__).parent))

from reference.clouds import LatticeCloud, read

IS_CI = os.environ.get("CI") == "true"

settings.register_profile(
    "default",
    deadline=None,
    derandomize=IS_CI,
    print_blob=True,
    max_examples=int(os.environ.get("STREAMSEG_EXAMPLES", "40")),
)
settings.register_profile("thorough", parent=settings.get_profile("default"), max_examples=2000)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "default"))


@pytest.fixture(scope="session")
def data() -> Path:
    """The folder of measured clouds."""
    folder = Path(os.environ.get("STREAMSEG_DATA") or Path(__file__).parents[2] / "shared" / "data")
    if not folder.is_dir():
        sentence = f"the measured clouds are not in {folder}; set STREAMSEG_DATA to their folder"
        if IS_CI:
            pytest.fail(sentence)
        pytest.skip(sentence)
    return folder


@pytest.fixture(scope="session")
def cloud(data: Path) -> Callable[[str], LatticeCloud]:
    """Reads a cloud by its path in the data folder; the last few are kept."""
    return functools.lru_cache(maxsize=2)(lambda name: read(data / name))
