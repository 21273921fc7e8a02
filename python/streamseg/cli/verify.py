"""The command that compares streamed with static. It takes the options of `segment` that are not about its output."""

from __future__ import annotations

import inspect
from typing import Any

import typer

from ..progress import ProgressBars
from ..verification import verify as verify_run
from . import methods
from .arguments import DIFFERENT, WRONG, Inputs, say
from .segment import _spans, _window, segment

_AS_THEY_ARE = ("max_memory", "threads", "drop_invalid", "revisit")
_CUTS = ("span_width", "direction", "span_count", "span_time", "span_lines")
_OF_OUTPUT = {"output", "result", "history", "preview", "overwrite"}


def verify(inputs: Inputs, **options: Any) -> None:
    """Segment IN streamed and static, and say whether they are identical; if not, where they differ, and why.

    Exit status 0 if they are identical, 3 if they are not.
    """
    segmentor = methods.segmentor(options["method"], methods.given(options), options["settings"] or ())
    with ProgressBars(enabled=not options["quiet"]) as bars:
        verification = verify_run(
            inputs,
            segmentor,
            preprocess=methods.stages(options["outliers"], options["lonely"], options["voxel"]),
            spans=_spans(segmentor, *(options[name] for name in _CUTS)),
            window=_window(options["spans"], options["overlap"]),
            **{name: options[name] for name in _AS_THEY_ARE},
            on_progress=bars.on_progress,
        )
    say(str(verification), options["quiet"])
    if not verification.is_identical:
        raise typer.Exit(DIFFERENT)
    if verification.damage is not None:
        raise typer.Exit(WRONG)


_parameters = inspect.signature(segment, eval_str=True).parameters
_kept = [parameter for name, parameter in _parameters.items() if name not in _OF_OUTPUT]
verify.__signature__ = inspect.Signature(_kept)  # type: ignore[attr-defined]
verify.__annotations__ = {parameter.name: parameter.annotation for parameter in _kept}
