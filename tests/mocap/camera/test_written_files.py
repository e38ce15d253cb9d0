"""Files in written/: three cameras of these tests, as the tools write them, not as a test imagines them.

| folder | written by |
| --- | --- |
| anipose | aniposelib 0.8.0, CameraGroup.dump; millimetres |
| freemocap | FreeMoCap 1.8.2, its CameraGroup.dump; millimetres |
| caliscope | caliscope 0.11.8, CameraArray.to_toml, with a fourth camera that has no lens |
| pose2sim, pose2sim_to_… | Pose2Sim 0.10.49, toml_write and converters; to Qualisys without a lens |
| colmap, colmap_binary | pycolmap 4.2.1, Reconstruction.write_text and write_binary |
| easymocap | the output statements of EasyMocap's write_camera: 6 decimal places, lines end as on Windows |
| biocv | those of Calibration::Write in mc_core, bioCV's library: 6 digits |
| grip | those of saveXCP in GRIP, for Vicon, whose own software is not free; without a lens, square pixels |
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from test_formats import CAMERAS, read, same

from services.mocap.errors import CalibrationError

WRITTEN = Path(__file__).parent / "written"
NAMES = [one.name for one in CAMERAS]


@pytest.mark.parametrize(
    ("folder", "names", "tolerance_px"),
    [
        ("anipose/calibration.toml", NAMES, 1e-6),
        ("freemocap/camera_calibration.toml", NAMES, 1e-6),
        ("caliscope/camera_array.toml", ["cam_0", "cam_1", "cam_2"], 1e-6),
        ("pose2sim/Calib.toml", NAMES, 1e-6),
        ("pose2sim_to_easymocap", NAMES, 1e-6),
        ("easymocap", NAMES, 1e-3),
        ("colmap", NAMES, 1e-6),
        ("biocv", NAMES, 5e-3),
    ],
)
def test_a_file_that_a_tool_wrote_is_read(folder: str, names: list[str], tolerance_px: float) -> None:
    has_no_size = folder == "pose2sim_to_easymocap"
    found, _ = read(WRITTEN / folder, up=None, size_px=(1920, 1080) if has_no_size else None)
    assert [one.name for one in found] == names
    for one, true in zip(found, CAMERAS, strict=True):
        same(one, true, tolerance_px)


def test_a_camera_that_caliscope_has_not_calibrated_is_left_out() -> None:
    _, remarks = read(WRITTEN / "caliscope/camera_array.toml")
    assert any("[cameras.3]: has no lens" in remark for remark in remarks)


def test_opencap_files_of_pose2sim_have_a_world_that_faces_the_other_way() -> None:
    """The origin and the vertical are the same; where x and y point is the converter's choice."""
    found, _ = read(WRITTEN / "pose2sim_to_opencap", up=None)
    half_turn = np.diag([-1.0, -1.0, 1.0])
    for one, true in zip(found, CAMERAS, strict=True):
        same(one, replace(true, R_camera_world=true.R_camera_world @ half_turn))


@pytest.mark.parametrize(
    ("path", "focal_px", "size_px"),
    [
        ("grip/session.xcp", (1400.0, 1400.0), (1920, 1080)),
        # Qualisys numbers the last pixel, 1919; Pose2Sim writes 1920.
        ("pose2sim_to_qualisys/Calib.qca.txt", (1400.0, 1401.0), (1921, 1081)),
    ],
)
def test_a_file_without_a_lens_is_read(
    path: str, focal_px: tuple[float, float], size_px: tuple[int, int]
) -> None:
    found, _ = read(WRITTEN / path, up=None)
    for one, true in zip(found, CAMERAS, strict=True):
        K = true.K.copy()
        K[[0, 1], [0, 1]] = focal_px
        width_px, height_px = size_px
        same(one, replace(true, K=K, distortion=np.zeros(4), width_px=width_px, height_px=height_px))


def test_a_binary_model_of_colmap_gets_the_command_that_makes_it_text() -> None:
    path = WRITTEN / "colmap_binary"
    with pytest.raises(CalibrationError) as refused:
        read(path)
    assert str(refused.value) == (
        f"{path}: is COLMAP's binary model: expected its text model: type: colmap model_converter "
        f"--input_path {path} --output_path {path} --output_type TXT"
    )
