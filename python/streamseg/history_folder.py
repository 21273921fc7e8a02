"""The folder of a history: whether it is one, who writes it, and what of it may be deleted.

Only what a history of ours consists of is ever deleted: its manifest, and the parts in the folders of its tables.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from .errors import FileError, InvalidInput, OutputExists
from .history_tables import COLUMNS, parquet
from .io.claims import Claim, HeldByOther, claim
from .io.opening import is_folder, there
from .io.output import refuse_pattern

FORMAT = "streamseg history"
FORMAT_VERSION = 1
MANIFEST = "manifest.json"

COUNTS = ("points", "spans", "windows", "segment_ids", "late_joins", "parts")

# Counts beyond this are damage.
_MOST = 2**53
_MOST_MANIFEST = 1 << 26
_LONGEST_SHOWN = 40

UNFINISHED_MANIFEST = "manifest.part"
_LOCK = "writing.lock"
_PART = re.compile(r"part-\d{6,}\.parquet")


def read_manifest(folder: Path) -> dict[str, Any]:
    """Read and check the manifest of a history.

    Raises
    ------
    FileError
        There is none, or it cannot be read.
    InvalidInput
        It is damaged, something else, or of another version.
    """
    path = folder / MANIFEST
    manifest = _parsed(_text(folder))
    if manifest is None:
        raise InvalidInput(f"{path} is damaged: it is no manifest of a history")
    _check_version(folder, manifest)
    _check_content(path, manifest)
    return manifest


def _text(folder: Path) -> bytes:
    path = folder / MANIFEST
    there(path)
    try:
        with open(path, "rb") as file:
            return file.read(_MOST_MANIFEST)
    except (FileNotFoundError, NotADirectoryError):
        raise FileError(f"{folder} is no history: it has no {MANIFEST}") from None
    except OSError as error:
        raise FileError(f"{path} cannot be read: {error.strerror}") from error


def _parsed(text: bytes) -> dict[str, Any] | None:
    """Tell what a manifest says; None if it is none of a history."""
    try:
        manifest = json.loads(text, parse_constant=_refuse_constant)
    except (ValueError, RecursionError):
        return None
    return manifest if isinstance(manifest, dict) and manifest.get("format") == FORMAT else None


def _check_version(folder: Path, manifest: dict[str, Any]) -> None:
    version = manifest.get("version")
    if type(version) is not int:
        raise InvalidInput(f"{folder / MANIFEST} is damaged: version is {shown(version)}, expected a number")
    if version != FORMAT_VERSION:
        raise InvalidInput(f"{folder} has format version {shown(version)}, this version reads {FORMAT_VERSION}")


def _check_content(path: Path, manifest: dict[str, Any]) -> None:
    if not isinstance(manifest.get("parameters"), dict):
        raise InvalidInput(f"{path} is damaged: it has no parameters")
    for name, value in manifest["parameters"].items():
        if isinstance(value, (list, dict)):
            raise InvalidInput(f"{path} is damaged: parameter {shown(name)} is a list, expected one value")
    for name, kind in (("source", str), ("promise", str), ("complete", bool)):
        if type(manifest.get(name)) is not kind:
            raise InvalidInput(f"{path} is damaged: {name} is {shown(manifest.get(name))}, expected {kind.__name__}")
    # Histories of earlier versions do not say why points are unlabelled.
    unlabelled = manifest.get("unlabelled", {})
    if not isinstance(unlabelled, dict):
        raise InvalidInput(f"{path} is damaged: unlabelled is {shown(unlabelled)}, expected counts by cause")
    counts = {count: manifest.get(count) for count in COUNTS}
    counts |= {f"unlabelled {shown(cause)}": count for cause, count in unlabelled.items()}
    for count, value in counts.items():
        if type(value) is not int or not 0 <= value < _MOST:
            raise InvalidInput(f"{path} is damaged: {count} is {shown(value)}, expected a count")


def _refuse_constant(name: str) -> None:
    raise ValueError(f"{name} is no number of JSON")


def shown(value: object) -> str:
    """Show a value of a manifest, or as much of it as fits into a sentence."""
    try:
        text = repr(value)
    except (RecursionError, ValueError):
        return type(value).__name__
    return text if len(text) <= _LONGEST_SHOWN else text[:_LONGEST_SHOWN] + "…"


def check_free(folder: Path, overwrite: bool) -> None:
    """Refuse a folder that a history must not be written to, before any work is done.

    Raises
    ------
    OutputExists
        The folder holds something else, a history that is not to be replaced, or one that is being written.
    FileError
        The folder cannot be made or looked into.
    """
    parquet()
    refuse_pattern(folder, "history")
    try:
        if not is_folder(folder.parent):
            raise FileError(f"the history {folder} cannot be made: the folder {folder.parent} does not exist")
        if there(folder) is not None:
            is_begun = _check_ours(folder)
            if (folder / _LOCK).exists():
                take(folder).release()
            _check_overwritten(folder, is_begun, overwrite)
    except FileError:
        raise
    except OSError as error:
        raise FileError(f"the history {folder} cannot be made: {error.strerror}") from error


def _check_ours(folder: Path) -> bool:
    """Refuse a folder that is something else; tells whether a history has been begun in it."""
    if not folder.is_dir():
        raise OutputExists(f"{folder} exists and is no history; give another folder for the history")
    names = set(os.listdir(folder))
    tables = names & set(COLUMNS)
    if MANIFEST in names:
        _check_manifest_is_ours(folder)
    elif not names <= {*COLUMNS, UNFINISHED_MANIFEST, _LOCK} or (
        UNFINISHED_MANIFEST in names and tables != set(COLUMNS)
    ):
        raise OutputExists(f"{folder} exists and is no history; give another folder for the history")
    if foreign := next(_foreign(folder), None):
        raise OutputExists(f"{foreign} is in the history {folder} and no part of it; give another folder")
    return MANIFEST in names or UNFINISHED_MANIFEST in names or any(True for _ in _parts(folder))


def _check_manifest_is_ours(folder: Path) -> None:
    """Refuse a manifest of something else, and one that is damaged; one of another version is ours."""
    if not (folder / MANIFEST).is_file():
        raise OutputExists(f"{folder} exists and is no history: its {MANIFEST} is something else; give another folder")
    text = _text(folder)
    manifest = _parsed(text)
    if manifest is not None and type(manifest.get("version")) is int and manifest["version"] != FORMAT_VERSION:
        return
    if manifest is None and FORMAT.encode() not in text:
        raise OutputExists(
            f"{folder} exists and is no history: its {MANIFEST} is something else, or too damaged to tell; "
            "give another folder"
        )
    try:
        read_manifest(folder)
    except InvalidInput:
        raise OutputExists(
            f"the history {folder} has a damaged manifest, {MANIFEST}; give another folder, or remove that one first"
        ) from None


def _check_overwritten(folder: Path, is_begun: bool, overwrite: bool) -> None:
    if is_begun and not overwrite:
        raise OutputExists(f"the history {folder} exists; give another folder, or overwrite=True (--overwrite)")
    for place in (folder, *(folder / table for table in COLUMNS)):
        if place.exists() and not os.access(place, os.W_OK | os.X_OK):
            raise FileError(f"the history {folder} cannot be made: no permission to write into {place}")


def _foreign(folder: Path) -> Iterator[Path]:
    """Yield what lies where only a history of ours may, and is none of it."""
    for table in COLUMNS:
        place = folder / table
        if place.is_symlink() or (place.exists() and not place.is_dir()):
            yield place
        elif place.is_dir():
            for path in sorted(place.iterdir()):
                if not _PART.fullmatch(path.name) or path.is_symlink() or not path.is_file():
                    yield path
    for name in (MANIFEST, UNFINISHED_MANIFEST, _LOCK):
        place = folder / name
        if place.is_symlink() or (place.exists() and not place.is_file()):
            yield place


def _parts(folder: Path) -> Iterator[Path]:
    for table in COLUMNS:
        place = folder / table
        if place.is_dir() and not place.is_symlink():
            yield from (path for path in sorted(place.iterdir()) if _PART.fullmatch(path.name))


def take(folder: Path) -> Claim:
    """Hold a folder as the one that writes the history in it.

    Raises
    ------
    OutputExists
        Another run holds it.
    OSError
        It cannot be written to.
    """
    path = folder / _LOCK
    try:
        held = claim(path)
    except HeldByOther:
        raise OutputExists(
            f"the history {folder} is being written by another run ({_holder(path)}); give another folder, or wait"
        ) from None
    held.write(str(os.getpid()))
    return held


def _holder(path: Path) -> str:
    try:
        process = path.read_text(encoding="ascii")
    except (OSError, ValueError):
        process = ""
    if not process.isdigit():
        return "of an unknown process"
    return "of this process" if int(process) == os.getpid() else f"process {process}"


def prepare(folder: Path, overwrite: bool) -> Claim:
    """Make the folders, empty, and hold them; see `check_free` for what is refused."""
    check_free(folder, overwrite)
    try:
        folder.mkdir(exist_ok=True)
        held = take(folder)
        try:
            # Another run may have written one in between.
            _check_overwritten(folder, _check_ours(folder), overwrite)
            clear(folder)
            for table in COLUMNS:
                (folder / table).mkdir(exist_ok=True)
        except BaseException:
            held.release()
            raise
    except FileError:
        raise
    except OSError as error:
        raise FileError(f"the history {folder} cannot be made: {error.strerror}") from error
    return held


def clear(folder: Path) -> None:
    """Delete what a history consists of, the manifest first; anything else stays."""
    for name in (MANIFEST, UNFINISHED_MANIFEST):
        (folder / name).unlink(missing_ok=True)
    for part in _parts(folder):
        part.unlink()


def discard(folder: Path, held: Claim) -> None:
    """Delete a history that nobody wants, and its folder if nothing else is in it; then let go of it."""
    with suppress(OSError):
        clear(folder)
        for table in COLUMNS:
            with suppress(OSError):
                (folder / table).rmdir()
    held.release()
    # Where another run has begun meanwhile, the folder is not empty.
    with suppress(OSError):
        folder.rmdir()
