"""Paths that nothing can be at: every command says so in one sentence, and does nothing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import streamseg as ss
from streamseg import scenes
from streamseg.cli import app
from streamseg.description import describe
from streamseg.io.opening import real, there

NEAR = ss.Proximity(1.5)
TOO_LONG = "n" * 300
NO_NAMES = {
    TOO_LONG: "File name too long",
    f"{TOO_LONG}/in": "File name too long",
    "a\0b": "holds a NUL character",
    "a\ud800b": "holds a character that no name can have",
    "round/in": "Too many levels of symbolic links",
}
COMMANDS = {
    "in": ["segment", "BAD.xyz", "out.xyz", "--distance", "1.5"],
    "OUT": ["segment", "in.xyz", "BAD.xyz", "--distance", "1.5"],
    "history": ["segment", "in.xyz", "out.xyz", "--distance", "1.5", "--history", "BAD"],
    "preview": ["segment", "in.xyz", "out.xyz", "--distance", "1.5", "--preview", "BAD.png"],
    "verify": ["verify", "BAD.xyz", "--distance", "1.5"],
    "info": ["info", "BAD"],
    "plan": ["info", "BAD.xyz", "--plan", "--distance", "1.5"],
    "export from": ["export", "BAD", "tables"],
    "export to": ["export", "h", "BAD"],
    "resolve from": ["resolve", "BAD", "in.xyz", "out.xyz"],
    "resolve to": ["resolve", "h", "in.xyz", "BAD.xyz"],
    "draw": ["preview", "BAD.xyz", "out.png"],
    "draw to": ["preview", "labelled.xyz", "BAD.png"],
    "demo": ["demo", "BAD"],
}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    np.savetxt("in.xyz", np.zeros((5, 3)))
    (tmp_path / "round").symlink_to("round")
    ss.segment_file("in.xyz", "labelled.xyz", NEAR, history="h")
    return tmp_path


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("name", [TOO_LONG, f"{TOO_LONG}/in", "round/in"], ids=["long", "folder", "loop"])
def test_a_path_that_nothing_can_be_at_is_told(folder: Path, command: str, name: str) -> None:
    before = sorted(one.name for one in folder.rglob("*"))
    words = [word.replace("BAD", name) for word in COMMANDS[command]]
    result = CliRunner().invoke(app, words)
    # The application itself raises; what is run from the shell makes a sentence of it.
    assert isinstance(result.exception, ss.StreamsegError), result.output
    assert NO_NAMES[name] in str(result.exception)
    assert sorted(one.name for one in folder.rglob("*")) == before


@pytest.mark.parametrize(("name", "reason"), NO_NAMES.items(), ids=["long", "folder", "nul", "surrogate", "loop"])
def test_so_is_one_that_only_python_can_give(folder: Path, name: str, reason: str) -> None:
    before = sorted(one.name for one in folder.rglob("*"))
    for call in (
        lambda: ss.segment(f"{name}.xyz", NEAR),
        lambda: ss.segment_file(f"{name}.las", "out.las", NEAR),
        lambda: ss.segment_file("in.xyz", f"{name}.xyz", NEAR),
        lambda: ss.segment_file("in.xyz", "out.xyz", NEAR, history=name),
        lambda: ss.stream(np.zeros((5, 3)), NEAR, history=name),
        lambda: ss.History(name),
        lambda: ss.History("h").to_csv(name),
        lambda: ss.resolve_file("h", "in.xyz", f"{name}.xyz"),
        lambda: ss.preview("labelled.xyz", f"{name}.png"),
        lambda: ss.preview(f"{name}.xyz", "out.png"),
        lambda: list(describe(name)),
        lambda: scenes.write(f"{name}.las", "airborne", 1000),
    ):
        with pytest.raises(ss.StreamsegError, match=reason):
            call()
    assert sorted(one.name for one in folder.rglob("*")) == before


def test_a_link_that_leads_to_itself_is_no_history(folder: Path) -> None:
    for call in (
        lambda: ss.segment_file("in.xyz", "out.xyz", NEAR, history="round"),
        lambda: ss.stream(np.zeros((5, 3)), NEAR, history="round"),
        lambda: ss.History("round"),
        lambda: ss.History("h").to_csv("round"),
    ):
        with pytest.raises(ss.FileError, match=r"round.* Too many levels of symbolic links"):
            call()


def test_what_is_there_is_told_from_what_is_not(folder: Path) -> None:
    assert there(folder / "in.xyz") is not None
    for nothing in (folder / "nothing", folder / "in.xyz" / "below"):
        assert there(nothing) is None
    (folder / "away").symlink_to("nothing")
    assert there(folder / "away") is None
    assert there(folder / "away", is_followed=False) is not None
    assert real("away") == folder / "nothing"
