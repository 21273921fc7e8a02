"""What a cloud or a history holds, and how the cloud could be segmented, in a few lines for people."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ..history import MANIFEST, History
from ..io import open_cloud
from ..io.opening import is_folder
from ..source import PathLike
from .proposal import propose
from .sample import FEWEST, LONGEST, SHORTEST, Sampler
from .shape import shape_of
from .survey import Survey, surveyed
from .wording import of_facts, of_proposals, of_shape, reprojection


def describe(path: PathLike) -> Iterator[tuple[str, str]]:
    """Describe a file or the folder of a history.

    Yields
    ------
    str, str
        A label and what there is to say; reads the cloud once or twice, in bounded memory.

    Examples
    --------
    >>> import numpy as np, tempfile
    >>> from streamseg.description import describe
    >>> np.save(f"{tempfile.gettempdir()}/three.npy", np.eye(3))
    >>> dict(describe(f"{tempfile.gettempdir()}/three.npy"))["points"]
    '3'
    """
    path = Path(path)
    if is_folder(path) or path.name == MANIFEST:
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
    yield (
        "complete",
        "yes" if manifest["complete"] else "no: the run was stopped, interrupted, or its input damaged",
    )
    for name in ("points", "spans", "windows", "segment_ids"):
        yield name.replace("_", " "), f"{manifest[name]:,}"
    yield "promise", manifest["promise"]


def _of_cloud(path: Path) -> Iterator[tuple[str, str]]:
    cloud = open_cloud(path)
    sampler = Sampler()
    facts = surveyed(cloud, sampler)
    yield from of_facts(cloud, facts)
    if (advice := reprojection(path, facts)) is not None:
        yield from advice
    elif (blocks := sampler.blocks(cloud)) is not None:
        shape = shape_of(blocks, facts.extent)
        yield from of_shape(shape, facts)
        proposals = propose(blocks, shape)
        yield from of_proposals(path, proposals, is_whole=blocks.is_whole, drop_invalid=facts.invalid > 0)
    else:
        yield "no proposal", _too_little(facts)
    yield "dimensions", ", ".join(cloud.dimensions)


def _too_little(facts: Survey) -> str:
    if facts.points == facts.invalid:
        return "no point has finite coordinates"
    if not SHORTEST < facts.extent.max() < LONGEST and facts.extent.max() > 0:
        return f"the points reach {facts.extent.max():g} far, which is no length to measure with"
    return f"the points lie at fewer than {FEWEST} places, which tells too little"
