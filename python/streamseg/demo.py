"""The demonstration: a made-up flight strip, segmented as a stream, and what there is to look at."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from . import scenes
from ._core import Proximity, SpanByWidth
from .errors import FileError, OutputExists, StreamsegError
from .files import segment_file
from .history_folder import check_free, read_manifest
from .io.opening import there
from .io.output import check_output, refuse_pattern
from .preview import check_preview, preview
from .progress import ProgressBars

_DISTANCE = 1.0
_SPAN_WIDTH = 25.0


def run(folder: Path, points: int, seed: int) -> Iterator[str]:
    """Make and segment a scene; yields a sentence on everything that is left in the folder."""
    refuse_pattern(folder, "folder")
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise FileError(f"{folder} cannot be made: {error.strerror}") from error
    labelled, history, picture = folder / "labelled.laz", folder / "strip.history", folder / "labelled.png"
    for path in (folder / "strip.laz", labelled, picture):
        # What an earlier demonstration left may be replaced; the history is its mark.
        if there(path) is not None and not _is_history(history):
            raise OutputExists(f"{path} exists and is not of an earlier demonstration; give another folder")
    check_free(history, overwrite=True)
    check_output(labelled, [], overwrite=True)
    check_preview(picture, overwrite=True)
    scene = scenes.write(folder / "strip.laz", "airborne", points, seed)
    with ProgressBars() as bars:
        outcome = segment_file(
            scene,
            labelled,
            Proximity(_DISTANCE),
            spans=SpanByWidth(_SPAN_WIDTH),
            history=history,
            overwrite=True,
            on_open=bars.on_open,
            on_read=bars.on_read,
            on_progress=bars.on_progress,
            on_write=bars.on_write,
        )
    preview(labelled, picture, shade="height", overwrite=True)
    yield f"{outcome.points:,} points in {outcome.segments:,} segments, {outcome.windows} windows"
    yield f"  the scene, as flown     {scene}"
    yield f"  with segment ids        {labelled}"
    yield f"  the whole story         {history}"
    yield f"  to look at              {picture}"


def _is_history(folder: Path) -> bool:
    try:
        read_manifest(folder)
    except StreamsegError:
        return False
    return True
