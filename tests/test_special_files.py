"""What a path can lead to that is no file of points: one sentence each, and nothing waits."""

from __future__ import annotations

import errno
import os
import socket
from typing import TYPE_CHECKING

import numpy as np
import pytest

from streamseg.errors import FileError, InvalidInput
from streamseg.io import las, open_cloud, opening

if TYPE_CHECKING:
    from pathlib import Path

KINDS = ["las", "laz", "npy", "xyz", "csv", "unknown"]


def refused(path: Path | str, said: str) -> None:
    with pytest.raises(FileError, match=said) as caught:
        open_cloud(path)
    message = str(caught.value)
    assert "\n" not in message
    assert not message.startswith("[Errno")


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_no_regular_file_is_refused(tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"a.{kind}"
    os.mkfifo(path)
    refused(path, rf"a\.{kind} is no regular file but a pipe \(FIFO\), and points are read more than once")
    path.unlink()
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(os.path.relpath(path))
        refused(path, "is no regular file but a socket")
    path.unlink()
    for device in ("/dev/null", "/dev/zero"):
        path.symlink_to(device)
        refused(path, "is no regular file but a device")
        path.unlink()
    path.mkdir()
    refused(path, "cannot be read: it is a folder; give the files in it")


@pytest.mark.parametrize("kind", KINDS)
def test_what_leads_nowhere_is_refused(tmp_path: Path, kind: str) -> None:
    path, other = tmp_path / f"a.{kind}", tmp_path / f"b.{kind}"
    refused(path, "does not exist$")
    path.symlink_to(other)
    refused(path, rf"does not exist: it links to .*b\.{kind}")
    other.symlink_to(path)
    refused(path, "cannot be read: Too many levels of symbolic links")
    refused(tmp_path / f"{'a' * 300}.{kind}", "cannot be read: File name too long")
    refused(f"{tmp_path}/a\0b.{kind}", r"a\\x00b.* is no path of a file: it holds a NUL character")
    path.unlink()
    path.write_bytes(b"1 2 3\n")
    refused(path / f"c.{kind}", "cannot be read: Not a directory")


@pytest.mark.parametrize("kind", ["las", "npy", "xyz"])
@pytest.mark.parametrize("code", [errno.EACCES, errno.EIO, errno.EMFILE])
def test_what_the_system_refuses_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, code: int) -> None:
    path = tmp_path / f"a.{kind}"
    path.write_bytes(b"1 2 3\n")

    def no(*_: object) -> None:
        raise OSError(code, os.strerror(code))

    for module in (opening, las):
        monkeypatch.setattr(module, "open", no, raising=False)
    refused(path, f"cannot be read: {os.strerror(code)}")


@pytest.mark.parametrize("kind", ["npy", "xyz"])
def test_a_file_that_goes_away_between_two_readings_is_told(tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"a.{kind}"
    if kind == "npy":
        np.save(path, np.ones((2, 3)))
    else:
        path.write_text("1 2 3\n4 5 6\n")
    cloud = open_cloud(path)
    path.unlink()
    with pytest.raises(FileError, match="does not exist"):
        next(cloud.chunks())
    os.mkfifo(path)
    with pytest.raises(FileError, match="is no regular file but a pipe"):
        next(cloud.chunks())


def test_links_to_files_are_followed(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("1 2 3\n")
    (tmp_path / "b.xyz").symlink_to("a.txt")
    assert next(open_cloud(tmp_path / "b.xyz").chunks()).points.tolist() == [[1, 2, 3]]


def test_other_errors_are_not_swallowed(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="own"), opening.telling(tmp_path):
        raise InvalidInput("own")
    with pytest.raises(FileError, match=r"^own$"), opening.telling(tmp_path):
        raise FileError("own")
