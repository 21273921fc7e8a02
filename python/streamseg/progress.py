"""Progress bars that are true: points and windows done, live segments, points per second, time left."""

from __future__ import annotations

from types import TracebackType

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TaskID,
    TextColumn,
    TimeRemainingColumn,
)
from rich.text import Text

from .stream import Progress as RunProgress


class _Speed(ProgressColumn):
    """Points per second, over the last seconds."""

    def render(self, task: Task) -> Text:
        speed = task.finished_speed or task.speed
        return Text("" if speed is None else f"{speed / 1e6:.2f} M points/s")


class ProgressBars:
    """One bar each for reading, segmenting and writing; nothing at all where there is no terminal."""

    def __init__(self, *, enabled: bool = True) -> None:
        console = Console(stderr=True)
        self._progress = Progress(
            TextColumn("{task.description:<10}"),
            BarColumn(),
            MofNCompleteColumn(),
            _Speed(),
            TimeRemainingColumn(compact=True),
            TextColumn("{task.fields[note]}"),
            console=console,
            disable=not (enabled and console.is_terminal),
        )
        self._tasks: dict[str, TaskID] = {}
        self._total: int | None = None

    def __enter__(self) -> ProgressBars:
        self._progress.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, exception: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._progress.stop()

    def on_open(self, points: int | None) -> None:
        """Learn how many points are announced."""
        self._total = points

    def on_read(self, points: int) -> None:
        """Show how many points have been read."""
        self._show("reading", points)

    def on_progress(self, run: RunProgress) -> None:
        """Show how far a run is."""
        self._show("segmenting", run.points, f"{run.windows:,} windows, {run.live_segments:,} live segments")

    def on_write(self, points: int) -> None:
        """Show how many points have been written."""
        self._show("writing", points)

    def _show(self, what: str, points: int, note: str = "") -> None:
        if what not in self._tasks:
            self._tasks[what] = self._progress.add_task(what, total=self._total, note=note)
        task = self._tasks[what]
        if points < self._progress.tasks[task].completed:
            # A cloud may be read more than once; each time takes its own.
            self._progress.reset(task)
        self._progress.update(task, completed=points, note=note)
