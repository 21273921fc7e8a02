"""A picture of a labelled cloud from above: which points went together, at a glance.

Points are drawn onto a raster in chunks, the highest point of each pixel wins. Segments that meet in the picture
get different colors: the graph of touching segments is colored greedily, largest segment first. Relief comes from
shading the heights as if lit from the north-west.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .errors import FileError, InvalidParameter, MissingExtra
from .io import open_cloud
from .io.raster import Floats, Ids, Raster, fill_gaps, rasterize, shifted, survey

Color = tuple[int, int, int]

NONE_COLOR: Color = (150, 150, 150)
PALETTE: tuple[Color, ...] = (
    (31, 119, 200), (255, 140, 26), (46, 160, 67), (214, 48, 49), (142, 90, 200), (140, 96, 70),
    (232, 110, 190), (188, 189, 34), (23, 190, 207), (255, 205, 60), (0, 110, 100), (130, 20, 60),
    (160, 205, 255), (150, 225, 140), (255, 165, 150), (60, 60, 160),
)  # fmt: skip

_NEAR_PIXELS = (1, 2, 4, 8)
_SMALLEST_SIZE = 200
_LEGEND_ENTRIES = 12
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


def preview(
    labelled: Path | str,
    out_png: Path | str,
    *,
    shade: Literal["segment", "height"] | None = "segment",
    size: int = 1600,
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

    Raises
    ------
    InvalidInput
        The file has no segment ids.
    InvalidParameter
        `size` or `shade` is not among the allowed values.
    MissingExtra
        Pillow is not installed.
    """
    if size < _SMALLEST_SIZE:
        raise InvalidParameter(f"size is {size}, must be {_SMALLEST_SIZE} or more pixels")
    if shade not in ("segment", "height", None):
        raise InvalidParameter(f"shade is {shade!r}, must be 'segment', 'height' or None")
    pillow = _pillow()
    labelled, out_png = Path(labelled), Path(out_png)
    found = survey(labelled)
    raster = fill_gaps(rasterize(labelled, found.low, found.high, size, panels=2 if shade == "height" else 1))
    sizes = dict(zip(found.ids.tolist(), found.counts.tolist(), strict=True))
    none = sizes.pop(-1, 0)
    colors = color_segments(raster.ids, raster.height > -np.inf, sizes)
    counts = dict(sorted(sizes.items(), key=lambda item: (-item[1], item[0])))
    result = Preview(found.points, counts, none, raster.outside, colors)
    page = _Page(pillow, raster, result, labelled.name, open_cloud(labelled).unit or "units", size)
    image = page.draw(shade)
    try:
        image.save(out_png, "PNG", optimize=True)
    except OSError as error:
        raise FileError(f"cannot write {out_png}: {error.strerror or error}") from error
    return result


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
    neighbors = _neighbors(index, shown)
    used = np.zeros(len(PALETTE), np.int64)
    chosen = np.full(len(shown), -1)
    area = np.bincount(index.ravel(), minlength=len(shown))
    for segment in sorted(range(len(shown)), key=lambda i: (-sizes.get(int(shown[i]), 0), int(shown[i]))):
        if shown[segment] < 0:
            continue
        around = chosen[neighbors[segment]]
        conflicts = np.bincount(around[around >= 0], minlength=len(PALETTE))
        # Among the colors without conflict the one seen least so far keeps the picture balanced.
        chosen[segment] = np.lexsort((used, conflicts))[0]
        used[chosen[segment]] += area[segment]
    return {int(shown[i]): PALETTE[chosen[i]] for i in range(len(shown)) if shown[i] >= 0}


def _neighbors(index: NDArray[np.intp], shown: Ids) -> list[NDArray[np.intp]]:
    """For each segment those that come within a few pixels of it."""
    keys = []
    for distance in _NEAR_PIXELS:
        for dy, dx in ((0, 1), (1, 0), (1, 1), (1, -1)):
            if distance >= min(index.shape) and distance > 1:
                continue
            one, other = shifted(index.shape, dy * distance, dx * distance)
            a, b = index[one], index[other]
            meet = (a != b) & (shown[a] >= 0) & (shown[b] >= 0)
            first, second = a[meet].astype(np.int64), b[meet].astype(np.int64)
            keys.append(np.unique(first * len(shown) + second))
            keys.append(np.unique(second * len(shown) + first))
    pairs = np.unique(np.concatenate(keys))
    first, second = np.divmod(pairs, len(shown))
    return np.split(second, np.searchsorted(first, np.arange(1, len(shown))))


class _Page:
    """Lays out title, panels, scale bar and legend; all lengths follow from the size of the picture."""

    def __init__(self, pillow: Any, raster: Raster, result: Preview, name: str, unit: str, size: int) -> None:
        self._pillow, self._raster, self._result, self._name, self._unit = pillow, raster, result, name, unit
        self._text = max(11, round(size / 64))
        self._gap = self._text

    def draw(self, shade: str | None) -> Any:
        """Draw everything."""
        text, gap, raster = self._text, self._gap, self._raster
        light = np.ones(raster.height.shape) if shade is None else _hillshade(raster)
        panels = [self._colored_by_segment(light)]
        low, high = _height_range(raster.height)
        if shade == "height":
            panels.append(self._colored_by_height(light, low, high))
        rows, columns = raster.height.shape
        drawn_columns = columns * len(panels) + 2 * gap * (len(panels) - 1)
        legend_width, legend_height = self._legend_size()
        is_wide = drawn_columns > 2.2 * rows
        width = max(drawn_columns + (0 if is_wide else legend_width + 2 * gap), 26 * text) + 2 * gap
        top, bottom = 3 * text + gap, 3 * text + gap
        height = top + (rows + legend_height + gap if is_wide else max(rows, legend_height)) + bottom
        image = self._pillow.Image.new("RGB", (width, height), _BACKGROUND)
        pen = self._pillow.ImageDraw.Draw(image)
        self._title(pen)
        for number, panel in enumerate(panels):
            image.paste(self._pillow.Image.fromarray(panel), (gap + number * (columns + 2 * gap), top))
        foot = top + rows + (legend_height + gap if is_wide else max(0, legend_height - rows)) + text
        self._scale_bar(pen, gap, foot)
        if shade == "height":
            self._height_bar(image, pen, gap + columns + 2 * gap, foot, low, high)
        self._legend(pen, *((gap, top + rows + gap) if is_wide else (drawn_columns + 3 * gap, top)))
        return image

    def _title(self, pen: Any) -> None:
        result, gap = self._result, self._gap
        font = self._font(1.35)
        pen.text((gap, gap), self._name, _INK, font)
        facts = f"{result.points:,} points, {len(result.counts):,} segments"
        pen.text(
            (gap + pen.textlength(self._name, font) + 2 * gap, gap + 0.3 * self._text), facts, _FAINT, self._font()
        )

    def _colored_by_segment(self, light: Floats) -> NDArray[np.uint8]:
        raster = self._raster
        shown, index = np.unique(raster.ids, return_inverse=True)
        table = np.array([self._result.colors.get(segment, NONE_COLOR) for segment in shown.tolist()], float)
        return _lit(table[index.reshape(raster.ids.shape)], light, raster.height)

    def _colored_by_height(self, light: Floats, low: float, high: float) -> NDArray[np.uint8]:
        height = np.where(self._raster.height > -np.inf, self._raster.height, low)
        return _lit(_height_colors((height - low) / (high - low)), light, self._raster.height)

    def _scale_bar(self, pen: Any, x: int, y: int) -> None:
        """A bar of a round length, about a fifth of the panel, and the axes."""
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

    def _height_bar(self, image: Any, pen: Any, x: int, y: int, low: float, high: float) -> None:
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

    def _legend_size(self) -> tuple[int, int]:
        return 13 * self._text, round(1.6 * self._text * (len(self._entries()) + 2.5))

    def _legend(self, pen: Any, x: int, y: int) -> None:
        text, font, small = self._text, self._font(), self._font(0.85)
        pen.text((x, y), "largest segments", _FAINT, small)
        right = x + 12 * text
        for label, at in (("id", x + 5 * text), ("points", right)):
            pen.text((at, y + 1.6 * text), label, _FAINT, small, anchor="ra")
        for row, (color, name, count) in enumerate(self._entries()):
            line = y + round(1.6 * text * (row + 2))
            pen.rectangle([x, line, x + text, line + text], color)
            pen.text((x + 5 * text, line), name, _INK, font, anchor="ra")
            pen.text((right, line), count, _INK, font, anchor="ra")

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
        raise MissingExtra("drawing a preview needs Pillow; install it: pip install streamseg[preview]") from error
    return _Pillow(Image, ImageDraw, ImageFont)


def round_length(length: float) -> float:
    """The largest of 1, 2, 5, 10, 20, … that is not above `length`."""
    power = 10.0 ** np.floor(np.log10(length))
    return float(max(step for step in (1, 2, 5) if step * power <= length * (1 + 1e-9)) * power)


def _hillshade(raster: Raster) -> Floats:
    """Brightness around 1 of the relief, lit from the north-west at 45°; (rows, columns) float64."""
    height = np.where(raster.height > -np.inf, raster.height, np.nan)
    low, high = _height_range(raster.height)
    # Flat scenes are exaggerated and steep ones calmed, so that both show relief.
    exaggeration = 0.06 * max(raster.height.shape) * raster.pixel / (high - low)
    slope_y, slope_x = (
        np.nan_to_num((after - before) / (2 * raster.pixel)) * min(exaggeration, 4.0)
        for before, after in _steps(height)
    )
    facing = (1 + slope_x * -0.7 + slope_y * -0.7) / np.sqrt(1 + slope_x**2 + slope_y**2) / np.sqrt(2)
    level = np.nan_to_num((np.clip(height, low, high) - low) / (high - low))
    lit: Floats = np.clip(0.35 + 0.75 * np.clip(facing, 0, 1.3) + 0.22 * (level - 0.4), 0.35, 1.25)
    return lit


def _steps(height: Floats) -> list[tuple[Floats, Floats]]:
    padded = np.pad(height, 1, mode="edge")
    return [(padded[:-2, 1:-1], padded[2:, 1:-1]), (padded[1:-1, :-2], padded[1:-1, 2:])]


def _height_range(height: Floats) -> tuple[float, float]:
    low, high = np.percentile(height[height > -np.inf], (1, 99))
    return (float(low), float(high)) if high > low else (float(low) - 0.5, float(high) + 0.5)


def _height_colors(level: Floats) -> Floats:
    """Colors of heights from 0 to 1; adds a last axis of 3."""
    stops = np.linspace(0, 1, len(_HEIGHT_COLORS))
    return np.stack([np.interp(level, stops, _HEIGHT_COLORS[:, band]) for band in range(3)], axis=-1)


def _lit(colors: Floats, light: Floats, height: Floats) -> NDArray[np.uint8]:
    above = np.clip(light - 1, 0, None)[..., None]
    colors = colors * np.minimum(light, 1)[..., None]
    colors += (255 - colors) * above
    colors[height == -np.inf] = _BACKGROUND
    return np.clip(colors, 0, 255).astype(np.uint8)
