"""The preview: neighbors differ in color, the legend counts right, and every cloud gives a picture."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from PIL import Image

from streamseg.errors import FileError, InvalidInput, InvalidParameter
from streamseg.io import open_cloud, write_labelled
from streamseg.preview import NONE_COLOR, PALETTE, color_segments, preview, round_length

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray


def write_points(path: Path, points: NDArray[np.float64], ids: NDArray[np.int64]) -> Path:
    table = np.column_stack((points, ids))
    np.savetxt(path, table, fmt=["%.6f", "%.6f", "%.6f", "%d"], header="x y z SegmentID", comments="")
    return path


def checkerboard(path: Path, side: int = 8) -> Path:
    """Flat squares of 10 × 10 points side by side, numbered from 1; the first is no segment."""
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(side * 10), np.arange(side * 10)))
    ids = x // 10 + y // 10 * side
    return write_points(path, np.column_stack((x, y, np.zeros(len(x)))), np.where(ids == 0, -1, ids))


def pixels(path: Path) -> NDArray[np.uint8]:
    with Image.open(path) as image:
        assert image.format == "PNG"
        return np.asarray(image.convert("RGB"))


def has_color(image: NDArray[np.uint8], color: tuple[int, int, int]) -> bool:
    return bool((image == np.array(color)).all(axis=-1).any())


def test_squares_that_touch_have_different_colors(tmp_path: Path) -> None:
    result = preview(checkerboard(tmp_path / "a.txt"), tmp_path / "a.png", shade=None, size=400)
    for square in range(1, 64):
        for other in (square + 1, square + 7, square + 8, square + 9):
            if other < 64 and abs(square % 8 - other % 8) <= 1:
                assert result.colors[square] != result.colors[other]
    image = pixels(tmp_path / "a.png")
    assert all(has_color(image, color) for color in set(result.colors.values()))
    assert has_color(image, NONE_COLOR)


def test_counts_are_those_of_the_file(tmp_path: Path) -> None:
    result = preview(checkerboard(tmp_path / "a.txt"), tmp_path / "a.png", size=300)
    assert result.points == 6400
    assert result.none == 100
    assert result.counts == dict.fromkeys(range(1, 64), 100)
    assert result.outside == 0


def test_the_picture_shows_each_segment_where_it_is(tmp_path: Path) -> None:
    """North is up: the last row of squares is at the top."""
    result = preview(checkerboard(tmp_path / "a.txt"), tmp_path / "a.png", shade=None, size=400)
    image = pixels(tmp_path / "a.png")
    drawn = (image != 255).any(axis=-1)
    for square, (row, column) in {56: (0, 0), 63: (0, 7), 7: (7, 7)}.items():
        same = (image == np.array(result.colors[square])).all(axis=-1)
        assert same.any(), square
        # The panel starts below the title, at the left margin, and is 400 pixels wide.
        top, left = 44, 11
        at = (top + row * 50 + 25, left + column * 50 + 25)
        assert drawn[at]
        assert same[at], square


def test_the_highest_point_of_a_pixel_wins(tmp_path: Path) -> None:
    points = np.array([[0.0, 0, 0], [1, 1, 0], [0.5, 0.5, 1], [0.5, 0.5, 9], [0.5, 0.5, 3]])
    result = preview(
        write_points(tmp_path / "a.txt", points, np.array([1, 2, 3, 4, 5])), tmp_path / "a.png", shade=None, size=200
    )
    assert 4 in result.colors
    assert 3 not in result.colors
    assert 5 not in result.colors
    assert result.counts == {1: 1, 2: 1, 3: 1, 4: 1, 5: 1}


def test_more_segments_around_one_than_colors(tmp_path: Path) -> None:
    ids = np.zeros((9, 9 * 40), np.int64)
    ids[0:4] = np.repeat(np.arange(2, 42), 9)
    ids[4:] = 1
    colors = color_segments(ids, np.ones(ids.shape, bool), {1: 100, **dict.fromkeys(range(2, 42), 9)})
    assert set(colors) == set(range(1, 42))
    assert all(colors[upper] != colors[1] for upper in range(2, 42))
    assert all(colors[upper] != colors[upper + 1] for upper in range(2, 41))
    assert set(colors.values()) <= set(PALETTE)


def test_far_outliers_are_left_out_and_counted(tmp_path: Path) -> None:
    points = np.random.default_rng(4).random((5000, 3)) * 100
    points[:3, :2] = [[1e6, 0], [0, -1e6], [5e5, 5e5]]
    ids = np.ones(5000, np.int64)
    result = preview(write_points(tmp_path / "a.txt", points, ids), tmp_path / "a.png", size=300)
    assert result.outside >= 3
    assert result.outside < 60
    assert result.counts == {1: 5000}
    image = pixels(tmp_path / "a.png")
    assert (image[44:344, 11:311] != 255).any(axis=-1).mean() > 0.8


@pytest.mark.parametrize("shade", ["segment", "height", None])
@pytest.mark.parametrize(
    "points",
    [
        np.zeros((1, 3)),
        np.array([[0.0, 0, 0], [1, 0, 0]]),
        np.array([[0.0, 0, 0], [0, 1000, 5]]),
        np.array([[5e5, 5e6, 100.0]] * 20),
    ],
    ids=["one", "row", "column", "equal"],
)
@pytest.mark.parametrize("segment", [-1, 3])
def test_tiny_clouds_give_a_picture(
    tmp_path: Path, points: NDArray[np.float64], shade: str | None, segment: int
) -> None:
    path = write_points(tmp_path / "a.txt", points, np.full(len(points), segment))
    result = preview(path, tmp_path / "a.png", shade=shade, size=200)  # type: ignore[arg-type]
    assert result.counts == ({} if segment == -1 else {3: len(points)})
    assert result.none == (len(points) if segment == -1 else 0)
    if shade is None:
        assert has_color(pixels(tmp_path / "a.png"), NONE_COLOR if segment == -1 else result.colors[3])


def test_a_height_panel_stands_beside_the_first(tmp_path: Path) -> None:
    path = checkerboard(tmp_path / "a.txt")
    preview(path, tmp_path / "one.png", size=400)
    preview(path, tmp_path / "two.png", shade="height", size=800)
    one, two = pixels(tmp_path / "one.png"), pixels(tmp_path / "two.png")
    assert two.shape[1] > two.shape[0]
    assert two.shape[1] > one.shape[1]


class Stripes:
    def read(self, start: int, stop: int) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        return np.arange(start, stop) // 5000 - 1, np.ones(stop - start, np.bool_)


@pytest.mark.parametrize("name", ["isprs/CSite3", "als/autzen_trim", "als/lidarhd_77050_627755"])
def test_real_clouds_give_a_picture(data: Path, tmp_path: Path, name: str) -> None:
    cloud = open_cloud(data / f"{name}.laz")
    count = write_labelled(cloud, tmp_path / "a.laz", Stripes())
    result = preview(tmp_path / "a.laz", tmp_path / "a.png", size=600)
    ids, counts = np.unique(Stripes().read(0, count)[0], return_counts=True)
    expected = dict(zip(ids.tolist(), counts.tolist(), strict=True))
    assert result.none == expected.pop(-1)
    assert result.counts == expected
    assert pixels(tmp_path / "a.png").std() > 30


def test_wrong_arguments_are_refused(tmp_path: Path) -> None:
    path = checkerboard(tmp_path / "a.txt", 2)
    with pytest.raises(InvalidParameter, match="size is 10, must be 200 to 20000 pixels"):
        preview(path, tmp_path / "a.png", size=10)
    with pytest.raises(InvalidParameter, match="shade is 'sun', must be"):
        preview(path, tmp_path / "a.png", shade="sun")  # type: ignore[arg-type]
    with pytest.raises(FileError, match="cannot write"):
        preview(path, tmp_path / "nowhere" / "a.png")
    np.save(tmp_path / "b.npy", np.zeros((3, 3)))
    with pytest.raises(InvalidInput, match="holds no SegmentID"):
        preview(tmp_path / "b.npy", tmp_path / "a.png")


@pytest.mark.parametrize(
    ("length", "rounded"), [(1.0, 1.0), (1.99, 1.0), (2.0, 2.0), (49.9, 20.0), (50.0, 50.0), (0.07, 0.05), (999, 500)]
)
def test_scale_bars_have_round_lengths(length: float, rounded: float) -> None:
    assert round_length(length) == pytest.approx(rounded)
