"""Calibrations of other tools. Each test writes the layout that its reader relies on, and says what it is."""

from collections.abc import Callable
from pathlib import Path
from xml.sax.saxutils import quoteattr

import cv2
import numpy as np
import pytest
import tomli_w
from scipy.spatial.transform import Rotation

from services.mocap.camera.calibration import read_calibration, write_opencv, write_pose2sim
from services.mocap.camera.camera import Camera
from services.mocap.camera.formats import read_any
from services.mocap.errors import CalibrationError

POINTS_M = np.random.default_rng(0).uniform(-0.8, 0.8, (40, 3)) + np.array([0, 0, 1])


def camera(name: str, angle: float, distortion: tuple[float, ...] = (-0.1, 0.05, 0.001, -0.002)) -> Camera:
    centre_m = np.array([4 * np.cos(angle), 4 * np.sin(angle), 1.7])
    ahead = np.array([0, 0, 1.0]) - centre_m
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    R = np.stack([right, np.cross(ahead, right), ahead])
    K = np.array([[1400.0, 0, 950.0], [0, 1401.0, 530.0], [0, 0, 1]])
    return Camera(name, 1920, 1080, K, np.array(distortion), R, -R @ centre_m)


CAMERAS = (camera("left", 0.3), camera("middle", 1.4), camera("right", 2.6))


def same(found: Camera, true: Camera, tolerance_px: float = 1e-6) -> None:
    """Both see the same points in the same pixels, lens included."""
    assert (found.width_px, found.height_px, found.fisheye) == (true.width_px, true.height_px, true.fisheye)
    pixels = []
    for one in (found, true):
        project = cv2.fisheye.projectPoints if one.fisheye else cv2.projectPoints
        turn = cv2.Rodrigues(one.R_camera_world)[0]
        pixels.append(project(POINTS_M[:, None], turn, one.t_camera_world_m, one.K, one.distortion)[0])
    np.testing.assert_allclose(pixels[0], pixels[1], atol=tolerance_px)


def read(path: Path, **said: object) -> tuple[tuple[Camera, ...], list[str]]:
    given = {"kind": None, "size_px": None, "units": "auto", "scale": 1.0, "up": "z"} | said
    return read_any(path, **given)  # type: ignore[arg-type]


def table(camera: Camera, unit: float = 1.0) -> dict[str, object]:
    """anipose and Pose2Sim: world to camera, a rotation vector."""
    return {
        "name": camera.name,
        "size": [float(camera.width_px), float(camera.height_px)],
        "matrix": camera.K.tolist(),
        "distortions": [*camera.distortion.tolist(), 0.0],
        "rotation": Rotation.from_matrix(camera.R_camera_world).as_rotvec().tolist(),
        "translation": (camera.t_camera_world_m * unit).tolist(),
        "fisheye": camera.fisheye,
    }


def as_pose2sim(folder: Path) -> Path:
    """A table per camera, metres, then metadata."""
    path = folder / "Calib.toml"
    tables = {f"cam_{i}": table(one) for i, one in enumerate(CAMERAS)}
    path.write_text(tomli_w.dumps({**tables, "metadata": {"adjusted": False, "error": 0.2}}))
    return path


def as_freemocap(folder: Path) -> Path:
    """anipose's tables in millimetres, with fields of FreeMoCap's own."""
    path = folder / "camera_calibration_data.toml"
    tables = {
        f"cam_{i}": {**table(one, 1000.0), "world_position": [0.0, 0.0, 0.0]} for i, one in enumerate(CAMERAS)
    }
    path.write_text(tomli_w.dumps({**tables, "metadata": {"charuco_square_size": 39.0}}))
    return path


def as_caliscope(folder: Path) -> Path:
    """cameras.<number>, metres, no names, ignored cameras without a place."""
    path = folder / "camera_array.toml"
    cameras = {}
    for i, one in enumerate(CAMERAS):
        fields = {k: v for k, v in table(one).items() if k != "name"}
        cameras[str(i)] = {"cam_id": i, **fields, "size": [1920, 1080], "rotation_count": 0, "ignore": False}
    cameras["7"] = {"cam_id": 7, "matrix": CAMERAS[0].K.tolist(), "distortions": [0.0] * 5, "ignore": True}
    path.write_text(tomli_w.dumps({"cameras": cameras}))
    return path


def as_opencv(folder: Path) -> Path:
    """One FileStorage per camera, here XML with names as in OpenCV's calibration sample, and rvec, tvec."""
    made = folder / "opencv"
    made.mkdir()
    for one in CAMERAS:
        storage = cv2.FileStorage(str(made / f"{one.name}.xml"), cv2.FILE_STORAGE_WRITE)
        storage.write("image_width", 1920)
        storage.write("image_height", 1080)
        storage.write("camera_matrix", one.K)
        storage.write("distortion_coefficients", np.append(one.distortion, 0.0)[:, None])
        storage.write("rvec", cv2.Rodrigues(one.R_camera_world)[0])
        storage.write("tvec", one.t_camera_world_m[:, None])
        storage.release()
    return made


def as_easymocap(folder: Path) -> Path:
    """intri.yml: names, K_x, dist_x (1x5), H_x and W_x; extri.yml: names, R_x (vector), Rot_x, T_x (3x1)."""
    made = folder / "easymocap"
    made.mkdir()
    names = [one.name for one in CAMERAS]
    intri = cv2.FileStorage(str(made / "intri.yml"), cv2.FILE_STORAGE_WRITE)
    extri = cv2.FileStorage(str(made / "extri.yml"), cv2.FILE_STORAGE_WRITE)
    for storage in (intri, extri):
        storage.write("names", names)
    for one in CAMERAS:
        intri.write(f"K_{one.name}", one.K)
        intri.write(f"dist_{one.name}", np.append(one.distortion, 0.0)[None])
        intri.write(f"H_{one.name}", 1080)
        intri.write(f"W_{one.name}", 1920)
        extri.write(f"R_{one.name}", cv2.Rodrigues(one.R_camera_world)[0])
        extri.write(f"Rot_{one.name}", one.R_camera_world)
        extri.write(f"T_{one.name}", one.t_camera_world_m[:, None])
    intri.release()
    extri.release()
    return made


def as_qualisys(folder: Path) -> Path:
    """Millimetres, 64ths of pixels, a camera with x right, y up, z backwards; rows of r are its axes."""
    tags = []
    for one in CAMERAS:
        axes = np.diag([1.0, -1.0, -1.0]) @ one.R_camera_world
        place = dict(zip("xyz", 1000 * one.centre_world_m, strict=True))
        place |= {f"r{i + 1}{j + 1}": axes[i, j] for i in range(3) for j in range(3)}
        k1, k2, p1, p2 = one.distortion
        lens = {
            "focalLengthU": 64 * one.K[0, 0],
            "focalLengthV": 64 * one.K[1, 1],
            "centerPointU": 64 * one.K[0, 2],
            "centerPointV": 64 * one.K[1, 2],
            "skew": 0.0,
            "radialDistortion1": k1,
            "radialDistortion2": k2,
            "radialDistortion3": 0.0,
            "tangentalDistortion1": p1,
            "tangentalDistortion2": p2,
        }
        fov = {"left": 0, "top": 0, "right": 1919, "bottom": 1079}
        inner = "".join(
            f"<{name} " + " ".join(f"{key}={quoteattr(str(value))}" for key, value in values.items()) + "/>"
            for name, values in (("fov_video", fov), ("transform", place), ("intrinsic", lens))
        )
        tags.append(
            f'<camera active="1" serial="{one.name}" model="Miqus Video" viewrotation="0">{inner}</camera>'
        )
    path = folder / "session.qca.txt"
    text = (
        f'<?xml version="1.0"?><calibration type="regular"><cameras>{"".join(tags)}</cameras></calibration>'
    )
    path.write_text(text)
    return path


def as_colmap(folder: Path) -> Path:
    """Quaternion w first, world to camera; two lines an image; pixel centres at halves."""
    made = folder / "colmap"
    made.mkdir()
    lenses, images = ["# a comment"], ["# another"]
    for i, one in enumerate(CAMERAS):
        (fx, _, cx), (_, fy, cy), _ = one.K
        values = " ".join(f"{value!r}" for value in map(float, (fx, fy, cx + 0.5, cy + 0.5, *one.distortion)))
        lenses.append(f"{i + 1} OPENCV 1920 1080 {values}")
        x, y, z, w = Rotation.from_matrix(one.R_camera_world).as_quat()
        place = " ".join(f"{value!r}" for value in map(float, (w, x, y, z, *one.t_camera_world_m)))
        images += [f"{i + 5} {place} {i + 1} {one.name}/000000.jpg", "10.5 20.5 -1" if i else ""]
    (made / "cameras.txt").write_text("\n".join(lenses) + "\n")
    (made / "images.txt").write_text("\n".join(images) + "\n")
    return made


@pytest.mark.parametrize(
    ("write", "names"),
    [
        (as_pose2sim, None),
        (as_freemocap, None),
        (as_caliscope, ["cam_0", "cam_1", "cam_2"]),
        (as_opencv, None),
        (as_easymocap, None),
        (as_qualisys, None),
        (as_colmap, None),
    ],
)
def test_cameras_of_other_tools_see_what_they_saw(
    tmp_path: Path, write: Callable[[Path], Path], names: list[str] | None
) -> None:
    found, remarks = read(write(tmp_path))
    assert [one.name for one in found] == (names or [one.name for one in CAMERAS])
    for one, true in zip(found, CAMERAS, strict=True):
        same(one, true)
    assert not any("look away" in remark for remark in remarks)


def test_millimetres_are_noticed_and_said(tmp_path: Path) -> None:
    _, remarks = read(as_freemocap(tmp_path))
    assert any("millimetres" in remark for remark in remarks)
    found, _ = read(as_freemocap(tmp_path), units="cm")
    assert np.linalg.norm(found[0].centre_world_m) == pytest.approx(
        10 * np.linalg.norm(CAMERAS[0].centre_world_m)
    )


@pytest.mark.parametrize("up", ["z", "y"])
def test_what_is_written_is_read_again(tmp_path: Path, up: str) -> None:
    fisheye = Camera(
        "fish", 1280, 960, CAMERAS[0].K, np.array([0.1, 0.01, 0.0, 0.002]), *_place(), fisheye=True
    )
    cameras = (*CAMERAS, fisheye)
    write_opencv(tmp_path / "opencv", cameras, up)
    write_pose2sim(tmp_path / "pose2sim.toml", cameras, up)
    for path in (tmp_path / "opencv", tmp_path / "pose2sim.toml"):
        found, _ = read(path, up=up)
        for true in cameras:
            same(next(one for one in found if one.name == true.name), true)
    ours = read_calibration(tmp_path / "pose2sim.toml", up)  # its metadata are passed over
    for one, true in zip(ours, cameras, strict=True):
        same(one, true)


def _place() -> tuple[np.ndarray, np.ndarray]:
    return CAMERAS[1].R_camera_world, CAMERAS[1].t_camera_world_m


def test_a_world_that_is_scaled_and_stands_otherwise(tmp_path: Path) -> None:
    """COLMAP's y often points down: its point (x, y, z) is ours (x, z, -y), times metres per unit."""
    half = tuple(
        Camera(c.name, 1920, 1080, c.K, c.distortion, c.R_camera_world @ turned, c.t_camera_world_m / 2)
        for c in CAMERAS
        for turned in [np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]])]
    )
    write_opencv(tmp_path / "opencv", half, "z")
    found, _ = read(tmp_path / "opencv", scale=2.0, up="-y")
    for true in CAMERAS:
        same(next(one for one in found if one.name == true.name), true)


def _broken(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text)
    return path


def _xcp(attributes: str) -> str:
    return f"<C><Camera {attributes}><KeyFrames><KeyFrame/></KeyFrames></Camera></C>"


def _qca(left: str) -> str:
    return f'<c><camera><intrinsic/><fov_video left="{left}" top="0" right="9" bottom="9"/></camera></c>'


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("c.toml", "[a]\nb = 1\n", "contains no camera"),
        ("c.toml", "[a]\nmatrix = [[1.0]]\ndistortions = []\n", "[a] rotation: is missing"),
        ("c.qca.txt", "<calibration", "is not XML"),
        ("c.qca.txt", "<!DOCTYPE x [<!ENTITY e 'e'>]><calibration/>", "declares a document type"),
        ("c.qca.txt", "<!-- <!DOCTYPE x> --><c><camera><intrinsic/></camera></c>", "fov_video: is missing"),
        ("c.qca.txt", "<c><camera><intrinsic/></camera></c>", "fov_video: is missing"),
        ("c.yml", "%YAML:1.0\n---\nK: 3\n", "has no rotation"),
        ("c.yml", "nothing", "FileStorage"),
        ("c.xcp", "<Cameras/>", "contains no camera"),
        ("c.xcp", '<C><Camera DEVICEID="7"><KeyFrames><KeyFrame/></KeyFrames></Camera></C>', "SENSOR_SIZE"),
        ("c.calib", "1920 1080 1 0", "has 4 numbers"),
        ("c.xcp", _xcp('SENSOR_SIZE="1920"'), "SENSOR_SIZE: expected numbers of shape (2,), found ['1920']"),
        ("c.xcp", _xcp('SENSOR_SIZE="1920 nan"'), "SENSOR_SIZE: expected finite numbers"),
        ("c.qca.txt", _qca("1,5"), "fov_video left: expected a number, found '1,5'"),
        ("c.qca.txt", _qca("inf"), "fov_video left: expected finite numbers"),
        ("c.toml", "[a]\nmatrix = [1, 2]\ndistortions = []\nrotation = 0\ntranslation = 0\n", "found [1, 2]"),
        ("c.doc", "", "is not a known calibration format"),
    ],
)
def test_what_cannot_be_read_is_said(tmp_path: Path, name: str, text: str, said: str) -> None:
    with pytest.raises(CalibrationError) as refused:
        read(_broken(tmp_path, name, text))
    assert said in str(refused.value)


@pytest.mark.parametrize(
    ("camera", "said"),
    [
        ("1 OPENCV", "model OPENCV: expected 8 parameters, found 0"),
        ("1 PINHOLE 1920 1080 1400 1400 950", "model PINHOLE: expected 4 parameters, found 3"),
        ("1 PINHOLE 1920 1080 1400 1400 950 wide", "left: expected numbers, found ['1920', '1080'"),
        ("1", "model ?: cannot be used"),
    ],
)
def test_a_damaged_colmap_model_is_said(tmp_path: Path, camera: str, said: str) -> None:
    path = as_colmap(tmp_path)
    (path / "cameras.txt").write_text(f"{camera}\n2 {camera[2:]}\n3 {camera[2:]}\n")
    with pytest.raises(CalibrationError) as refused:
        read(path)
    assert str(refused.value).startswith(f"{path}/cameras.txt: {said}")


def test_a_missing_file_is_said_and_an_unknown_one_gets_the_names_of_all_formats(tmp_path: Path) -> None:
    for kind in (None, "toml", "biocv"):
        with pytest.raises(CalibrationError) as refused:
            read(tmp_path / "nowhere.doc", kind=kind)
        assert str(refused.value) == (
            f"{tmp_path}/nowhere.doc: is missing: expected a calibration, a file or a folder"
        )
    with pytest.raises(CalibrationError) as refused:
        read(_broken(tmp_path, "c.doc", ""))
    assert str(refused.value).endswith(
        ": .toml, .qca.txt, .qca, .xcp, intri.yml with extri.yml, cameras.txt with images.txt, .pickle, "
        ".calib, .xml, .yml, .yaml"
    )


def test_a_size_is_asked_for(tmp_path: Path) -> None:
    with pytest.raises(CalibrationError, match="give --size"):
        read(_without_sizes(tmp_path))
    found, _ = read(_without_sizes(tmp_path), size_px=(1920, 1080))
    same(found[0], CAMERAS[0])


def _without_sizes(folder: Path) -> Path:
    tables = {one.name: {k: v for k, v in table(one).items() if k != "size"} for one in CAMERAS}
    return _broken(folder, "unsized.toml", tomli_w.dumps(tables))
