"""Mutated text and ``.npy`` files: read, or told in one sentence, in bounded memory; nothing else comes out.

A few in each run of the suite; as many as STREAMSEG_TORTURE says where it is set.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

MUTANTS = int(os.environ.get("STREAMSEG_TORTURE", "60"))

SCRIPT = Path(__file__).parent / "reference" / "mutants.py"


@pytest.mark.parametrize("kind", ["npy", "text"])
def test_mutants_are_read_or_told(tmp_path: Path, kind: str) -> None:
    command = [sys.executable, str(SCRIPT), kind, str(MUTANTS), str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    read, damaged, refused = map(int, done.stdout.split())
    assert read + damaged + refused == MUTANTS
    # The mutations are neither harmless nor all deadly.
    assert read > MUTANTS // 20
    assert refused > MUTANTS // 20
    assert not list(tmp_path.glob(".streamseg-*"))
