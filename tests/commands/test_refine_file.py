"""`calibrate TAKE --refine RESULT` writes the calibration of the files, whatever size was worked with."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from services import cli
from services.commands.calibrate.refine import REFINED
from services.mocap.calibration.from_body import Refined
from services.mocap.camera.calibration import read_calibration
from services.mocap.fit.quality import FitQuality
from services.mocap.take.folder import Take


def _quality(energy_px: float) -> FitQuality:
    return FitQuality(np.full((4,), energy_px), np.zeros(4), np.full((4, 2), 0.9))


def test_lenses_are_those_of_the_files_and_extrinsics_those_that_were_found(
    small_take: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = small_take(longest_side=32)
    R_turn = Rotation.from_rotvec([0.01, 0.02, 0.0]).as_matrix()

    def refine(take: Take, *_: object) -> tuple[Refined, list[str]]:
        assert {camera.size_px for camera in take.cameras} == {(32, 24)}
        moved = tuple(camera.with_world_turned(R_turn) for camera in take.cameras)
        return Refined(moved, np.array([False, False]), _quality(100.0), _quality(50.0)), []

    monkeypatch.setattr("services.commands.calibrate.refine.refine_take_cameras", refine)
    done = CliRunner().invoke(cli.app, ["calibrate", str(folder), "--refine", str(folder / "result")])
    assert done.exit_code == 0, done.output
    given, found = (read_calibration(folder / name, "z") for name in ("calibration.toml", REFINED))
    for old, new in zip(given, found, strict=True):
        expected = old.with_world_turned(R_turn)
        assert new.size_px == (64, 48)
        np.testing.assert_array_equal(new.K, old.K)
        np.testing.assert_allclose(new.R_camera_world, expected.R_camera_world, atol=1e-12)
        np.testing.assert_allclose(new.t_camera_world_m, expected.t_camera_world_m)
