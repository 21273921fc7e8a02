"""The command line: segment, resolve, info, preview, export, demo."""

from __future__ import annotations

import contextlib
import ctypes
import sys
import warnings
from collections.abc import Iterator
from enum import Enum
from pathlib import Path
from typing import Annotated, Any, NoReturn, TextIO

import typer

from . import __version__, description
from ._core import Proximity, Recipe, SpanByCount, SpanByScanLine, SpanByTime, SpanByWidth, Window, default_spans
from .errors import InvalidParameter, StreamsegError, StreamsegWarning
from .files import Outcome, resolve_file, segment_file
from .history import History
from .preview import check_preview
from .preview import preview as draw_preview
from .progress import ProgressBars
from .run import SpanBy

# Exit status: 0 done, 1 internal error, 2 wrong usage or input; 130 after Ctrl-C, as shells have it.
_INTERNAL = 1
_WRONG = 2
_INTERRUPTED = 130

# Whole numbers beyond this are slips.
_MOST = 1_000_000_000

app = typer.Typer(
    name="streamseg",
    help="Segment point clouds as a stream: clouds that do not fit in memory, or have not finished arriving.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)


class Graph(str, Enum):
    """Which pairs are looked at."""

    delaunay = "delaunay"


class Metric(str, Enum):
    """Which coordinates count for a length."""

    xyz = "xyz"
    xy = "xy"


class Result(str, Enum):
    """Which segment ids are written."""

    final = "final"
    carry = "carry"
    history = "history"


class Shade(str, Enum):
    """How the preview is shaded."""

    segment = "segment"
    height = "height"


Inputs = Annotated[list[Path], typer.Argument(metavar="IN...", help="LAS, LAZ, .npy or text; several are one stream.")]
Output = Annotated[Path, typer.Argument(metavar="OUT", help="The labelled cloud; LAS and LAZ get a SegmentID.")]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace what is already there.")]


@app.command()
def segment(
    inputs: Inputs,
    output: Output,
    distance: Annotated[float, typer.Option(help="Greatest distance of joined neighbors, in units of the cloud.")],
    graph: Annotated[Graph, typer.Option(help="Which pairs are looked at.")] = Graph.delaunay,
    metric: Annotated[Metric, typer.Option(help="Distance in space or on the map.")] = Metric.xyz,
    span_width: Annotated[float | None, typer.Option(help="Spans of this width. [default: 20 x distance]")] = None,
    direction: Annotated[str, typer.Option(help="x, y or an azimuth in degrees, for --span-width.")] = "x",
    span_count: Annotated[int | None, typer.Option(max=_MOST, help="Spans of so many points, in file order.")] = None,
    span_time: Annotated[float | None, typer.Option(help="Spans of so many seconds of gps_time.")] = None,
    span_lines: Annotated[int | None, typer.Option(max=_MOST, help="Spans of so many scan lines.")] = None,
    spans: Annotated[int, typer.Option(max=_MOST, help="Spans in a window.")] = Window().spans,
    overlap: Annotated[int | None, typer.Option(max=_MOST, help="Spans that two windows share. [default: 1]")] = None,
    result: Annotated[Result, typer.Option(help="Which ids are written.")] = Result.final,
    history: Annotated[Path | None, typer.Option(help="Folder for the history of the run.")] = None,
    threads: Annotated[int | None, typer.Option(max=_MOST, help="Windows at a time. [default: all cores]")] = None,
    preview: Annotated[Path | None, typer.Option(help="Also draw the result, as PNG.")] = None,
    drop_invalid: Annotated[
        bool, typer.Option("--drop-invalid", help="Give NaN and infinite points no segment instead of refusing them.")
    ] = False,
    overwrite: Overwrite = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No progress bar, no summary.")] = False,
) -> None:
    """Segment IN and write every point with its segment id to OUT."""
    segmentor = Proximity(distance, graph.value, metric.value)
    if preview is not None:
        check_preview(preview, overwrite, [*inputs, output])
        if output.suffix.lower() == ".npy":
            raise InvalidParameter(
                f"--preview needs coordinates beside the ids, {output} has none; write LAS, LAZ or text"
            )
    with _telling_what_is_left(output), ProgressBars(enabled=not quiet) as bars:
        outcome = segment_file(
            inputs,
            output,
            segmentor,
            spans=_spans(segmentor, span_width, direction, span_count, span_time, span_lines),
            window=Window(spans, overlap),
            history=history,
            result=result.value,
            threads=threads,
            drop_invalid=drop_invalid,
            overwrite=overwrite,
            on_read=bars.on_read,
            on_progress=bars.on_progress,
            on_write=bars.on_write,
            on_open=bars.on_open,
        )
    if not quiet:
        _summarize(outcome, segmentor, output, history, result)
    if preview is not None:
        draw_preview(output, preview, overwrite=overwrite)
        _say(f"picture in {preview}", quiet)
    if outcome.damage is not None:
        raise typer.Exit(_WRONG)


@contextlib.contextmanager
def _telling_what_is_left(output: Path) -> Iterator[None]:
    """On a failure, say whether the points before it are in the output."""
    before = _written_at(output)
    try:
        yield
    except (Exception, KeyboardInterrupt) as failure:
        kept = _written_at(output) != before
        left = f"the points segmented before that are in {output}" if kept else f"{output} has not been written"
        if isinstance(failure, KeyboardInterrupt):
            typer.echo(f"streamseg: interrupted; {left}", err=True)
            raise typer.Exit(_INTERRUPTED) from None
        if kept:
            typer.echo(f"streamseg: {left}", err=True)
        raise


def _written_at(output: Path) -> int | None:
    return output.stat().st_mtime_ns if output.exists() else None


def _spans(
    segmentor: Proximity,
    width: float | None,
    direction: str,
    count: int | None,
    seconds: float | None,
    lines: int | None,
) -> SpanBy | None:
    given = {"--span-width": width, "--span-count": count, "--span-time": seconds, "--span-lines": lines}
    chosen = [name for name, value in given.items() if value is not None]
    if direction != "x" and chosen not in ([], ["--span-width"]):
        raise InvalidParameter(f"--direction is given with {chosen[0]}, allowed: with --span-width")
    if len(chosen) > 1:
        raise InvalidParameter(f"{' and '.join(chosen)} are given, allowed: one of {', '.join(given)}")
    if count is not None:
        return SpanByCount(count)
    if seconds is not None:
        return SpanByTime(seconds)
    if lines is not None:
        return SpanByScanLine(lines)
    if width is None and direction == "x":
        return None
    try:
        azimuth: str | float = float(direction)
    except ValueError:
        azimuth = direction
    if width is None:
        width = default_spans(Recipe(segmentor, [], True), None, None).width
    return SpanByWidth(width, azimuth)


def _summarize(outcome: Outcome, segmentor: Any, output: Path, history: Path | None, result: Result) -> None:
    noun = {"final": "segments", "carry": "segments as far as was known", "history": "raw segment ids"}[result.value]
    typer.echo(
        f"{output}: {outcome.points:,} points in {outcome.segments:,} {noun}{_left_out(outcome, segmentor)}, "
        f"{outcome.windows:,} windows; {outcome.promise}"
    )
    if outcome.aliases:
        where = f"they are in {history / 'alias'}" if history else "--history keeps them, --result final applies them"
        typer.echo(f"{outcome.aliases:,} ids have become another's after they were written; {where}")
    if history is not None:
        typer.echo(f"history in {history}")


def _left_out(outcome: Outcome, segmentor: Any) -> str:
    if not outcome.left_out.segments:
        return ""
    smallest, largest = (getattr(segmentor, name, None) for name in ("min_segment_size", "max_segment_size"))
    reasons = [f"smaller than {smallest:,} points"] if smallest is not None and smallest > 1 else []
    reasons += [f"larger than {largest:,} points"] if largest is not None else []
    why = " or ".join(reasons) or "without a seed"
    return f", {outcome.left_out.segments:,} {why} left out ({outcome.left_out.points:,} points)"


def _say(sentence: str, quiet: bool = False) -> None:
    if not quiet:
        typer.echo(sentence)


@app.command()
def resolve(
    history: Annotated[Path, typer.Argument(metavar="HISTORY", help="Folder of the history of a run over IN.")],
    inputs: Inputs,
    output: Output,
    limits: Annotated[
        bool, typer.Option("--limits/--no-limits", help="Leave out the segments that the run left out by their size.")
    ] = True,
    overwrite: Overwrite = False,
) -> None:
    """Write IN to OUT with the final segment ids that HISTORY resolves to."""
    with ProgressBars() as bars:
        points = resolve_file(history, inputs, output, limits=limits, overwrite=overwrite, on_write=bars.on_write)
    typer.echo(f"{output}: {points:,} points with final segment ids")
    if not History(history).manifest["complete"]:
        raise typer.Exit(_WRONG)


@app.command()
def info(file: Annotated[Path, typer.Argument(metavar="FILE", help="A cloud, or the folder of a history.")]) -> None:
    """Say what FILE holds, and how it could be segmented."""
    for label, value in description.describe(file):
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
) -> None:
    """Draw LABELLED from above, neighboring segments in different colors."""
    drawn = draw_preview(labelled, output, shade=shade.value, size=size, overwrite=overwrite)
    typer.echo(f"{output}: {drawn.points:,} points in {len(drawn.counts):,} segments")


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
    points: Annotated[int, typer.Option(min=1000, help="Points of the scene.")] = 600_000,
    seed: Annotated[int, typer.Option(min=0, help="Which scene.")] = 7,
) -> None:
    """Make a scene, segment it as a stream, and leave what there is to look at in DIR."""
    from .demo import run

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
        typer.echo(f"streamseg: warning: {message}", err=True)


def _give_memory_back() -> None:
    """Have the C library give large buffers back to the system when they are freed.

    By default glibc learns from every freed buffer, up to 32 MiB, to keep such sizes, in every thread. What is kept
    then depends on chance, and adds a third to the memory of a run.
    """
    mmap_threshold = -3  # glibc's M_MMAP_THRESHOLD
    with contextlib.suppress(OSError, AttributeError, TypeError):
        ctypes.CDLL(None).mallopt(mmap_threshold, 1 << 20)


def main() -> NoReturn:
    """Run the command line; errors are one sentence each."""
    _give_memory_back()
    warnings.showwarning = _warn
    try:
        app()
    except StreamsegError as error:
        typer.echo(f"streamseg: {error}", err=True)
        sys.exit(_WRONG)
    sys.exit(_INTERNAL)
