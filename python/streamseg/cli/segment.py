"""The command that segments a cloud from file to file."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from enum import Enum
from pathlib import Path
from typing import Annotated, Any

import typer

from ..errors import InvalidParameter, OutputExists
from ..files import segment_file
from ..io.opening import there
from ..preview import check_preview
from ..preview import preview as draw_preview
from ..progress import ProgressBars
from . import methods, summary
from .arguments import MOST, WRONG, IdName, Inputs, Output, Overwrite, say
from .choice import chosen
from .reach import odd_reach


class Result(str, Enum):
    """Which segment ids are written."""

    final = "final"
    carry = "carry"
    history = "history"


_METHOD = "What is one segment (--method)"
_EVERY = "Options of every method"
_BEFORE = "Before that"
_SPANS = "How the cloud is cut"


def _of(panel: str, text: str, **more: Any) -> Any:
    return typer.Option(help=text, rich_help_panel=panel, **more)


def segment(
    inputs: Inputs,
    output: Output,
    method: Annotated[
        str, _of(_METHOD, f"{', '.join(methods.METHODS)}, or one that an installed package announces.")
    ] = "proximity",
    distance: Annotated[
        float | None, _of(_METHOD, "proximity: greatest distance of joined neighbors, in units of the cloud.")
    ] = None,
    graph: Annotated[str | None, _of(_METHOD, "proximity: which pairs are looked at, delaunay or radius.")] = None,
    metric: Annotated[
        str | None, _of(_METHOD, "proximity, dbscan: distance in space (xyz) or on the map (xy).")
    ] = None,
    eps: Annotated[float | None, _of(_METHOD, "dbscan: how far neighbors can be.")] = None,
    min_points: Annotated[
        int | None, _of(_METHOD, "dbscan: neighbors, itself included, that make a core point.", max=MOST)
    ] = None,
    criterion: Annotated[
        str | None, _of(_METHOD, 'conditional: when neighbors belong together, such as "abs(Z-n[0].Z)<0.15".')
    ] = None,
    search_radius: Annotated[
        str | None,
        _of(_METHOD, "conditional, planes, growing: how far neighbors can be; for 2.5d also R,H or R,LOW,HIGH."),
    ] = None,
    search_mode: Annotated[str | None, _of(_METHOD, "conditional, planes: 3d, 2.5d or 2d.")] = None,
    max_distance: Annotated[float | None, _of(_METHOD, "planes: greatest distance of a point from its plane.")] = None,
    max_sigma: Annotated[float | None, _of(_METHOD, "planes: an adjustment with more than this is not taken.")] = None,
    tile_size: Annotated[
        float | None, _of(_METHOD, "planes: side of the tiles in which planes grow. [default: 20 x the radius]")
    ] = None,
    seed_calculator: Annotated[
        str | None, _of(_METHOD, 'planes: order of the seeds, such as "NormalSigma0<0.02 ? NormalSigma0 : invalid".')
    ] = None,
    k: Annotated[
        int | None, _of(_METHOD, "planes, growing: neighbors are the k nearest, the point itself included.", max=MOST)
    ] = None,
    angle: Annotated[float | None, _of(_METHOD, "planes, growing: angle between normals, in degrees.")] = None,
    curvature: Annotated[str | None, _of(_METHOD, "growing: surface_variation or principal.")] = None,
    max_curvature: Annotated[
        float | None, _of(_METHOD, "growing: regions do not grow on from points beyond it.")
    ] = None,
    residual: Annotated[float | None, _of(_METHOD, "growing: greatest distance from the tangent plane.")] = None,
    literal: Annotated[
        bool | None, typer.Option("--literal", help="growing: PCL's loop.", rich_help_panel=_METHOD)
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="NAME=VALUE", help="Parameters of a plug-in.", rich_help_panel=_METHOD),
    ] = None,
    min_size: Annotated[
        int | None, _of(_EVERY, "Segments with fewer points come out as -1. [default: 1; conditional, planes: 100]")
    ] = None,
    max_size: Annotated[int | None, _of(_EVERY, "Segments with more points come out as -1.")] = None,
    filter: Annotated[  # noqa: A002 - the name that OPALS users know
        str | None, _of(_EVERY, 'Which points take part, such as "Classification == 6".')
    ] = None,
    seed_filter: Annotated[str | None, _of(_EVERY, "Which points may be the first of a segment.")] = None,
    sort: Annotated[str | None, _of(_EVERY, "Number segments by size: native, ascending or descending.")] = None,
    normals: Annotated[str | None, _of(_EVERY, "How planes are fitted for features: least_squares or robust.")] = None,
    outliers: Annotated[
        str | None, _of(_BEFORE, "Remove statistical outliers: K or K,MULTIPLIER or K,MULTIPLIER,DIALECT.")
    ] = None,
    lonely: Annotated[str | None, _of(_BEFORE, "Remove points with few others around: RADIUS,NEIGHBORS.")] = None,
    voxel: Annotated[float | None, _of(_BEFORE, "Segment the centers of voxels of this size instead.")] = None,
    span_width: Annotated[
        str | None,
        _of(_SPANS, "Spans of this width; auto: as the memory allows. [default: 20 x how far neighbors can be]"),
    ] = None,
    direction: Annotated[
        str | None, _of(_SPANS, "x, y or an azimuth in degrees, for --span-width. [default: x]")
    ] = None,
    span_count: Annotated[int | None, _of(_SPANS, "Spans of so many points, in file order.", max=MOST)] = None,
    span_time: Annotated[float | None, _of(_SPANS, "Spans of so many seconds of gps_time.")] = None,
    span_lines: Annotated[int | None, _of(_SPANS, "Spans of so many scan lines.", max=MOST)] = None,
    max_memory: Annotated[
        str | None, _of(_SPANS, "Most memory, such as 256MB; means --span-width auto. [default with that: 512MB]")
    ] = None,
    spans: Annotated[int | None, _of(_SPANS, "Spans in a window. [default: 3]", max=MOST)] = None,
    overlap: Annotated[int | None, _of(_SPANS, "Spans that two windows share. [default: 1]", max=MOST)] = None,
    revisit: Annotated[
        bool,
        typer.Option(
            "--revisit",
            help="Look again at earlier points near each window, for clouds that come back to where they were.",
            rich_help_panel=_SPANS,
        ),
    ] = False,
    result: Annotated[Result, typer.Option(help="Which ids are written.")] = Result.final,
    history: Annotated[Path | None, typer.Option(help="Folder for the history of the run.")] = None,
    threads: Annotated[int | None, typer.Option(max=MOST, help="Windows at a time. [default: all cores]")] = None,
    preview: Annotated[Path | None, typer.Option(help="Also draw the result, as PNG.")] = None,
    drop_invalid: Annotated[
        bool, typer.Option("--drop-invalid", help="Give NaN and infinite points no segment instead of refusing them.")
    ] = False,
    overwrite: Overwrite = False,
    id_name: IdName = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No progress bar, no summary.")] = False,
) -> None:
    """Segment IN and write every point with its segment id to OUT."""
    choice = chosen(locals())
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
            **choice,
            history=history,
            result=result.value,
            overwrite=overwrite,
            id_name=id_name,
            on_read=bars.on_read,
            on_progress=bars.on_progress,
            on_write=bars.on_write,
            on_open=bars.on_open,
        )
    if not quiet:
        for sentence in summary.of_run(outcome, choice, output, history, result.value):
            typer.echo(sentence)
    left_out = outcome.left_out
    segments, has_more = outcome.segments + left_out.segments, left_out.points > 0
    odd_reach(outcome.points, segments, choice["segmentor"], has_more=has_more, quiet=quiet)
    if preview is not None:
        with _telling_that_only_the_picture_is_missing(output):
            draw_preview(output, preview, overwrite=overwrite, id_name=id_name)
        say(f"picture in {preview}", quiet)
    if outcome.damage is not None:
        raise typer.Exit(WRONG)


@contextlib.contextmanager
def _telling_what_is_left(output: Path) -> Iterator[None]:
    """On a failure, say whether the points before it are in the output."""
    before = _written_at(output)
    try:
        yield
    except OutputExists:
        raise  # what is there is another's
    except (Exception, KeyboardInterrupt) as failure:
        kept = _written_at(output) != before
        left = f"the points segmented before that are in {output}"
        if isinstance(failure, KeyboardInterrupt):
            why = str(failure) or "no window had been segmented yet"
            nothing = f"{output} has not been written, because {why}"
            raise KeyboardInterrupt(left if kept else nothing) from None
        if kept:
            typer.echo(f"streamseg: {left}", err=True)
        raise


@contextlib.contextmanager
def _telling_that_only_the_picture_is_missing(output: Path) -> Iterator[None]:
    try:
        yield
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"all points are in {output}, only the picture is missing") from None


def _written_at(output: Path) -> int | None:
    said = there(output)
    return None if said is None else said.st_mtime_ns
