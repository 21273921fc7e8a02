"""A picture of a labelled cloud from above: which points went together, at a glance.

Points are drawn onto a raster in chunks, the highest point of each pixel wins. Segments that meet in the picture
get different colors: the graph of touching segments is colored greedily, largest segment first. Relief comes from
shading the heights as if lit from the north-west.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from .errors import InvalidParameter, MissingExtra
from .io import open_cloud
from .io.earlier import PICTURE_SIGN, foreign_picture
from .io.opening import real
from .io.output import check_file, replacing
from .io.raster import Floats, Ids, Raster, fill_gaps, height_range, hillshade, rasterize, survey, touching

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

Color = tuple[int, int, int]

NONE_COLOR: Color = (186, 188, 191)
PALETTE: tuple[Color, ...] = (
    (31, 119, 200), (255, 140, 26), (46, 160, 67), (214, 48, 49), (142, 90, 200), (140, 96, 70),
    (232, 110, 190), (188, 189, 34), (23, 190, 207), (255, 205, 60), (0, 110, 100), (130, 20, 60),
    (160, 205, 255), (150, 225, 140), (255, 165, 150), (60, 60, 160),
)  # fmt: skip

_SMALLEST_SIZE, _LARGEST_SIZE = 200, 20_000
_LEGEND_ENTRIES = 12
_LEGEND_WIDTH = 13  # times the size of the text
_LINE = 1.6
_WIDE = 1.7
_BACKGROUND: Color = (255, 255, 255)
_INK: Color = (35, 38, 43)
_FAINT: Color = (110, 115, 122)
# Heights from low to high: deep blue, teal, green, yellow, near white; brightness rises all the way.
_HEIGHT_COLORS = np.array(
    [(38, 34, 98), (44, 85, 145), (32, 135, 142), (64, 175, 110), (150, 205, 70), (245, 230, 60), (255, 250, 205)]
)


class Preview(NamedTuple):
    """What the picture shows.

    points : number of points in the file
    counts : segment id → number of points, largest segment first, without −1
    none : number of points in no segment
    outside : number of points beyond the edge of the picture
    colors : segment id → color, for the segments that can be seen
    """

    points: int
    counts: dict[int, int]
    none: int
    outside: int
    colors: dict[int, Color]


def check_preview(out_png: Path | str, overwrite: bool, others: Sequence[Path | str] = ()) -> None:
    """Refuse a picture that cannot or must not be drawn, before any work is done; `others` must not be drawn over."""
    _pillow()
    out_png = Path(out_png)
    if out_png.suffix.lower() != ".png":
        raise InvalidParameter(f"picture {out_png} ends in {out_png.suffix!r}, must end in .png")
    if any(real(out_png) == real(other) for other in others):
        raise InvalidParameter(f"picture {out_png} is also the name of a cloud; give the picture another name")
    check_file(out_png, [], overwrite, "picture", foreign_picture)


def preview(
    labelled: Path | str,
    out_png: Path | str,
    *,
    shade: Literal["segment", "height"] | None = "segment",
    size: int = 1600,
    overwrite: bool = False,
    id_name: str | None = None,
) -> Preview:
    """Draw a labelled file from above as PNG, in bounded memory.

    Neighboring segments have different colors, points in no segment are gray. A color is used for many segments
    that do not touch. Points far outside the bulk of the cloud are left out of the frame and counted in a footnote.

    Parameters
    ----------
    labelled : Path or str
        LAS, LAZ or text with ``SegmentID``, e.g. written by `streamseg.io.write_labelled`.
    out_png : Path or str
    shade : "segment", "height" or None
        "segment": segment colors, shaded by the relief. "height": the same, and beside it a second panel colored
        by height. None: plain segment colors.
    size : int
        Longest side of the drawing in pixels, at least 200; title and legend come on top.
    overwrite : bool
        Whether `out_png` may replace a file that is there.
    id_name : str, default "SegmentID"
        What the dimension or column of ids is called.

    Raises
    ------
    InvalidInput
        The file has no segment ids.
    InvalidParameter
        `size` or `shade` is not among the allowed values.
    OutputExists
        `out_png` is there and `overwrite` is False.
    MissingExtra
        Pillow is not installed.
    """
    if not _SMALLEST_SIZE <= size <= _LARGEST_SIZE:
        raise InvalidParameter(f"size is {size}, must be {_SMALLEST_SIZE} to {_LARGEST_SIZE} pixels")
    if shade not in ("segment", "height", None):
        raise InvalidParameter(f"shade is {shade!r}, must be 'segment', 'height' or None")
    check_preview(out_png, overwrite, [labelled])
    labelled, out_png = Path(labelled), Path(out_png)
    found = survey(labelled, id_name)
    raster = fill_gaps(
        rasterize(labelled, found.low, found.high, size, panels=2 if shade == "height" else 1, id_name=id_name)
    )
    sizes = dict(zip(found.ids.tolist(), found.counts.tolist(), strict=True))
    none = sizes.pop(-1, 0)
    colors = color_segments(raster.ids, raster.height > -np.inf, sizes)
    counts = dict(sorted(sizes.items(), key=lambda item: (-item[1], item[0])))
    result = Preview(found.points, counts, none, raster.outside, colors)
    image = _Page(raster, result, labelled, size).draw(shade)
    with replacing(out_png, overwrite=overwrite) as file:
        image.save(file, "PNG", optimize=True, pnginfo=_signed())
    return result


def _signed() -> Any:
    """Say in the file who has drawn it, so that it may be drawn again."""
    from PIL.PngImagePlugin import PngInfo

    info = PngInfo()
    info.add_text(*PICTURE_SIGN)
    return info


def color_segments(ids: Ids, drawn: NDArray[np.bool_], sizes: dict[int, int]) -> dict[int, Color]:
    """Give each segment in the picture a color that no segment next to it has.

    Parameters
    ----------
    ids : (rows, columns) int64
        Segment per pixel; −1 = none.
    drawn : (rows, columns) bool
        Where there is a point.
    sizes : segment id → number of points

    Returns
    -------
    segment id → color; where more segments meet than there are colors, the color that its neighbors use least.
    """
    shown, index = np.unique(np.where(drawn, ids, -1), return_inverse=True)
    index = index.reshape(ids.shape)
    neighbors = touching(index, shown)
    area = np.bincount(index.ravel(), minlength=len(shown)).tolist()
    used = [0] * len(PALETTE)
    chosen = [-1] * len(shown)
    by_size = sorted(range(len(shown)), key=lambda i: (-sizes.get(int(shown[i]), 0), int(shown[i])))
    # Plain lists: there may be hundreds of thousands of segments, each with a handful of neighbors.
    for segment in by_size:
        if shown[segment] < 0:
            continue
        conflicts = [0] * len(PALETTE)
        for neighbor in neighbors[segment].tolist():
            if chosen[neighbor] >= 0:
                conflicts[chosen[neighbor]] += 1
        # Among the colors without conflict the one seen least so far keeps the picture balanced.
        chosen[segment] = min(range(len(PALETTE)), key=lambda color: (conflicts[color], used[color]))
        used[chosen[segment]] += area[segment]
    return {int(shown[i]): PALETTE[chosen[i]] for i in range(len(shown)) if shown[i] >= 0}


class _Page:
    """Lays out title, panels, scale bar and legend; all lengths follow from the size of the picture."""

    def __init__(self, raster: Raster, result: Preview, labelled: Path, size: int) -> None:
        self._pillow, self._raster, self._result, self._name = _pillow(), raster, result, labelled.name
        self._unit = open_cloud(labelled).unit or "units"
        self._text = max(11, round(size / 64))
        self._gap = self._text

    def draw(self, shade: str | None) -> Any:
        """Draw everything."""
        text, gap, raster = self._text, self._gap, self._raster
        light = np.ones(raster.height.shape, np.float32) if shade is None else hillshade(raster)
        panels = [self._colored_by_segment(light)]
        low, high = height_range(raster.height)
        if shade == "height":
            panels.append(self._colored_by_height(light, low, high))
        rows, columns = raster.height.shape
        drawn = columns * len(panels) + 2 * gap * (len(panels) - 1)
        is_wide = drawn > _WIDE * rows
        legend = self._legend_columns(drawn if is_wide else 0)
        legend_height = round(_LINE * text * (max(map(len, legend)) + 2))
        width = max(drawn if is_wide else drawn + 2 * gap + _LEGEND_WIDTH * text, 26 * text) + 2 * gap
        top, foot_height = 3 * text + gap, 3 * text + gap
        foot = top + (rows if is_wide else max(rows, legend_height)) + gap
        height = foot + foot_height + (legend_height + gap if is_wide else 0)
        image = self._pillow.Image.new("RGB", (width, height), _BACKGROUND)
        pen = self._pillow.ImageDraw.Draw(image)
        self._title(pen)
        for number, panel in enumerate(panels):
            image.paste(self._pillow.Image.fromarray(panel), (gap + number * (columns + 2 * gap), top))
        self._scale_bar(pen, gap, foot)
        if shade == "height":
            self._height_bar(image, (columns + 3 * gap, foot), (low, high))
        self._legend(pen, (gap, foot + foot_height) if is_wide else (drawn + 3 * gap, top), legend)
        return image

    def _title(self, pen: Any) -> None:
        result, gap = self._result, self._gap
        font = self._font(1.35)
        pen.text((gap, gap), self._name, _INK, font)
        facts = f"{result.points:,} points, {len(result.counts):,} segments"
        pen.text(
            (gap + pen.textlength(self._name, font) + 2 * gap, gap + 0.3 * self._text), facts, _FAINT, self._font()
        )

    def _colored_by_segment(self, light: NDArray[np.float32]) -> NDArray[np.uint8]:
        raster = self._raster
        shown, index = np.unique(raster.ids, return_inverse=True)
        table = np.array([self._result.colors.get(segment, NONE_COLOR) for segment in shown.tolist()], float)
        return _lit((table[row] for row in index.reshape(raster.ids.shape)), light, raster.height)

    def _colored_by_height(self, light: NDArray[np.float32], low: float, high: float) -> NDArray[np.uint8]:
        height = self._raster.height
        return _lit((_height_colors((row.clip(low, high) - low) / (high - low)) for row in height), light, height)

    def _scale_bar(self, pen: Any, x: int, y: int) -> None:
        """Draw a bar of a round length, about a quarter of the panel, and the axes."""
        text, pixel = self._text, self._raster.pixel
        axes = self._font(0.85)
        pen.line([(x, y - text // 2), (x, y + text), (x + 1.5 * text, y + text)], _INK, max(1, text // 10))
        pen.text((x + 1.7 * text, y + 0.45 * text), "x", _FAINT, axes)
        pen.text((x + 0.3 * text, y - 0.8 * text), "y", _FAINT, axes)
        length = round_length(self._raster.height.shape[1] * pixel / 4)
        start, end = x + 4 * text, x + 4 * text + length / pixel
        pen.rectangle([start, y + 0.55 * text, end, y + 0.55 * text + max(2, text // 5)], _INK)
        pen.text((end + text / 2, y), f"{length:g} {self._unit}", _INK, self._font())
        if self._result.outside:
            note = f"{self._result.outside:,} points outside the frame"
            pen.text((x + 4 * text, y + 1.2 * text), note, _FAINT, axes)

    def _height_bar(self, image: Any, corner: tuple[int, int], heights: tuple[float, float]) -> None:
        (x, y), (low, high) = corner, heights
        pen = self._pillow.ImageDraw.Draw(image)
        text, width = self._text, min(14 * self._text, self._raster.height.shape[1] // 2)
        strip = np.repeat(_height_colors(np.linspace(0, 1, width))[None], max(2, text // 2), axis=0)
        digits = max(0, 1 - int(np.floor(np.log10(high - low))))
        label = f"{low:.{digits}f}"
        pen.text((x, y), label, _INK, self._font())
        bar_x = round(x + pen.textlength(label, self._font()) + text / 2)
        image.paste(self._pillow.Image.fromarray(strip.astype(np.uint8)), (bar_x, y + text // 2))
        pen.text((bar_x + width + text / 2, y), f"{high:.{digits}f} height", _INK, self._font())

    def _entries(self) -> list[tuple[Color, str, str]]:
        result = self._result
        largest = [
            (result.colors[segment], str(segment), f"{count:,}")
            for segment, count in result.counts.items()
            if segment in result.colors
        ][:_LEGEND_ENTRIES]
        return [*largest, *([(NONE_COLOR, "none", f"{result.none:,}")] if result.none else [])]

    def _legend_columns(self, width: int) -> list[list[tuple[Color, str, str]]]:
        """Spread the entries over as many columns as `width` has room for."""
        entries = self._entries()
        rows = -(-len(entries) // max(1, (width + 2 * self._text) // ((_LEGEND_WIDTH + 2) * self._text)))
        return [entries[start : start + rows] for start in range(0, len(entries), rows)]

    def _legend(self, pen: Any, corner: tuple[int, int], columns: list[list[tuple[Color, str, str]]]) -> None:
        text, (x, y), small = self._text, corner, self._font(0.85)
        pen.text((x, y), "largest segments", _FAINT, small)
        for entries in columns:
            right = x + (_LEGEND_WIDTH - 1) * text
            for label, at in (("id", x + 5 * text), ("points", right)):
                pen.text((at, y + 1.6 * text), label, _FAINT, small, anchor="ra")
            for row, (color, name, count) in enumerate(entries):
                line = y + round(_LINE * text * (row + 2))
                pen.rectangle([x, line, x + text, line + text], color)
                pen.text((x + 5 * text, line), name, _INK, self._font(), anchor="ra")
                pen.text((right, line), count, _INK, self._font(), anchor="ra")
            x += (_LEGEND_WIDTH + 2) * text

    def _font(self, scale: float = 1.0) -> Any:
        return self._pillow.ImageFont.load_default(round(self._text * scale))


class _Pillow(NamedTuple):
    Image: Any
    ImageDraw: Any
    ImageFont: Any


def _pillow() -> _Pillow:
    try:
        from PIL import Image, ImageDraw, ImageFont
    except ImportError as error:
        raise MissingExtra("drawing a preview needs Pillow; install it: pip install 'streamseg[preview]'") from error
    return _Pillow(Image, ImageDraw, ImageFont)


def round_length(length: float) -> float:
    """Find the largest of 1, 2, 5, 10, 20, … that is not above `length`."""
    power = 10.0 ** np.floor(np.log10(length))
    return float(max(step for step in (1, 2, 5) if step * power <= length * (1 + 1e-9)) * power)


def _height_colors(level: Floats) -> Floats:
    """Colors of heights from 0 to 1; adds a last axis of 3."""
    stops = np.linspace(0, 1, len(_HEIGHT_COLORS))
    return np.stack([np.interp(level, stops, _HEIGHT_COLORS[:, band]) for band in range(3)], axis=-1)


def _lit(rows: Iterable[Floats], light: NDArray[np.float32], height: Floats) -> NDArray[np.uint8]:
    """Light the colors, row by row because in floating point they take eight times the memory."""
    lit = np.empty((*height.shape, 3), np.uint8)
    for target, colors, brightness, heights in zip(lit, rows, light, height, strict=True):
        shown = colors * np.minimum(brightness, 1)[:, None]
        shown += (255 - shown) * np.clip(brightness - 1, 0, None)[:, None]
        shown[heights == -np.inf] = _BACKGROUND
        target[:] = np.clip(shown, 0, 255)
    return lit
