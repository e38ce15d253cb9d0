"""OpenCap, Vicon, bioCV, and the names that tools write into EasyMocap's and OpenCV's files.

Each writer makes the layout that the tool documents or that its own converter writes.
"""

import pickle  # noqa: TID251  (written here, to be refused)
import re
import tomllib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import tomli_w
from scipy.spatial.transform import Rotation
from test_formats import (
    CAMERAS,
    as_caliscope,
    as_colmap,
    as_easymocap,
    as_freemocap,
    as_opencv,
    as_pose2sim,
    as_qualisys,
    read,
    same,
)

from opencap_files import write_opencap
from services.mocap.calibration.known_lenses import known_lenses
from services.mocap.camera.formats.reading import read_loose
from services.mocap.errors import CalibrationError


def as_opencap(folder: Path, protocol: int = 4) -> Path:
    write_opencap(folder / "opencap", CAMERAS, protocol)
    return folder / "opencap"


def as_vicon(folder: Path, per_px: tuple[float, ...] = (0.0, 0.0, 0.0)) -> Path:
    """Quaternion x, y, z, w from world to camera, position in millimetres; a marker camera is among them."""
    tags = []
    for one in CAMERAS:
        (fx, _, cx), (_, fy, cy), _ = one.K
        fields = {
            "FOCAL_LENGTH": fx,
            "FRAME": 0,
            "ORIENTATION": " ".join(map(str, Rotation.from_matrix(one.R_camera_world).as_quat())),
            "POSITION": " ".join(map(str, 1000 * one.centre_world_m)),
            "PRINCIPAL_POINT": f"{cx} {cy}",
            "VICON_RADIAL2": " ".join(map(str, ("Vicon3Parameter", cx, cy, *per_px))),
            "WORLD_ERROR": 0.1,
        }
        frame = "".join(f' {key}="{value}"' for key, value in fields.items())
        tags.append(
            f'<Camera DEVICEID="{one.name}" DISPLAY_TYPE="Vue" PIXEL_ASPECT_RATIO="{fx / fy}" '
            f'SENSOR_SIZE="1920 1080" TYPE="Vue_VIDEO"><KeyFrames><KeyFrame{frame}/></KeyFrames></Camera>'
        )
    marker = tags[0].replace("Vue", "Vantage").replace("_VIDEO", "").replace(CAMERAS[0].name, "21")
    path = folder / "session.xcp"
    path.write_text(f"<Cameras>{marker}{''.join(tags)}</Cameras>")
    return path


def as_biocv(folder: Path) -> Path:
    """<name>.mp4.calib: size, matrix, transform in millimetres, coefficients, with empty lines between."""
    made = folder / "biocv"
    made.mkdir()
    for one in CAMERAS:
        transform = np.eye(4)
        transform[:3] = np.column_stack([one.R_camera_world, 1000 * one.t_camera_world_m])
        rows = [*one.K, [], *transform, [], [*one.distortion, 0.0]]
        text = "\n".join(" ".join(f"{value:.17g}" for value in row) for row in rows)
        (made / f"{one.name}.mp4.calib").write_text(f"1920\n1080\n{text}\n")
    return made


def as_easymocap_by_pose2sim(folder: Path) -> Path:
    """Fields are counted from 1, whatever the names; coefficients and translations have one dimension."""
    made = folder / "pose2sim"
    made.mkdir()
    intri = cv2.FileStorage(str(made / "Intrinsic.yml"), cv2.FILE_STORAGE_WRITE)
    extri = cv2.FileStorage(str(made / "Extrinsic.yml"), cv2.FILE_STORAGE_WRITE)
    for storage in (intri, extri):
        storage.write("names", [one.name for one in CAMERAS])
    for i, one in enumerate(CAMERAS, start=1):
        intri.write(f"K_{i}", one.K)
        intri.write(f"dist_{i}", np.append(one.distortion, 0.0))
        extri.write(f"R_{i}", cv2.Rodrigues(one.R_camera_world)[0])
        extri.write(f"Rot_{i}", one.R_camera_world)
        extri.write(f"T_{i}", one.t_camera_world_m)
    intri.release()
    extri.release()
    return made


def as_openpose(folder: Path) -> Path:
    """An XML file per camera: CameraMatrix is the pose (3x4), Intrinsics the lens; no size."""
    made = folder / "openpose"
    made.mkdir()
    for one in CAMERAS:
        storage = cv2.FileStorage(str(made / f"{one.name}.xml"), cv2.FILE_STORAGE_WRITE)
        storage.write("CameraMatrix", np.column_stack([one.R_camera_world, one.t_camera_world_m]))
        storage.write("Intrinsics", one.K)
        storage.write("Distortion", np.pad(one.distortion, (0, 4))[:, None])
        storage.release()
    return made


def as_opencv_tutorial(folder: Path) -> Path:
    """The names of OpenCV's tutorial, and those of scripts."""
    made = folder / "tutorial"
    made.mkdir()
    for one in CAMERAS:
        storage = cv2.FileStorage(str(made / f"{one.name}.yaml"), cv2.FILE_STORAGE_WRITE)
        storage.write("image_size", np.array([1920, 1080]))
        storage.write("Camera_Matrix", one.K)
        storage.write("Distortion_Coefficients", one.distortion[None])
        storage.write("rotation_vector", cv2.Rodrigues(one.R_camera_world)[0])
        storage.write("Translation_Vector", one.t_camera_world_m[None])
        storage.release()
    return made


@pytest.mark.parametrize(
    "write", [as_opencap, as_vicon, as_biocv, as_easymocap_by_pose2sim, as_openpose, as_opencv_tutorial]
)
def test_cameras_of_more_tools_see_what_they_saw(tmp_path: Path, write: Callable[[Path], Path]) -> None:
    found, remarks = read(write(tmp_path), up=None, size_px=(1920, 1080))
    assert [one.name for one in found] == [one.name for one in CAMERAS]
    for one, true in zip(found, CAMERAS, strict=True):
        same(one, replace(true, distortion=np.zeros(4)) if write is as_vicon else true)
    assert not any("look away" in remark for remark in remarks)


@pytest.mark.parametrize(
    "per_px",
    [
        (2.8e-7, 7.6e-14, 7.8e-20),  # as of a wide video camera: corners are 1.6 times as far out
        (1e-8, 0.0, 0.0),
        (-6e-8, 1e-14, 0.0),  # a pincushion
        (6e-7, 0.0, 0.0),
    ],
)
def test_vicons_lens_corrects_points_of_the_picture(tmp_path: Path, per_px: tuple[float, ...]) -> None:
    """x 1 + k1 r^2 + k2 r^4 + k3 r^6, r px from the principal point, is where a pinhole sees the point."""
    points_px = np.array([[0.0, 0], [1919, 0], [0, 1079], [1919, 1079], [960, 0], [300, 800], [960, 540]])
    for one, true in zip(read(as_vicon(tmp_path, per_px), up=None)[0], CAMERAS, strict=True):
        focal_px, centre_px = np.diag(true.K)[:2], true.K[:2, 2]
        from_centre_px = points_px - centre_px
        radii_px = np.linalg.norm(from_centre_px * focal_px[0] / focal_px, axis=1)
        times = 1 + radii_px[:, None] ** [2, 4, 6] @ per_px
        rays = np.column_stack([from_centre_px * times[:, None] / focal_px, np.ones(len(points_px))])
        seen_px, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), one.K, one.distortion)
        np.testing.assert_allclose(seen_px[:, 0], points_px, atol=0.1)


@pytest.mark.parametrize("per_px", [(-0.1, 0.05, 0.0), (-4e-7, 0.0, 0.0)])
def test_coefficients_that_are_not_vicons_are_refused(tmp_path: Path, per_px: tuple[float, ...]) -> None:
    """The second ones would fold the picture's corners over."""
    with pytest.raises(
        CalibrationError, match=r"VICON_RADIAL: moves a point of the picture to .* expected Vicon's"
    ):
        read(as_vicon(tmp_path, per_px))


def test_a_usual_lens_of_vicon_can_be_held(tmp_path: Path) -> None:
    names = [one.name for one in CAMERAS]
    assert list(known_lenses(as_vicon(tmp_path, (3e-8, 0.0, 0.0)), names)) == names


@pytest.mark.parametrize("write", [as_qualisys, as_vicon, as_opencap, as_biocv])
def test_a_unit_that_the_format_defines_is_the_only_one(
    tmp_path: Path, write: Callable[[Path], Path]
) -> None:
    path = write(tmp_path)
    for one, true in zip(read_loose(path).cameras, CAMERAS, strict=True):
        np.testing.assert_allclose(one.t, 1000 * true.t_camera_world_m, atol=1e-9)
    for units in ("auto", "mm"):
        for one, true in zip(read(path, units=units)[0], CAMERAS, strict=True):
            np.testing.assert_allclose(one.t_camera_world_m, true.t_camera_world_m, atol=1e-12)
    for units in ("m", "cm"):
        with pytest.raises(CalibrationError) as refused:
            read(path, units=units)
        assert str(refused.value).startswith(
            f"{path}: --units {units}: its format defines mm as its unit: leave out --units"
        )
    halved, _ = read(path, scale=0.5)
    np.testing.assert_allclose(halved[0].t_camera_world_m, CAMERAS[0].t_camera_world_m / 2, atol=1e-12)


@pytest.mark.parametrize(
    "write",
    [
        *(as_pose2sim, as_freemocap, as_caliscope, as_opencv, as_openpose, as_opencv_tutorial),
        *(as_easymocap, as_easymocap_by_pose2sim, as_colmap),
    ],
)
def test_a_unit_that_the_format_leaves_open_is_the_users(
    tmp_path: Path, write: Callable[[Path], Path]
) -> None:
    path = write(tmp_path)
    raw = read_loose(path).cameras
    for units, metres in (("m", 1.0), ("cm", 1e-2), ("mm", 1e-3)):
        found, remarks = read(path, units=units, size_px=(1920, 1080))
        assert not any("millimetres" in remark for remark in remarks)
        for one, its in zip(found, raw, strict=True):
            np.testing.assert_allclose(one.t_camera_world_m, its.t * metres, rtol=1e-12)


def test_the_size_of_a_colmap_model_says_nothing_about_its_unit(tmp_path: Path) -> None:
    path = as_colmap(tmp_path)
    images = path / "images.txt"
    rows = [line.split() for line in images.read_text().splitlines()]
    far = [[*r[:5], *(str(1000 * float(x)) for x in r[5:8]), *r[8:]] if len(r) == 10 else r for r in rows]
    images.write_text("\n".join(map(" ".join, far)))
    found, remarks = read(path)
    np.testing.assert_allclose(found[0].t_camera_world_m, 1000 * CAMERAS[0].t_camera_world_m)
    assert not any("millimetres" in remark for remark in remarks)


@pytest.mark.parametrize("protocol", [0, 2, 5])
def test_pickles_of_all_ages_are_read(tmp_path: Path, protocol: int) -> None:
    found, _ = read(as_opencap(tmp_path, protocol), up=None)
    for one, true in zip(found, CAMERAS, strict=True):
        same(one, true)


class Bomb:
    """Creates a file when it is unpickled."""

    def __reduce__(self) -> tuple[object, ...]:
        return Path.touch, (Path("ran"),)


@pytest.mark.parametrize(
    "content",
    [
        pickle.dumps({"intrinsicMat": Bomb()}),
        pickle.dumps({"intrinsicMat": np.array([Bomb()])}),
        pickle.dumps([1]),
        pickle.dumps({"rotation": np.eye(3)}),
        pickle.dumps({"rotation": np.eye(3)})[:-20],
        b"no pickle",
        b"",
    ],
)
def test_a_pickle_is_not_executed(tmp_path: Path, content: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "Cam0.pickle").write_bytes(content)
    with pytest.raises(CalibrationError, match="expected a calibration of OpenCap"):
        read(tmp_path / "Cam0.pickle")
    assert not (tmp_path / "ran").exists()


def test_a_camera_without_a_pose_is_left_out_and_said(tmp_path: Path) -> None:
    path = as_caliscope(tmp_path)
    tables = tomllib.loads(path.read_text())
    for field in ("rotation", "translation"):
        del tables["cameras"]["1"][field]
    path.write_text(tomli_w.dumps(tables))
    found, remarks = read(path)
    assert [one.name for one in found] == ["cam_0", "cam_2"]
    assert any("[cameras.1]: has no pose" in remark for remark in remarks)


@pytest.mark.parametrize(
    ("write", "element", "zero", "fields"),
    [
        (as_qualisys, "transform", r"(r[123][123])", "transform, intrinsic"),
        (as_qualisys, "intrinsic", r"(\w+)", "transform, intrinsic"),
        (as_vicon, "KeyFrame", r"(ORIENTATION)", "ORIENTATION, FOCAL_LENGTH"),
        (as_vicon, "KeyFrame", r"(FOCAL_LENGTH)", "ORIENTATION, FOCAL_LENGTH"),
    ],
)
def test_a_camera_whose_numbers_are_zero_is_left_out_and_said(
    tmp_path: Path, write: Callable[[Path], Path], element: str, zero: str, fields: str
) -> None:
    path = write(tmp_path)
    before, mark, rest = path.read_text().rpartition(f"<{element} ")
    tag, end, after = rest.partition("/>")
    zeros = re.sub(
        f'\\b{zero}="([^"]*)"', lambda found: f'{found[1]}="{" ".join("0" for _ in found[2].split())}"', tag
    )
    assert zeros != tag
    path.write_text(before + mark + zeros + end + after)
    found, remarks = read(path)
    assert [one.name for one in found] == [one.name for one in CAMERAS[:-1]]
    said = f"{path}: camera {CAMERAS[-1].name}: has no pose or lens ({fields}) and is left out"
    assert said in remarks


def test_another_tools_file_as_calibration_toml_is_answered_with_the_line_to_type(
    small_take: Callable[..., Path], refusal: Callable[[Path], str]
) -> None:
    folder = small_take()
    as_freemocap(folder).rename(folder / "calibration.toml")
    assert refusal(folder).endswith(
        "; if another tool wrote this file, rename it and type: xormocap calibrate --import "
        f"{folder}/other.toml --out {folder}/calibration.toml"
    )
    as_caliscope(folder).rename(folder / "calibration.toml")
    assert "xormocap calibrate --import" in refusal(folder)


@pytest.mark.parametrize(
    ("written", "is_fisheye"), [("False", False), ("no", False), ("1", True), ("TRUE", True)]
)
def test_a_fisheye_lens_and_rows_of_a_matrix_in_an_opencv_file(
    tmp_path: Path, written: str, is_fisheye: bool
) -> None:
    path = tmp_path / "cam1.yml"
    path.write_text(
        "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\nK: [[600, 0, 320], [0, 600, 240], [0, 0, 1]]\n"
        f"dist: [0.1, 0.0, 0.0, 0.0]\nrvec: [0.1, 0.2, 0.3]\ntvec: [0, 0, 3]\nfisheye: {written}\n"
    )
    (found,) = read_loose(path).cameras
    assert found.fisheye == is_fisheye
    assert found.K.tolist() == [[600, 0, 320], [0, 600, 240], [0, 0, 1]]
