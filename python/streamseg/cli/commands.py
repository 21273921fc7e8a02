"""The command line: segment, verify, resolve, info, preview, export, demo."""

from __future__ import annotations

import sys
import warnings
from enum import Enum
from pathlib import Path
from typing import Annotated, NoReturn, TextIO

import typer

from .. import __version__, description
from ..errors import InvalidParameter, StreamsegError, StreamsegWarning
from ..files import resolved_file
from ..history import History
from ..preview import preview as draw_preview
from ..progress import ProgressBars
from . import interrupt, methods, summary, voice, wording
from .arguments import INTERNAL, MOST, WRONG, IdName, Inputs, InToOut, Output, Overwrite
from .memory import give_memory_back
from .plan import explained
from .segment import segment
from .verify import verify

app = typer.Typer(
    name="streamseg",
    help="Segment point clouds as a stream: clouds that do not fit in memory, or have not finished arriving.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)


app.command(cls=InToOut)(segment)
app.command()(verify)


class Shade(str, Enum):
    """How the preview is shaded."""

    segment = "segment"
    height = "height"


@app.command(cls=InToOut)
def resolve(
    history: Annotated[Path, typer.Argument(metavar="HISTORY", help="Folder of the history of a run over IN.")],
    inputs: Inputs,
    output: Output,
    limits: Annotated[
        bool, typer.Option("--limits/--no-limits", help="Leave out the segments that the run left out by their size.")
    ] = True,
    overwrite: Overwrite = False,
    id_name: IdName = None,
) -> None:
    """Write IN to OUT with the final segment ids that HISTORY resolves to."""
    with ProgressBars() as bars:
        outcome = resolved_file(
            history, inputs, output, limits=limits, overwrite=overwrite, id_name=id_name, on_write=bars.on_write
        )
    manifest = History(history).manifest
    for sentence in summary.of_resolution(outcome, manifest["parameters"], output):
        typer.echo(sentence)
    if not manifest["complete"]:
        raise typer.Exit(WRONG)


@app.command(context_settings={"allow_extra_args": True, "ignore_unknown_options": True})
def info(
    context: typer.Context,
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A cloud, or the folder of a history.")],
    plan: Annotated[
        bool,
        typer.Option("--plan", help="Explain what segment --max-memory would choose; takes the options of segment."),
    ] = False,
) -> None:
    """Say what FILE holds, and how it could be segmented."""
    if context.args and not plan:
        words = [str(file), *context.args]
        given = next((word for word in words if word.startswith("-")), " ".join(context.args))
        raise InvalidParameter(f"{given} is given without --plan, allowed: FILE only")
    for label, value in explained(file, context.args) if plan else description.describe(file):
        typer.echo(f"{label:<12} {value}")


@app.command()
def preview(
    labelled: Annotated[Path, typer.Argument(metavar="LABELLED", help="A labelled LAS, LAZ or text file.")],
    output: Annotated[Path, typer.Argument(metavar="OUT.png")],
    shade: Annotated[
        Shade, typer.Option(help="height: a second picture beside it, colored by height.")
    ] = Shade.segment,
    size: Annotated[int, typer.Option(help="Longest side of the drawing in pixels.")] = 1600,
    overwrite: Overwrite = False,
    id_name: IdName = None,
) -> None:
    """Draw LABELLED from above, neighboring segments in different colors."""
    with wording.called(size="--size"):
        drawn = draw_preview(labelled, output, shade=shade.value, size=size, overwrite=overwrite, id_name=id_name)
    typer.echo(f"{output}: {summary.in_segments(drawn.points, drawn.none, len(drawn.counts))}")


@app.command()
def export(
    history: Annotated[Path, typer.Argument(metavar="HISTORY", help="Folder of a history.")],
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder for the CSV files.")],
    overwrite: Overwrite = False,
) -> None:
    """Write the tables of HISTORY as CSV files into DIR."""
    for path in History(history).to_csv(folder, overwrite=overwrite):
        typer.echo(str(path))


@app.command()
def demo(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Where to leave what it makes.")] = Path("demo"),
    points: Annotated[int, typer.Option(min=1000, max=MOST, help="Points of the scene.")] = 600_000,
    seed: Annotated[int, typer.Option(min=0, max=MOST, help="Which scene.")] = 7,
) -> None:
    """Make a scene, segment it as a stream, and leave what there is to look at in DIR."""
    from ..demo import run

    for sentence in run(folder, points, seed):
        typer.echo(sentence)


def _version(asked: bool) -> None:
    if asked:
        typer.echo(f"streamseg {__version__}")
        raise typer.Exit


@app.callback()
def _main(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Say the version.")
    ] = False,
) -> None:
    pass


def _warn(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    if issubclass(category, StreamsegWarning):
        typer.echo(f"streamseg: warning: {_as_typed(message)}", err=True)


def _as_typed(message: object) -> str:
    return wording.as_typed(str(message), methods.PARAMETERS)


def main() -> NoReturn:
    """Run the command line; errors are one sentence each."""
    give_memory_back()
    warnings.showwarning = _warn
    with voice.heard():
        _run()
    sys.exit(INTERNAL)


def _run() -> None:
    try:
        interrupt.listen()
        app()
    except BaseException as error:
        if (stop := interrupt.behind(error)) is not None:
            typer.echo("; ".join(["streamseg: interrupted", *stop.args]), err=True)
            sys.exit(interrupt.status())
        if (told := wording.of_plugin(error)) is not None:
            typer.echo(f"streamseg: {told}", err=True)
            sys.exit(INTERNAL)
        if not isinstance(error, StreamsegError):
            raise
        typer.echo(f"streamseg: {_as_typed(error)}", err=True)
        sys.exit(WRONG)
