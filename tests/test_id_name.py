"""The name of the ids in outputs, and names of outputs that mean something else."""

from __future__ import annotations

from pathlib import Path

import laspy
import numpy as np
import pytest
from typer.testing import CliRunner

import streamseg as ss
from streamseg.cli import app
from streamseg.errors import InvalidInput, InvalidParameter
from streamseg.io import open_cloud, read_labels, write_labelled
from streamseg.io.id_column import STANDARD_NAMES

METHOD = ss.Proximity(1.5)


def write(path: Path, **extra: str) -> Path:
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales = np.full(3, 0.01)
    for name, kind in extra.items():
        header.add_extra_dim(laspy.ExtraBytesParams(name, kind))
    las = laspy.LasData(header)
    las.x, las.y, las.z = np.r_[np.arange(5.0), np.arange(5.0) + 100], np.zeros(10), np.zeros(10)
    for name in extra:
        las[name] = np.arange(10) + 50
    las.write(path)
    return path


def test_only_the_ids_are_written_and_other_dimensions_stay(tmp_path: Path) -> None:
    path = write(tmp_path / "a.las", SegmentID="i8", other="f4")
    ss.segment_file(path, tmp_path / "again.laz", METHOD, id_name="treeID")
    ss.segment_file(tmp_path / "again.laz", tmp_path / "b.laz", METHOD, id_name="treeID")
    las = laspy.read(tmp_path / "b.laz")
    assert list(las.point_format.extra_dimension_names) == ["SegmentID", "other", "treeID"]
    assert las["treeID"].dtype == np.int32
    assert las["treeID"].tolist() == [1] * 5 + [2] * 5
    assert (las["SegmentID"].dtype, las["SegmentID"].tolist()) == (np.int64, list(range(50, 60)))
    assert las["other"].tolist() == list(range(50, 60))


@pytest.mark.parametrize("suffix", [".las", ".csv", ".xyz"])
def test_every_command_knows_the_name(tmp_path: Path, suffix: str) -> None:
    path, out, again = write(tmp_path / "a.las"), tmp_path / f"b{suffix}", tmp_path / f"c{suffix}"
    runner, name = CliRunner(), ["--id-name", "ClusterID"]
    run = ["segment", str(path), str(out), "--distance", "1.5", "--history", str(tmp_path / "h"), *name]
    for words in (run, ["resolve", str(tmp_path / "h"), str(path), str(again), *name]):
        result = runner.invoke(app, words)
        assert result.exit_code == 0, result.output
    for written in (out, again):
        if suffix == ".xyz":  # without a line of names the last column is taken
            ((_, ids),) = read_labels(written)
        else:
            ((_, ids),) = read_labels(written, id_name="ClusterID")
        assert ids.tolist() == [1] * 5 + [2] * 5
    if suffix != ".xyz":
        result = runner.invoke(app, ["preview", str(out), str(tmp_path / "p.png"), *name])
        assert result.exit_code == 0, result.output
        with pytest.raises(InvalidInput, match="SegmentID"):
            next(read_labels(out))


@pytest.mark.parametrize("kind", ["u2", "i4", "i8"])
def test_a_dimension_of_somebody_else_is_never_replaced(tmp_path: Path, kind: str) -> None:
    path = write(tmp_path / "a.las", treeID=kind)
    with pytest.raises(InvalidInput, match="'treeID' that streamseg has not written; give the ids another name"):
        ss.segment_file(
            [write(tmp_path / "0.las"), path], tmp_path / "b.las", METHOD, id_name="treeID", history=tmp_path / "h"
        )
    assert sorted(one.name for one in tmp_path.iterdir()) == ["0.las", "a.las"]


def test_text_labelled_again_has_its_column_replaced(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("x,y,z\n0,0,0\n9,0,0\n")
    (tmp_path / "nameless.csv").write_text("5,5,5,7\n")
    ss.segment_file(tmp_path / "a.csv", tmp_path / "b.csv", METHOD)
    ss.segment_file([tmp_path / "b.csv", tmp_path / "nameless.csv"], tmp_path / "c.csv", METHOD)
    assert (tmp_path / "c.csv").read_text() == "x,y,z,SegmentID\n0,0,0,1\n9,0,0,2\n5,5,5,3\n"


@pytest.mark.parametrize(
    ("columns", "name", "told"),
    [
        ("x,y,z,score", "score", "a.csv has a column 'score' already"),
        ("score,x,y,z", "score", "a.csv has a column 'score' already"),
        ("x,y,z,Tree_ID", "treeID", "a.csv has a column 'Tree_ID' already"),
        ("SegmentID,x,y,z", None, "a.csv has a column 'SegmentID' already"),
        ("SegmentID,x,y,z,SegmentID", None, "a.csv has a column 'SegmentID' already"),
        ("e,n,h,i", "height", "'height' would not say any more where x, y and z are"),
        ("e,n,h,i", "E", "a.csv has a column 'e' already"),
    ],
)
@pytest.mark.parametrize("mark", ["", "# "])
def test_a_name_that_a_column_has_is_refused(
    tmp_path: Path, columns: str, name: str | None, told: str, mark: str
) -> None:
    row = ",".join("1" for _ in columns.split(","))
    (tmp_path / "a.csv").write_text(f"{mark}{columns}\n{row}\n")
    with pytest.raises(InvalidInput, match=rf"{told}.*give the ids another name"):
        ss.segment_file(tmp_path / "a.csv", tmp_path / "b.csv", METHOD, id_name=name, history=tmp_path / "h")
    assert [one.name for one in tmp_path.iterdir()] == ["a.csv"]


def test_columns_without_names_stay(tmp_path: Path) -> None:
    (tmp_path / "a.xyz").write_text("0 0 0 7\n9 0 0 8\n")
    ss.segment_file(tmp_path / "a.xyz", tmp_path / "b.xyz", METHOD, id_name="column_4")
    assert (tmp_path / "b.xyz").read_text() == "0 0 0 7 1\n9 0 0 8 2\n"


@pytest.mark.parametrize("source", ["a.csv", "a.las"])
def test_names_in_any_script_are_read_again(tmp_path: Path, source: str) -> None:
    write(tmp_path / "a.las")
    (tmp_path / "a.csv").write_bytes("x,y,z,h\xf6he\n0,0,0,1\n9,0,0,1\n".encode("latin-1"))
    for name in ("bäume", "树", "n" * 100):
        ss.segment_file(tmp_path / source, tmp_path / "b.csv", METHOD, id_name=name, overwrite=True)
        ((_, ids),) = read_labels(tmp_path / "b.csv", id_name=name)
        assert set(ids.tolist()) == {1, 2}
        (tmp_path / "b.csv").unlink()


@pytest.mark.parametrize(
    "name", ["", " a", "n" * 32, "höhe", "a\nb", "Intensity", "scan_angle", "ScanAngleRank", "z", "Red", "GpsTime", 5]
)
def test_names_that_las_cannot_have_are_refused_before_anything_is_done(tmp_path: Path, name: str) -> None:
    path = write(tmp_path / "a.las")
    with pytest.raises(InvalidParameter, match="id_name is"):
        ss.segment_file(path, tmp_path / "b.las", METHOD, id_name=name, history=tmp_path / "h")
    assert sorted(one.name for one in tmp_path.iterdir()) == ["a.las"]


@pytest.mark.parametrize(
    ("suffix", "name"),
    [
        *(
            (".csv", "a,b"),
            (".xyz", "two words"),
            (".txt", "#a"),
            (".npy", "tree"),
            (".csv", "a\0"),
            (".csv", "n" * 101),
        ),
        *((".csv", "a\ud800"), (".xyz", "a\udcff"), (".xyz", "a\x85b"), (".xyz", "a\u2028b"), (".csv", "a\vb")),
    ],
)
def test_names_that_other_outputs_cannot_have_are_refused(tmp_path: Path, suffix: str, name: str) -> None:
    with pytest.raises(InvalidParameter, match="id_name is"):
        ss.segment_file(write(tmp_path / "a.las"), tmp_path / f"b{suffix}", METHOD, id_name=name)


def test_a_name_that_nobody_can_tell_from_another_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="'tree_id', which nobody can tell from 'treeID'"):
        ss.segment_file(write(tmp_path / "a.las", tree_id="i4"), tmp_path / "b.las", METHOD, id_name="treeID")


def test_standard_names_are_those_of_all_point_formats() -> None:
    dims = laspy.point.dims
    names = {name for number in range(11) for name in laspy.PointFormat(number).dimension_names}
    names |= {name for number in range(11) for name in dims.ALL_POINT_FORMATS_DIMENSIONS[number]}
    assert {name.replace("_", "").lower() for name in names} == STANDARD_NAMES


@pytest.mark.parametrize("name", ["b.copc.laz", "B.COPC.LAZ", "x.y.Copc.laz"])
def test_outputs_that_are_called_as_copc_is_are_refused(tmp_path: Path, name: str) -> None:
    path = write(tmp_path / "a.las")
    plain = name[: -len(".copc.laz")] + name[-4:]
    with pytest.raises(InvalidParameter, match=rf"COPC is, which is not written; name it {plain}"):
        ss.segment_file(path, tmp_path / name, METHOD)
    with pytest.raises(InvalidParameter, match="COPC"):
        ss.resolve_file(tmp_path / "h", path, tmp_path / name)
    with pytest.raises(InvalidParameter, match="COPC"):
        write_labelled(open_cloud(path), tmp_path / name, None)  # type: ignore[arg-type]
    assert not (tmp_path / name).exists()
