"""The command that compares streamed with static. It takes the options of `segment` that are not about its output."""

from __future__ import annotations

import inspect
from typing import Any

import typer

from ..progress import ProgressBars
from ..verification import verify as verify_run
from . import methods, wording
from .arguments import DIFFERENT, WRONG, Inputs, say
from .choice import chosen
from .reach import odd_reach
from .segment import segment

_OF_OUTPUT = {"output", "result", "history", "preview", "overwrite", "id_name"}


def verify(inputs: Inputs, **options: Any) -> None:
    """Segment IN streamed and static, and say whether they are identical; if not, where they differ, and why.

    Exit status 0 if they are identical, 3 if they are not.
    """
    choice, quiet = chosen(options), options["quiet"]
    with ProgressBars(enabled=not quiet) as bars:
        verification = verify_run(inputs, **choice, on_progress=bars.on_progress)
    say(wording.as_typed(str(verification), methods.PARAMETERS), quiet)
    points, segments, without = verification.points, verification.static_segments, verification.static_unlabelled
    odd_reach(points, segments, choice["segmentor"], has_more=without > 0, quiet=quiet)
    if not verification.is_identical:
        raise typer.Exit(DIFFERENT)
    if verification.damage is not None:
        raise typer.Exit(WRONG)


_parameters = inspect.signature(segment, eval_str=True).parameters
_kept = [parameter for name, parameter in _parameters.items() if name not in _OF_OUTPUT]
verify.__signature__ = inspect.Signature(_kept)  # type: ignore[attr-defined]
verify.__annotations__ = {parameter.name: parameter.annotation for parameter in _kept}
