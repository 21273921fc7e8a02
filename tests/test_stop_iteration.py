"""An exception that ends loops, raised by a caller's own code, never looks like the end of a run."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import streamseg as ss

POINTS = np.column_stack([np.arange(500.0), np.zeros((500, 2))])
SPANS = ss.SpanByCount(50)
NEAR = ss.Proximity(1.5)
ENDINGS = [StopIteration, StopAsyncIteration, type("Ending", (StopIteration,), {})]


def slips(ending: type[Exception], at: int = 2) -> Callable[[ss.WindowPoints], NDArray[np.int64]]:
    def segmentor(window: ss.WindowPoints) -> NDArray[np.int64]:
        if window.index == at:
            raise ending("a slip")
        return np.zeros(len(window), int)

    return segmentor


class Fits:
    def fit_predict(self, _: Any) -> Any:
        return next(iter([]))


class Answers:
    """What becomes labels only when it is asked to, and slips then."""

    def __array__(self, *_: object, **__: object) -> Any:
        raise StopIteration


@pytest.mark.parametrize("result", ["carry", "history", "final"])
@pytest.mark.parametrize("ending", ENDINGS)
def test_a_segmentors_slip_is_an_error_of_its_own(tmp_path: Path, ending: type[Exception], result: Any) -> None:
    taken: list[int] = []
    with (
        pytest.raises(ss.SegmentorError, match=r"^segmentor 'segmentor' raised Stop.* in window 2") as caught,
        ss.stream(POINTS, slips(ending), spans=SPANS, history=tmp_path / "past", result=result) as run,
    ):
        taken.extend(span.index for span in run)
    assert isinstance(caught.value.__cause__, ending)
    assert ss.History(tmp_path / "past").manifest["complete"] is False
    assert not run.is_proven


@pytest.mark.parametrize("segmentor", [slips(StopIteration, 0), Fits(), lambda _: Answers()])
def test_no_way_to_segment_takes_it_for_the_end(tmp_path: Path, segmentor: Any) -> None:
    np.save(tmp_path / "in.npy", POINTS)
    for call in (
        lambda: ss.segment(POINTS, segmentor, spans=SPANS),
        lambda: ss.segment_static(POINTS, segmentor),
        lambda: ss.segment_file(tmp_path / "in.npy", tmp_path / "out.npy", segmentor),
        lambda: list(ss.stream(iter([POINTS]), segmentor)),
        lambda: ss.verify(POINTS, segmentor, spans=SPANS),
    ):
        with pytest.raises(ss.SegmentorError, match="raised StopIteration in window 0"):
            call()
    assert not (tmp_path / "out.npy").exists()


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize("name", ["on_open", "on_read", "on_progress", "on_write"])
def test_a_callbacks_slip_is_told_by_its_name(tmp_path: Path, name: str, ending: type[Exception]) -> None:
    def slip(_: object) -> None:
        raise ending

    np.save(tmp_path / "in.npy", POINTS)
    with pytest.raises(RuntimeError, match=f"^{name} raised {ending.__name__}$"):
        ss.segment_file(tmp_path / "in.npy", tmp_path / "out.npy", NEAR, **{name: slip})  # type: ignore[arg-type]


@pytest.mark.parametrize("result", ["carry", "final"])
def test_a_run_goes_on_after_the_slip_of_on_progress(result: Any) -> None:
    told: list[int] = []

    def slip_once(progress: ss.Progress) -> None:
        if progress.windows == 2 and not told:
            told.append(progress.windows)
            raise StopIteration

    run = ss.stream(POINTS, NEAR, spans=SPANS, on_progress=slip_once, result=result)
    taken: list[ss.Span] = []
    with pytest.raises(RuntimeError, match=r"^on_progress raised StopIteration$"):
        taken.extend(run)
    assert told
    point_ids = {point for span in [*taken, *run] for point in span.point_ids.tolist()}
    # What a list in the making had taken is lost with it; all that comes afterwards is there.
    assert max(point_ids) == 499


def test_a_source_ends_by_it_and_its_arrays_do_not() -> None:
    class Scanner:
        """Ends as iterators do; the class has no generator that would mind."""

        def __init__(self, *items: Any) -> None:
            self.items = list(items)

        def __iter__(self) -> Iterator[Any]:
            return self

        def __next__(self) -> Any:
            if not self.items:
                raise StopIteration
            return self.items.pop(0)

    assert len(ss.segment(Scanner(POINTS[:250], POINTS[250:]), NEAR)) == 500
    with pytest.raises(RuntimeError, match="StopIteration"):
        ss.segment(Scanner(POINTS[:250], Answers()), NEAR)


def test_it_is_an_error_on_the_way_to_surveys_too() -> None:
    def source() -> Iterator[Any]:
        yield POINTS[:250]
        yield Answers()

    with pytest.raises(RuntimeError, match="StopIteration"):
        list(ss.preprocess(source(), ss.VoxelGrid(2.0)))
    with pytest.raises(RuntimeError, match="StopIteration"):
        ss.features(source(), "NormalZ", k=5)
