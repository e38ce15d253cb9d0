"""`xormocap export`."""

import json
import re
import shutil
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet
import pytest
from typer.testing import CliRunner

from services.cli import app
from services.mocap.errors import UserError
from services.mocap.export.formats import DEFAULT_FORMATS, FORMATS, Format, write_defaults
from services.mocap.result.layout import KNOWN
from services.mocap.result.result import load_result
from services.mocap.take.csv_columns import read_columns


def export(*arguments: object) -> str:
    done = CliRunner().invoke(app, ["export", *map(str, arguments)], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.output


def refusal(*arguments: object) -> str:
    with pytest.raises(UserError) as refused:
        CliRunner().invoke(app, ["export", *map(str, arguments)], catch_exceptions=False)
    return str(refused.value)


@pytest.fixture
def folder(bare_result: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(bare_result, tmp_path / "result"))


def test_without_a_format_it_writes_what_a_run_writes(folder: Path) -> None:
    said = export(folder).split()
    names = {"motion.bvh", "motion.glb", "motion.trc", "motion.c3d", "angles.csv", "report.html"}
    assert names <= {path.name for path in folder.iterdir()} <= KNOWN
    assert {Path(path).name for path in said} >= names
    assert {file for form in FORMATS.values() for file in form.files} <= KNOWN


def test_chosen_formats_go_where_they_are_wanted(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "deep" / "out"
    export(folder, "--to", "bvh", "--out", out, "--naming", "mixamo", "--unit", "cm", "--rest", "A")
    assert [path.name for path in out.iterdir()] == ["motion.bvh"]
    text = (out / "motion.bvh").read_text()
    assert "ROOT mixamorig:Hips" in text
    assert text.count("JOINT") == 15
    assert "-45.0000000" in text  # the thigh of actor.toml, in centimetres
    assert {path.name for path in folder.iterdir()} == {"poses.csv", "actor.toml"}


def test_formats_may_be_separated_by_commas(folder: Path, tmp_path: Path) -> None:
    export(folder, "--to", "bvh,trc", "--to", "angles,bvh", "--out", tmp_path / "out")
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"motion.bvh", "motion.trc", "angles.csv"}
    assert refusal(folder, "--to", "bvh,trk") == "--to 'trk': unknown format: did you mean trc"


def test_angles_have_their_unit_in_the_header(folder: Path) -> None:
    export(folder, "--to", "angles")
    columns = read_columns(folder / "angles.csv", ["frame", "time_s"], allow_extra=True)
    assert all(name.endswith("_deg") for name in list(columns.cells)[2:])
    for name, values in load_result(folder).angles_deg.items():
        np.testing.assert_allclose(columns.numbers(f"{name}_deg"), values, atol=1e-4)


def test_parquet_holds_the_same_numbers_and_says_units(folder: Path) -> None:
    export(folder, "--to", "parquet")
    result = load_result(folder)
    poses = pyarrow.parquet.read_table(folder / "poses.parquet")
    assert poses.schema.field("root_x_m").metadata == {b"unit": b"m"}
    assert poses.schema.field("left_knee_flexion_rad").metadata == {b"unit": b"rad"}
    np.testing.assert_array_equal(poses["root_x_m"], result.poses[:, 0])
    np.testing.assert_array_equal(poses["distrusted_left_arm"], result.distrusted[:, 2])
    joints = pyarrow.parquet.read_table(folder / "joints.parquet")
    np.testing.assert_array_equal(joints["neck_z_m"], result.joints_world_m[:, 1, 2])
    angles = pyarrow.parquet.read_table(folder / "angles.parquet")
    np.testing.assert_array_equal(angles["left_hip_flexion_deg"], result.angles_deg["left_hip_flexion"])


def test_scripts_setup_installs_what_every_format_needs() -> None:
    lock = (Path(__file__).resolve().parents[2] / "requirements.lock").read_text()
    locked = set(re.findall(r"^([\w-]+)==", lock, re.MULTILINE))
    assert {package for form in FORMATS.values() for package in form.needs} <= locked


def test_without_pyarrow_one_sentence(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert refusal(folder, "--to", "parquet").startswith("parquet: needs pyarrow, which is not installed")


def test_the_overlay_needs_the_take(folder: Path, small_take, tmp_path: Path) -> None:
    assert refusal(folder, "--to", "overlay").endswith("does not name its take: add --take FOLDER")
    live = tmp_path / "live"
    shutil.copytree(folder, live)
    (live / "run.json").write_text(json.dumps({"live": {}, "take": {"folder": str(folder)}}))
    assert refusal(live, "--to", "overlay").endswith("add --take with the folder of their recording")
    short = small_take(frames=4)
    assert "has 4 frames, but the result extends to frame 115" in refusal(
        folder, "--to", "overlay", "--take", short
    )
    long = small_take("long", frames=116, source="silhouettes")
    export(folder, "--to", "overlay", "--take", long, "--out", tmp_path / "out")
    assert (tmp_path / "out" / "overlay.mp4").stat().st_size > 1000


def test_the_overlay_is_of_the_take_that_was_tracked(folder: Path, small_take, tmp_path: Path) -> None:
    other = small_take("other", frames=116, source="silhouettes")
    (folder / "run.json").write_text(json.dumps({"take": {"name": "walk", "folder": str(other)}}))
    for words in ([], ["--take", other]):  # another take may lie where the one that was tracked did
        assert refusal(folder, "--to", "overlay", *words) == (
            f"{folder}: is of 'walk', not of 'other' in {other}: expected the take that was tracked"
        )
    (folder / "run.json").write_text(json.dumps({"live": {}, "take": {"name": "walk"}}))
    export(folder, "--to", "overlay", "--take", other, "--out", tmp_path / "out")  # named like its folder


def test_a_take_that_was_moved(folder: Path, tmp_path: Path) -> None:
    (folder / "run.json").write_text(json.dumps({"take": {"name": "walk", "folder": str(tmp_path / "gone")}}))
    assert refusal(folder, "--to", "overlay") == (
        f"{folder}: its take is not at {tmp_path / 'gone'} any more: add --take FOLDER"
    )


def test_what_cannot_be(folder: Path, tmp_path: Path) -> None:
    assert refusal(folder, "--to", "bhv") == "--to 'bhv': unknown format: did you mean bvh"
    (tmp_path / "file").touch()
    assert "is a file: expected a folder" in refusal(folder, "--out", tmp_path / "file")


def test_every_file_may_lie_in_a_folder_of_results() -> None:
    assert {file for form in FORMATS.values() for file in form.files} <= KNOWN


def test_a_run_goes_on_without_what_cannot_be_written(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def too_long(*_: object) -> None:
        raise UserError("motion.c3d: cannot hold so many frames")

    def broken(*_: object) -> None:
        raise ZeroDivisionError("no reason")

    monkeypatch.setitem(FORMATS, "c3d", Format(("motion.c3d",), too_long))
    monkeypatch.setitem(FORMATS, "trc", Format(("motion.trc",), broken))
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    said: list[str] = []
    write_defaults(folder, load_result(folder), DEFAULT_FORMATS, said.append)
    assert said == [
        "motion.trc is left out because of an error: no reason",
        "motion.c3d: cannot hold so many frames",
        "report.html is left out without matplotlib: xormocap export --to report makes it",
    ]
    written = {"motion.bvh", "motion.glb", "angles.csv"}
    assert {path.name for path in folder.iterdir()} == {"poses.csv", "actor.toml"} | written
