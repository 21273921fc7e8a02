"""What is asked of the C library: all that there is of it, and a mistake of ours is not hidden."""

from __future__ import annotations

import ctypes
import sys
from types import SimpleNamespace
from typing import NoReturn

import pytest

from streamseg.cli.memory import give_memory_back


@pytest.fixture(autouse=True)
def on_linux(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "linux")


def test_a_library_without_mallopt_is_asked_for_the_rest(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[int, ...]] = []
    library = SimpleNamespace(prctl=lambda *words: asked.append(words))
    monkeypatch.setattr(ctypes, "CDLL", lambda _: library)
    give_memory_back()
    assert asked == [(41, 1, 0, 0, 0)]
    library.mallopt = lambda *words: asked.append(words)
    give_memory_back()
    assert asked[1:] == [(-3, 1 << 18), (-8, 1), (41, 1, 0, 0, 0)]


def test_without_libraries_nothing_is_asked_and_a_mistake_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    def none(_: None) -> NoReturn:
        raise OSError("no libraries here")

    monkeypatch.setattr(ctypes, "CDLL", none)
    give_memory_back()
    monkeypatch.setattr(ctypes, "CDLL", lambda _: SimpleNamespace(prctl=lambda: None))
    with pytest.raises(TypeError):
        give_memory_back()
