"""Made-up surveys with the truth: which object each point is on.

An airborne strip over villages and a drive through a street, point by point in the order of acquisition, the same for
the same seed on every machine.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ._core import Scene
from .errors import MissingExtra
from .io.laz_threads import can_compress_in_threads
from .io.output import check_file, replacing
from .source import PathLike

Kind = Literal["airborne", "street"]

_CHUNK = 250_000
_SYSTEM, _SYSTEM_AT = "streamseg scene", 26


def columns(kind: Kind, points: int, seed: int = 1) -> dict[str, NDArray[Any]]:
    """Make the first points of a scene.

    Parameters
    ----------
    kind : {"airborne", "street"}
        A flight strip of about 9 points/m², 200 m wide; or a drive of about 5 000 points/m.
    points : int
        How many points.
    seed : int, default 1
        Which scene.

    Returns
    -------
    dict of (n,) arrays
        ``xyz`` (n, 3) float64 in metres, ``gps_time``, ``intensity``, ``return_number``, ``number_of_returns``,
        ``classification``, ``scan_direction_flag``, ``edge_of_flight_line``, and ``object_id``, the true object of each
        point: 1 is the ground, -1 noise.

    Examples
    --------
    >>> from streamseg import scenes
    >>> scenes.columns("street", 1000)["xyz"].shape
    (1000, 3)
    """
    taken = Scene(kind, seed).take(points)
    scale, offset = Scene.lattice()
    xyz = taken.pop("position") * np.asarray(scale) + np.asarray(offset)
    return {"xyz": xyz, **taken}


def spans(kind: Kind, points_per_span: int, seed: int = 1) -> Iterator[NDArray[np.float64]]:
    """Deliver a scene as a live source, (n, 3) float64 at a time, without end.

    Examples
    --------
    >>> from streamseg import scenes
    >>> next(scenes.spans("airborne", 500)).shape
    (500, 3)
    """
    scene = Scene(kind, seed)
    scale, offset = Scene.lattice()
    while True:
        yield scene.take(points_per_span)["position"] * np.asarray(scale) + np.asarray(offset)


def write(path: PathLike, kind: Kind, points: int, seed: int = 1) -> Path:
    """Write the first points of a scene as LAS or LAZ, chunk by chunk, ``object_id`` being an extra dimension.

    Parameters
    ----------
    path : path
        Ends in ``.las`` or ``.laz``. A scene that is there is replaced when the new one is whole; other
        files are not.
    kind, points, seed
        As for `columns`.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    OutputExists
        What is there is no scene.
    FileError
        It cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> from streamseg import scenes
    >>> scenes.write(f"{tempfile.mkdtemp()}/street.laz", "street", 1000).name
    'street.laz'
    """
    try:
        import laspy
    except ImportError:
        raise MissingExtra("writing LAS needs laspy; install it with: pip install 'laspy[lazrs]'") from None
    path = Path(path)
    check_file(path, (), overwrite=True, what="scene", foreign=_no_scene)
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales, header.offsets = (np.asarray(values) for values in Scene.lattice())
    header.add_extra_dim(laspy.ExtraBytesParams("object_id", np.int64, "true object, -1 = noise"))
    header.system_identifier = _SYSTEM
    header.generating_software = "streamseg"
    scene = Scene(kind, seed)
    is_compressed = path.suffix.lower() == ".laz"
    backend = laspy.LazBackend.LazrsParallel if can_compress_in_threads() else laspy.LazBackend.Lazrs
    with (
        replacing(path) as file,
        laspy.LasWriter(file, header, do_compress=is_compressed, laz_backend=backend, closefd=False) as writer,
    ):
        for start in range(0, points, _CHUNK):
            taken = scene.take(min(_CHUNK, points - start))
            position = taken.pop("position")
            record = laspy.ScaleAwarePointRecord.zeros(len(position), header=header)
            record.X, record.Y, record.Z = position.T
            for name, values in taken.items():
                record[name] = values
            writer.write_points(record)
    return path


def _no_scene(path: Path) -> str | None:
    """Say that a file is no scene; None if it is, or has no content, and may be replaced."""
    with open(path, "rb") as file:
        start = file.read(_SYSTEM_AT + len(_SYSTEM))
    is_scene = start[:4] == b"LASF" and start[_SYSTEM_AT:] == _SYSTEM.encode()
    return None if is_scene or not start else "no scene that streamseg has made"
