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
from .segment import segment

_OF_OUTPUT = {"output", "result", "history", "preview", "overwrite", "id_name"}


def verify(inputs: Inputs, **options: Any) -> None:
    """Segment IN streamed and static, and say whether they are identical; if not, where they differ, and why.

    Exit status 0 if they are identical, 3 if they are not.
    """
    with ProgressBars(enabled=not options["quiet"]) as bars:
        verification = verify_run(inputs, **chosen(options), on_progress=bars.on_progress)
    say(wording.as_typed(str(verification), methods.PARAMETERS), options["quiet"])
    if not verification.is_identical:
        raise typer.Exit(DIFFERENT)
    if verification.damage is not None:
        raise typer.Exit(WRONG)


_parameters = inspect.signature(segment, eval_str=True).parameters
_kept = [parameter for name, parameter in _parameters.items() if name not in _OF_OUTPUT]
verify.__signature__ = inspect.Signature(_kept)  # type: ignore[attr-defined]
verify.__annotations__ = {parameter.name: parameter.annotation for parameter in _kept}
