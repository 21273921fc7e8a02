"""What ``info --plan`` says: its options are those of ``segment``, read by the parser of that command."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import typer

from ..plan import plan
from ..threads import checked_threads, cores
from .choice import chosen
from .segment import segment


def explained(file: Path, words: list[str]) -> Iterator[tuple[str, str]]:
    """Explain the plan for segmenting files with these options: a label and what there is to say, line by line."""
    options = _parsed(file, words)
    choice, threads = chosen(options, planner="--plan"), checked_threads(options["threads"])
    made = plan(
        options["inputs"],
        **{name: choice[name] for name in ("segmentor", "max_memory", "preprocess", "drop_invalid")},
        with_history=options["history"] is not None,
    )
    yield "segmentor", repr(choice["segmentor"])
    yield from made.explain(threads or cores())


def _parsed(file: Path, words: list[str]) -> Mapping[str, Any]:
    app = typer.Typer(add_completion=False)
    app.command()(segment)
    context = typer.main.get_command(app).make_context("streamseg info FILE --plan", [str(file), *words, "OUT.laz"])
    return context.params
