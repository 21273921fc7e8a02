"""What a cloud or a history holds, in a few lines for people."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from .history import MANIFEST, History
from .io import open_cloud
from .source import PathLike

# Points per reach at which a proximity segmentation mostly keeps surfaces together.
_SPACINGS_PER_DISTANCE = 2.5


def describe(path: PathLike) -> Iterator[tuple[str, str]]:
    """Describe a file or the folder of a history.

    Yields
    ------
    str, str
        A label and what there is to say; reads the cloud once, in bounded memory.

    Examples
    --------
    >>> import numpy as np, tempfile
    >>> from streamseg.description import describe
    >>> np.save(f"{tempfile.gettempdir()}/three.npy", np.eye(3))
    >>> dict(describe(f"{tempfile.gettempdir()}/three.npy"))["points"]
    '3'
    """
    path = Path(path)
    if path.is_dir() or path.name == MANIFEST:
        yield from _of_history(path.parent if path.name == MANIFEST else path)
    else:
        yield from _of_cloud(path)


def _of_history(folder: Path) -> Iterator[tuple[str, str]]:
    for label, value in _of_manifest(History(folder).manifest):
        yield _printable(label), _printable(str(value))


def _printable(text: str) -> str:
    """Escape what is no text, as names of files may be."""
    return text.encode("utf-8", "backslashreplace").decode()


def _of_manifest(manifest: dict[str, Any]) -> Iterator[tuple[str, object]]:
    yield "history of", manifest["source"]
    parameters = dict(manifest["parameters"])
    least, most, sort = (parameters.pop(name, None) for name in ("min_segment_size", "max_segment_size", "sort"))
    yield from parameters.items()
    if least is not None:
        limits = f"at least {least}" if most is None else f"{least} to {most}"
        yield "sizes", f"{limits} points, in {sort} order"
    yield "complete", "yes" if manifest["complete"] else "no: the run was stopped, interrupted, or its input damaged"
    for name in ("points", "spans", "windows", "segment_ids"):
        yield name.replace("_", " "), f"{manifest[name]:,}"
    yield "promise", manifest["promise"]


def _of_cloud(path: Path) -> Iterator[tuple[str, str]]:
    cloud = open_cloud(path)
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    points = invalid = 0
    steps = np.zeros(2, np.int64)
    last: np.ndarray | None = None
    for chunk in cloud.chunks():
        real = cloud.lattice.to_coordinates(chunk.points)
        real = real[np.isfinite(real).all(axis=1)]
        points += len(chunk.points)
        invalid += len(chunk.points) - len(real)
        if not len(real):
            continue
        low, high = np.minimum(low, real.min(axis=0)), np.maximum(high, real.max(axis=0))
        sequence = real[:, :2] if last is None else np.vstack([last, real[:, :2]])
        steps += (np.diff(sequence, axis=0) < 0).sum(axis=0)
        last = real[-1:, :2]
    yield "points", f"{points:,}"
    if cloud.damage:
        yield "damage", cloud.damage
    if invalid:
        yield "invalid", f"{invalid:,} points have no finite coordinates; --drop-invalid gives them no segment"
    if not cloud.lattice.is_identity:
        yield (
            "lattice",
            "scale {:g} {:g} {:g}, offset {:g} {:g} {:g}".format(*cloud.lattice.scale, *cloud.lattice.offset),
        )
    if points and np.isfinite(low).all():
        for axis, least, most in zip("xyz", low, high, strict=True):
            yield axis, f"{least:.3f} to {most:.3f}, extent {most - least:.3f}"
        sorted_along = [axis for axis, back in zip("xy", steps, strict=True) if back == 0]
        yield "order", f"sorted along {' and '.join(sorted_along)}" if sorted_along else "sorted along neither x nor y"
        yield from _suggestion(path, points, high - low)
    yield "dimensions", ", ".join(cloud.dimensions)


def _suggestion(path: Path, points: int, extent: np.ndarray) -> Iterator[tuple[str, str]]:
    area = float(extent[0] * extent[1])
    if area <= 0:
        return
    spacing = (area / points) ** 0.5
    yield "density", f"{points / area:.3g} points per square unit of the bounding box, spacing about {spacing:.2g}"
    distance = float(f"{_SPACINGS_PER_DISTANCE * spacing:.1g}")
    yield "try", f"streamseg segment {path} OUT{path.suffix} --distance {distance:g} --span-width {20 * distance:g}"
