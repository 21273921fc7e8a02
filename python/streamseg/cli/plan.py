"""What ``info --plan`` says: its options are those of ``segment``, read by the parser of that command."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import typer

from ..errors import InvalidParameter
from ..plan import plan
from ..threads import cores
from . import methods
from .segment import segment

# What the plan chooses.
_CHOSEN = ("span_count", "span_time", "span_lines", "spans", "overlap")


def explained(file: Path, words: list[str]) -> Iterator[tuple[str, str]]:
    """Explain the plan for segmenting a file with these options: a label and what there is to say, line by line."""
    options = _parsed(file, words)
    for name in _CHOSEN:
        if options[name] is not None:
            raise InvalidParameter(
                f"--{name.replace('_', '-')} is given with --plan, allowed: none; the plan chooses it"
            )
    if options["span_width"] not in (None, "auto"):
        raise InvalidParameter(f"--span-width is '{options['span_width']}' with --plan, allowed: auto, or none")
    segmentor = methods.segmentor(options["method"], methods.given(options), options["settings"] or ())
    chosen = plan(
        file,
        segmentor,
        options["max_memory"],
        preprocess=methods.stages(options["outliers"], options["lonely"], options["voxel"]),
        drop_invalid=options["drop_invalid"],
        with_history=options["history"] is not None,
    )
    yield "segmentor", repr(segmentor)
    yield from chosen.explain(options["threads"] or cores())


def _parsed(file: Path, words: list[str]) -> Mapping[str, Any]:
    app = typer.Typer(add_completion=False)
    app.command()(segment)
    context = typer.main.get_command(app).make_context("streamseg info FILE --plan", [str(file), "OUT.laz", *words])
    return context.params
