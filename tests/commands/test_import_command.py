"""`xormocap calibrate --import` by command: what options it takes and what it refuses."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from services.cli import app
from services.mocap.camera.calibration import read_calibration
from services.mocap.errors import UserError

CALIB = "640 480  500 0 320  0 500 240  0 0 1  1 0 0 100  0 1 0 200  0 0 1 3000  0 0 0 1  0 0 0 0"


def convert(*words: object) -> None:
    result = CliRunner().invoke(app, ["calibrate", "--import", *map(str, words)], catch_exceptions=False)
    assert result.exit_code == 0, result.output


@pytest.fixture
def biocv(tmp_path: Path) -> Path:
    """bioCV's file of one camera, in millimetres."""
    path = tmp_path / "cam01.calib"
    path.write_text(CALIB)
    return path


@pytest.mark.parametrize("units", [(), ("--units", "auto"), ("--units", "mm")])
def test_millimetres_are_converted_once(biocv: Path, tmp_path: Path, units: tuple[str, ...]) -> None:
    convert(biocv, *units, "--out", tmp_path / "out.toml")
    (camera,) = read_calibration(tmp_path / "out.toml", "z")
    np.testing.assert_allclose(camera.t_camera_world_m, [0.1, 0.2, 3.0], atol=1e-9)


def test_the_file_that_is_read_is_not_overwritten(biocv: Path) -> None:
    before = biocv.read_text()
    with pytest.raises(UserError, match=r"--out .*cam01\.calib: is the file that is read"):
        convert(biocv, "--out", biocv)
    assert biocv.read_text() == before


@pytest.mark.parametrize("units", ["m", "cm"])
def test_a_unit_that_contradicts_the_format_is_refused(biocv: Path, tmp_path: Path, units: str) -> None:
    with pytest.raises(UserError, match=f"cam01.calib: --units {units}: its format defines mm"):
        convert(biocv, "--units", units, "--out", tmp_path / "out.toml")
    assert not (tmp_path / "out.toml").exists()


def test_an_unknown_format_can_be_named_here_and_a_missing_file_is_missing(
    biocv: Path, tmp_path: Path
) -> None:
    unknown = biocv.rename(tmp_path / "cam01.doc")
    with pytest.raises(
        UserError, match=r"not a known calibration format: .*; or give its format with --from$"
    ):
        convert(unknown, "--out", tmp_path / "out.toml")
    convert(unknown, "--from", "biocv", "--out", tmp_path / "out.toml")
    assert [camera.name for camera in read_calibration(tmp_path / "out.toml", "z")] == ["cam01"]
    with pytest.raises(UserError, match=r"nowhere\.toml: is missing: expected a calibration"):
        convert(tmp_path / "nowhere.toml", "--out", tmp_path / "out.toml")


def test_lenses_of_an_unknown_format_are_refused_without_an_option_that_lenses_lack(tmp_path: Path) -> None:
    (tmp_path / "lenses.doc").write_text("")
    (tmp_path / "points.csv").write_text("camera,u,v,x,y,z\ncam01,1,1,0,0,0\n")
    words = [
        "--points",
        tmp_path / "points.csv",
        "--lens",
        tmp_path / "lenses.doc",
        "--out",
        tmp_path / "o.toml",
    ]
    with pytest.raises(UserError, match="not a known calibration format") as refused:
        CliRunner().invoke(app, ["calibrate", *map(str, words)], catch_exceptions=False)
    assert "--from" not in str(refused.value)


@pytest.mark.parametrize(
    "words", [("--scale", "0"), ("--scale", "-1"), ("--scale", "nan"), ("--size", "0x480")]
)
def test_scales_and_sizes_that_cannot_be(biocv: Path, tmp_path: Path, words: tuple[str, str]) -> None:
    with pytest.raises(UserError, match=f"{words[0]} {words[1]}: expected"):
        convert(biocv, "--out", tmp_path / "out.toml", *words)
    assert not (tmp_path / "out.toml").exists()
