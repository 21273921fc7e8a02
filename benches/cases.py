"""Run the scripts that show what people's files and habits do, and say which of them find a fault.

Each script makes a small input, runs ``streamseg`` on it, prints what came out beside what is right, and exits with 1
while its fault is there. They lie in ``STREAMSEG_CASES``, by default ``../shared/cases``.

    python benches/cases.py
    python benches/cases.py practice/03 practice/17
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import sysconfig
from pathlib import Path

CASES = Path(os.environ.get("STREAMSEG_CASES", Path(__file__).resolve().parents[2] / "shared" / "cases"))

# These only show what happens: a person has to judge it.
_SHOWN = ("14-text-dialects",)
# These wait for faster planes and for coincident points that weigh no more than one.
_WAITING = ("11-zeros-at-the-origin",)
_MOST_SECONDS = 600


def main() -> int:
    """Run the scripts; 1 if one of them finds a fault."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("names", nargs="*", default=["practice/"], help="beginnings of names [default: practice/]")
    asked = parser.parse_args()
    if not CASES.is_dir():
        print(f"{CASES} does not exist; name the folder of the cases in STREAMSEG_CASES", file=sys.stderr)
        return 2
    scripts = sorted(path for name in asked.names for path in CASES.glob(f"{name}*.py"))
    if not scripts:
        print(f"{CASES} has no script that begins with {' or '.join(asked.names)}", file=sys.stderr)
        return 2
    return int(sum(_is_wrong(script) for script in scripts) > 0)


def _is_wrong(script: Path) -> bool:
    command = [sys.executable, str(script), str(Path(sysconfig.get_path("scripts")) / "streamseg")]
    told = subprocess.run(command, capture_output=True, text=True, timeout=_MOST_SECONDS)
    if script.stem in _SHOWN:
        print(f"{script.stem}: look\n{_indented(told.stdout)}")
    elif told.returncode == 0:
        print(f"{script.stem}: ok")
    elif script.stem in _WAITING:
        print(f"{script.stem}: waits\n{_indented(told.stdout)}")
    else:
        print(f"{script.stem}: WRONG\n{_indented(told.stdout + told.stderr)}")
        return True
    return False


def _indented(text: str) -> str:
    return "\n".join(f"    {line}" for line in text.rstrip().splitlines())


if __name__ == "__main__":
    sys.exit(main())
