"""Functions that a caller has called by a run."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

News = TypeVar("News")


def callback(name: str, function: Callable[[News], object] | None) -> Callable[[News], None]:
    """Make a callback whose StopIteration does not look like the end of the run; None does nothing.

    As in generators (PEP 479), it becomes a RuntimeError with the exception as its cause.
    """

    def call(news: News) -> None:
        if function is None:
            return
        try:
            function(news)
        except (StopIteration, StopAsyncIteration) as error:
            raise RuntimeError(f"{name} raised {type(error).__name__}") from error

    return call
