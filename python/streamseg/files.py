"""From file to file: segment a cloud and write every point with its segment id."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ._core import Window
from .callbacks import callback
from .certificate import Certificate
from .cutting import Spans
from .errors import InvalidInput, InvalidParameter, InvalidType, warn
from .history import History
from .io import Cloud, LabelSpool, check_kind, check_output, open_cloud, write_labelled
from .io.opening import real, there
from .plan import MaxMemory, Stages
from .run import stream
from .source import PathLike, counted, open_source
from .stream import PATIENCE, LeftOut, Progress, Result, Stream
from .unlabelled import Unlabelled

_WHILE_WRITING = "it was interrupted while it was being written"


class Outcome(NamedTuple):
    """What a run from file to file came to."""

    points: int
    """Points written, each with its segment id."""
    windows: int
    """Windows woven."""
    segments: int
    """Segments they are in; raw ids with ``result="history"``."""
    left_out: LeftOut
    """What the limits of the segmentor leave out (``result="final"``)."""
    aliases: int
    """Ids handed out that have become another's (``result="carry"``)."""
    promise: str
    """How the result relates to the static one."""
    certificate: Certificate
    """What the run could prove."""
    is_proven: bool
    """Whether it could prove that it is the static result."""
    damage: str | None
    """What could not be read, if the input is damaged; what came before it is in the output."""
    unlabelled: Unlabelled
    """How many of the points written have no segment, by cause."""
    left_out_by_cause: dict[str, LeftOut]
    """What the limits leave out, by cause: "no_seed", "too_small" and "too_large"."""


class Resolved(NamedTuple):
    """What the resolution of a history came to."""

    points: int
    """Points written."""
    segments: int
    """Segments they are in."""
    without: int
    """Points written that have no segment."""
    unlabelled: Unlabelled
    """Why, as far as the history tells: it adds up to less if the history is of an earlier version, or ends early."""
    left_out_by_cause: dict[str, LeftOut]
    """What the limits leave out, by cause."""


def segment_file(
    inputs: PathLike | Sequence[PathLike],
    output: PathLike,
    segmentor: Any,
    *,
    spans: Spans | None = None,
    window: Window | None = None,
    max_memory: MaxMemory | None = None,
    history: PathLike | None = None,
    result: Result = "final",
    threads: int | None = None,
    drop_invalid: bool = False,
    preprocess: Stages = (),
    revisit: bool = False,
    overwrite: bool = False,
    id_name: str | None = None,
    on_open: Callable[[int | None], None] | None = None,
    on_read: Callable[[int], None] | None = None,
    on_progress: Callable[[Progress], None] | None = None,
    on_write: Callable[[int], None] | None = None,
) -> Outcome:
    """Segment one or more files as one stream and write each point, in input order, with its segment id.

    Parameters
    ----------
    inputs : path or sequence of paths
        LAS, LAZ, NumPy or text, all of one kind.
    output : path
        LAS or LAZ keeps every dimension of the input and adds ``SegmentID``; see `streamseg.io.write_labelled`.
    segmentor, spans, window, max_memory, history, threads, drop_invalid, preprocess, revisit
        As for `stream`.
    result : {"final", "carry", "history"}, default "final"
        Which ids are written.
    overwrite : bool, default False
        Replace an output and a history that are already there.
    id_name : str, default "SegmentID"
        What the dimension or column of ids is called; others are kept as they are.
    on_open, on_read, on_progress, on_write : functions, optional
        Called with the number of points that the input announces, the points read so far, the `Progress`, and the
        points written so far.

    Returns
    -------
    Outcome
        Also of a damaged input: the points before the damage are segmented and written, and ``damage`` says which.

    Raises
    ------
    FileError, OutputExists, InvalidInput, InvalidParameter
        Before any work is done, where that can be known. Later, if the output cannot be written, the input has changed
        since it was opened, or temporary files have gone. Then nothing is written.
    Exception
        What ends the run early, a KeyboardInterrupt too. First the points that were segmented so far are written. A
        failure while that is done is told in a warning.

    Examples
    --------
    >>> import numpy as np, streamseg as ss, tempfile
    >>> folder = tempfile.mkdtemp()
    >>> np.savetxt(f"{folder}/in.xyz", np.zeros((5, 3)))
    >>> ss.segment_file(f"{folder}/in.xyz", f"{folder}/out.xyz", ss.Proximity(1.0)).points
    5
    """
    paths, output = _as_paths(inputs), Path(output)
    check_output(output, paths, overwrite, id_name)
    is_new_history = history is not None and there(Path(history)) is None
    if history is not None:
        _check_apart(Path(history), output)
    cloud = open_cloud(paths)
    check_kind(cloud, output, id_name)
    callback("on_open", on_open)(cloud.point_count)
    interrupt = _Interrupt()
    source = open_source(cloud)
    with interrupt, LabelSpool() as labels:
        run = stream(
            counted(source, _checking(interrupt.check, callback("on_read", on_read))),
            segmentor,
            spans=spans,
            window=window,
            max_memory=max_memory,
            history=history,
            result=result,
            threads=threads,
            drop_invalid=drop_invalid,
            preprocess=preprocess,
            revisit=revisit,
            overwrite=overwrite,
            on_progress=_checking(interrupt.check, callback("on_progress", on_progress)),
            with_points=False,
        )
        if is_new_history:
            run.discard_empty_history()
        aliases = 0
        failure: BaseException | None = None
        later_failure: Exception | None = None
        with run:
            try:
                aliases += _label(run, labels)
            except (Exception, KeyboardInterrupt) as early:
                failure = early
                interrupt.disarm()
                run.stop(None if isinstance(early, Exception) else PATIENCE)
                try:
                    aliases += _label(run, labels)
                except Exception as another:
                    later_failure = another
        progress, left_out = run.progress, run.left_out
        if failure is not None and not labels.has_any:
            raise failure
        with interrupt.deferred():
            on_written = callback("on_write", on_write)
            points = write_labelled(
                cloud,
                output,
                labels,
                overwrite=overwrite,
                id_name=id_name,
                expected=labels.count,
                may_end_early=True,
                progress=on_written,
            )
    if later_failure is not None and str(later_failure) != str(failure):
        warn(f"some of what was segmented is not in {output}: after the first failure came another: {later_failure}")
    if failure is not None:
        raise failure
    segments = progress.segment_ids if result == "history" else progress.segments
    return Outcome(
        points,
        progress.windows,
        segments,
        left_out,
        aliases,
        run.promise,
        run.certificate,
        run.is_proven,
        cloud.damage,
        _of_written(run.unlabelled, progress.points - points),
        run.left_out_by_cause,
    )


def _of_written(unlabelled: Unlabelled, unwritten: int) -> Unlabelled:
    """Leave out the points that came out and were not written: LAS cannot hold coordinates that are not finite."""
    return unlabelled._replace(invalid=max(unlabelled.invalid - unwritten, 0))


def _as_paths(inputs: PathLike | Sequence[PathLike]) -> list[Path]:
    paths = [inputs] if isinstance(inputs, (str, Path)) else inputs
    if not isinstance(paths, (list, tuple)) or not all(isinstance(path, (str, Path)) for path in paths):
        raise InvalidType(f"inputs is {type(inputs).__name__}, allowed: a path or several; for an array use segment")
    return [Path(path) for path in paths]


def _check_apart(history: Path, output: Path) -> None:
    """Refuse an output that is the folder of the history, or lies in it."""
    written = real(output)
    if real(history) in (written, *written.parents):
        raise InvalidParameter(f"history is {history}, allowed: a folder that the output {output} is not in")


class _Interrupt:
    """Turns Ctrl-C into a question asked at safe places: never between two steps that belong together.

    A second Ctrl-C strikes at once.
    """

    def __init__(self) -> None:
        self._asked = False
        self._struck = False
        self._before: Any = None

    def __enter__(self) -> None:
        if threading.current_thread() is threading.main_thread():
            handler = signal.getsignal(signal.SIGINT)
            # Who handles Ctrl-C in another way keeps that way.
            if handler is signal.default_int_handler:
                self._before = signal.signal(signal.SIGINT, self._note)

    def __exit__(self, *_: object) -> None:
        if self._before is not None:
            signal.signal(signal.SIGINT, self._before)

    def _note(self, *_: object) -> None:
        self._asked = True
        self.disarm()

    def _strike(self, *_: object) -> None:
        self._struck = True
        raise KeyboardInterrupt

    def disarm(self) -> None:
        """Let Ctrl-C strike at once again."""
        if self._before is not None:
            signal.signal(signal.SIGINT, self._strike)

    @contextlib.contextmanager
    def deferred(self) -> Iterator[None]:
        """Let a step be finished, and raise the interrupt after it; a second one ends the step."""
        try:
            yield
        except Exception:
            # What an interrupt strikes may turn it into an error of its own.
            if self._struck:
                raise KeyboardInterrupt(_WHILE_WRITING) from None
            raise
        except KeyboardInterrupt:
            raise KeyboardInterrupt(_WHILE_WRITING) from None
        self.check(None)

    def check(self, _: object) -> None:
        """Raise the interrupt if one was asked for."""
        if self._asked:
            self._asked = False
            raise KeyboardInterrupt


def _checking(check: Callable[[object], None], then: Callable[[Any], None]) -> Callable[[Any], None]:
    """Call `check`, then the callback."""

    def both(value: Any) -> None:
        check(value)
        then(value)

    return both


def _label(run: Stream, labels: LabelSpool) -> int:
    """Spool the ids of a run; returns the number of aliases."""
    aliases = 0
    for span in run:
        labels.add(span.point_ids, span.segment_ids)
        aliases += len(span.aliases)
    return aliases


def resolve_file(
    history: PathLike,
    inputs: PathLike | Sequence[PathLike],
    output: PathLike,
    *,
    limits: bool = True,
    overwrite: bool = False,
    id_name: str | None = None,
    on_write: Callable[[int], None] | None = None,
) -> int:
    """Write each point of the input with the final segment id that its history resolves to.

    Parameters
    ----------
    history : path
        Folder of the history of a run over the same input.
    inputs, output, overwrite, id_name, on_write
        As for `segment_file`.
    limits : bool, default True
        As for `History.resolve`.

    Returns
    -------
    int
        How many points were written.

    Raises
    ------
    FileError
        The history, the input or a temporary file cannot be read, or the output cannot be written.
    InvalidInput
        The history or the input is damaged, or the history was made from other points.
    OutputExists
        The output is there.

    Examples
    --------
    >>> import numpy as np, streamseg as ss, tempfile
    >>> folder = tempfile.mkdtemp()
    >>> np.save(f"{folder}/in.npy", np.zeros((5, 3)))
    >>> past = f"{folder}/history"
    >>> _ = ss.segment_file(f"{folder}/in.npy", f"{folder}/out.npy", ss.Proximity(1.0), history=past)
    >>> ss.resolve_file(past, f"{folder}/in.npy", f"{folder}/again.npy")
    5
    """
    return resolved_file(
        history, inputs, output, limits=limits, overwrite=overwrite, id_name=id_name, on_write=on_write
    ).points


def resolved_file(
    history: PathLike,
    inputs: PathLike | Sequence[PathLike],
    output: PathLike,
    *,
    limits: bool,
    overwrite: bool,
    id_name: str | None,
    on_write: Callable[[int], None] | None,
) -> Resolved:
    """Do what `resolve_file` does, and say what it came to."""
    paths, output = _as_paths(inputs), Path(output)
    check_output(output, paths, overwrite, id_name)
    past = History(history)
    cloud = open_cloud(paths)
    check_kind(cloud, output, id_name)
    _check_origin(past, cloud)
    cloud.expect(past.manifest.get("digests"), f"the history {past.folder}")
    resolved = without = 0
    with LabelSpool() as labels:
        for point_ids, segment_ids in past.resolve(limits=limits):
            labels.add(point_ids, segment_ids)
            resolved += len(point_ids)
            without += int(np.count_nonzero(segment_ids < 0))
        points = write_labelled(
            cloud,
            output,
            labels,
            overwrite=overwrite,
            id_name=id_name,
            expected=past.manifest["points"],
            progress=callback("on_write", on_write),
        )
    segments, left_out, left_out_points = past.selected
    by_cause = {cause: LeftOut(left_out[cause], left_out_points[cause]) for cause in left_out if left_out[cause]}
    unlabelled = _of_written(past.unlabelled.with_more(left_out_points), resolved - points)
    return Resolved(points, segments, without - max(resolved - points, 0), unlabelled, by_cause)


def _check_origin(past: History, cloud: Cloud) -> None:
    """Refuse or warn of a history that was made from something else."""
    points, given = past.manifest["points"], ", ".join(map(str, cloud.paths))
    if cloud.point_count is not None and points != cloud.point_count:
        if past.manifest["complete"] or points > cloud.point_count:
            raise InvalidInput(
                f"{past.folder} is the history of {points:,} points, {given} has {cloud.point_count:,}; "
                "give the input that the history was made from"
            )
        warn(f"{past.folder} ends early: {points:,} of {cloud.point_count:,} points are in it, the others are left out")
    names = [Path(name).name for name in past.manifest["source"].split(", ")]
    if names != [path.name for path in cloud.paths]:
        warn(f"{past.folder} is the history of {past.manifest['source']}, not of {given}; its ids fit no others")
