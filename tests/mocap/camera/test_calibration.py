import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from services.mocap.camera.calibration import Up, read_calibration, write_calibration
from services.mocap.camera.camera import R_ZUP_YUP, Camera
from services.mocap.errors import CalibrationError, UserError

TABLE: dict[str, Any] = {
    "name": "cam01",
    "size": [320, 240],
    "matrix": [[300.0, 0.0, 160.0], [0.0, 301.0, 120.0], [0.0, 0.0, 1.0]],
    "distortions": [0.1, -0.2, 0.001, 0.002],
    "rotation": [0.1, -1.2, 0.4],
    "translation": [0.0, 1.0, 4.0],
    "fisheye": False,
}


def numbers(n: int, largest: float) -> st.SearchStrategy[np.ndarray]:
    return st.lists(st.floats(-largest, largest), min_size=n, max_size=n).map(np.array)


@st.composite
def camera_rings(draw: st.DrawFn) -> tuple[Camera, ...]:
    names = draw(st.lists(st.text("abcXYZ019_- é[]\"'#", min_size=1), min_size=1, max_size=4, unique=True))
    cameras = []
    for name in names:
        width, height = draw(st.integers(2, 5000)), draw(st.integers(2, 5000))
        fx, fy = draw(st.floats(1.0, 1e4)), draw(st.floats(1.0, 1e4))
        cx, cy = draw(st.floats(0, 1)) * (width - 1), draw(st.floats(0, 1)) * (height - 1)
        fisheye = draw(st.booleans())
        cameras.append(
            Camera(
                name=name,
                width_px=width,
                height_px=height,
                K=np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]),
                distortion=draw(numbers(4 if fisheye else draw(st.sampled_from([4, 5, 8])), 1.0)),
                R_camera_world=Rotation.from_rotvec(draw(numbers(3, 10.0))).as_matrix(),
                t_camera_world_m=draw(numbers(3, 20.0)),
                fisheye=fisheye,
            )
        )
    return tuple(cameras)


@given(camera_rings(), st.sampled_from(["y", "z"]))
def test_cameras_come_back_as_they_were_written(cameras: tuple[Camera, ...], up: Up) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "calibration.toml"
        write_calibration(path, cameras, up)
        again = read_calibration(path, up)
    assert [camera.name for camera in again] == [camera.name for camera in cameras]
    for camera, read in zip(cameras, again, strict=True):
        assert (read.width_px, read.height_px, read.fisheye) == (
            camera.width_px,
            camera.height_px,
            camera.fisheye,
        )
        np.testing.assert_array_equal(read.K, camera.K)
        np.testing.assert_array_equal(read.distortion, camera.distortion)
        np.testing.assert_array_equal(read.t_camera_world_m, camera.t_camera_world_m)
        np.testing.assert_allclose(read.R_camera_world, camera.R_camera_world, atol=1e-12)


def write(path: Path, *tables: dict[str, Any], **other: Any) -> Path:
    path.write_text(tomli_w.dumps({f"t{i}": table for i, table in enumerate(tables)} | other), "utf-8")
    return path


def test_a_point_of_a_y_up_world_is_seen_in_the_same_pixel_once_turned(tmp_path: Path) -> None:
    path = write(tmp_path / "calibration.toml", TABLE)
    (as_it_is,), (turned,) = read_calibration(path, "z"), read_calibration(path, "y")
    points_yup_m = np.random.default_rng(0).normal(size=(50, 3))
    np.testing.assert_allclose(
        turned.project_px(points_yup_m @ R_ZUP_YUP.T), as_it_is.project_px(points_yup_m), atol=1e-9
    )
    assert turned.centre_world_m[2] == pytest.approx(as_it_is.centre_world_m[1])  # up in either world


def test_a_rotation_matrix_means_the_same_as_its_vector(tmp_path: Path) -> None:
    matrix = Rotation.from_rotvec(TABLE["rotation"]).as_matrix()
    printed = [[round(value, 4) for value in row] for row in matrix.tolist()]
    (camera,) = read_calibration(write(tmp_path / "calibration.toml", TABLE | {"rotation": printed}), "z")
    np.testing.assert_allclose(camera.R_camera_world, matrix, atol=1e-4)
    np.testing.assert_allclose(camera.R_camera_world @ camera.R_camera_world.T, np.eye(3), atol=1e-12)


def test_other_tables_are_passed_over_and_the_order_is_the_files(tmp_path: Path) -> None:
    second = {key: value for key, value in TABLE.items() if key not in ("name", "fisheye")}
    path = write(
        tmp_path / "calibration.toml",
        TABLE | {"name": "z"},
        second,
        metadata={"adjusted": False, "error": 0.3},
    )
    assert [camera.name for camera in read_calibration(path, "z")] == ["z", "t1"]  # no name: the table's key


def test_the_shared_takes_calibrations_look_at_a_stage_from_around_it(shared_takes: Path) -> None:
    for take, n_cameras in (("studio-a", 8), ("balance", 4), ("balance-static", 4)):
        cameras = read_calibration(shared_takes / take / "calibration.toml", "z")
        assert len(cameras) == n_cameras
        for camera in cameras:
            x, y = camera.project_px(np.array([0.0, 0.0, 1.0]))
            assert 0 <= x < camera.width_px
            assert 0 <= y < camera.height_px
            assert 0.5 < camera.centre_world_m[2] < 3.0


MIRROR = np.diag([1.0, 1.0, -1.0]).tolist()


@pytest.mark.parametrize(
    ("change", "parts"),
    [
        ({"rotation": MIRROR}, ("rotation: not a rotation", "determinant -1", "mirrored", "export it again")),
        ({"rotation": (2 * np.eye(3)).tolist()}, ("rotation: not a rotation", "orthonormal")),
        ({"rotation": [0.1, 0.2]}, ("rotation: expected 3 finite numbers", "found [0.1, 0.2]")),
        ({"rotation": [0.1, float("nan"), 0.2]}, ("rotation: expected 3 finite numbers", "nan")),
        ({"translation": [0.0, float("inf"), 1.0]}, ("translation: expected 3 finite numbers in metres",)),
        ({"translation": "0 0 1"}, ("translation: expected 3 finite numbers", "found '0 0 1'")),
        ({"size": [320, 240.5]}, ("size: expected [width, height] in integer pixels", "240.5")),
        ({"size": [320, -240]}, ("size: expected", "-240")),
        ({"size": [320]}, ("size: expected [width, height]",)),
        ({"matrix": [[1.0, 2.0], [3.0, 4.0]]}, ("matrix: expected the 3x3 camera matrix",)),
        (
            {"matrix": [[-3.0, 0, 160.0], [0, 3.0, 120.0], [0, 0, 1]]},
            ("matrix: expected positive focal", "-3"),
        ),
        ({"matrix": [[3.0, 0, 160.0], [0, 3.0, 120.0], [0, 1, 1]]}, ("matrix: expected [[fx, 0, cx]",)),
        ({"matrix": [[3.0, 9.0, 160.0], [0, 3.0, 120.0], [0, 0, 1]]}, ("matrix: expected [[fx, 0, cx]",)),
        (
            {"matrix": [[3.0, 0, 160.0], [0, 3.0, 400.0], [0, 0, 1]]},
            ("matrix: the principal point (160, 400) is outside the picture of 320x240",),
        ),
        ({"distortions": [0.1] * 6}, ("distortions: expected 4, 5 or 8 numbers, found 6",)),
        (
            {"distortions": [0.1] * 5, "fisheye": True},
            ("distortions: expected 4 numbers for a fisheye lens",),
        ),
        ({"fisheye": "no"}, ("fisheye: expected true or false, found 'no'",)),
        ({"name": "../cam"}, ("name: expected a name that can be a file's name, found '../cam'",)),
        ({"distortion": [0.0]}, ("distortion: unknown field: did you mean distortions",)),
        ({"translation": [0.0, 1000.0, 4000.0]}, ("translation: this camera stands", "divide by 1000")),
        ({"name": "cam00"}, ("name: cam00 is also the name in [t0]",)),
    ],
)
def test_a_bad_table_is_refused_in_one_sentence(
    tmp_path: Path, change: dict[str, Any], parts: tuple[str, ...]
) -> None:
    path = write(tmp_path / "calibration.toml", TABLE | {"name": "cam00"}, TABLE | change)
    with pytest.raises(CalibrationError) as refused:
        read_calibration(path, "z")
    sentence = str(refused.value)
    assert sentence.startswith(f"{path}: [t1] ")
    assert all(part in sentence for part in parts), sentence
    assert "\n" not in sentence
    assert ". " not in sentence
    assert isinstance(refused.value, UserError)


@pytest.mark.parametrize("field", ["size", "matrix", "distortions", "rotation", "translation"])
def test_a_missing_field_is_named(tmp_path: Path, field: str) -> None:
    table = {key: value for key, value in TABLE.items() if key != field}
    with pytest.raises(CalibrationError, match=rf"calibration.toml: \[t0\] {field}: is missing: expected "):
        read_calibration(write(tmp_path / "calibration.toml", table), "z")


@pytest.mark.parametrize(
    ("content", "part"),
    [
        (b"", "contains no camera"),
        (b"[metadata]\nerror = 0.0\n", "contains no camera"),
        (b"[cam01\n", "not valid TOML"),
        (b"\xff\xfe[cam01]", "UTF-8"),
    ],
)
def test_a_file_without_cameras_is_refused(tmp_path: Path, content: bytes, part: str) -> None:
    path = tmp_path / "calibration.toml"
    path.write_bytes(content)
    with pytest.raises(CalibrationError, match=part) as refused:
        read_calibration(path, "z")
    assert str(refused.value).startswith(f"{path}: ")
    assert "\n" not in str(refused.value)


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(CalibrationError, match=r"calibration.toml: is missing"):
        read_calibration(tmp_path / "calibration.toml", "z")
