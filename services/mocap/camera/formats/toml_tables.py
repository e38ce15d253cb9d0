"""TOML calibrations: Pose2Sim, anipose, FreeMoCap (a table per camera), caliscope (tables in a table)."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from services.mocap.camera.formats.loose import Loose, LooseCamera, Reader
from services.mocap.camera.formats.parsing import array_of, has_suffix, rotation_of
from services.mocap.errors import CalibrationError, load_toml

_SUFFIXES = (".toml",)
_LENS = {"matrix", "distortions"}
_NAMES = ("name", "port", "cam_id")


def read_toml(path: Path, *, needs_pose: bool = True) -> Loose:
    """Every table with a lens (matrix, distortions) but those with ignore = true.

    needs_pose: whether those without a pose are left out, too.
    """
    cameras: list[LooseCamera] = []
    remarks, unposed = [], []
    for key, table in _tables(load_toml(path, CalibrationError), ""):
        if table.get("ignore") is True:
            remarks.append(f"{path}: [{key}]: has ignore = true and is skipped")
        elif not table.keys() >= _LENS:
            remarks.append(f"{path}: [{key}]: has no lens (matrix, distortions) and is left out")
        elif "rotation" not in table and "translation" not in table:
            if needs_pose:
                unposed.append(key)
            else:
                no_pose = {"rotation": [0.0] * 3, "translation": [0.0] * 3}
                cameras.append(_camera(f"{path}: [{key}]", key, table | no_pose))
        else:
            cameras.append(_camera(f"{path}: [{key}]", key, table))
    if unposed and not cameras:
        raise CalibrationError(
            f"{path}: [{unposed[0]}] rotation: is missing: the poses of its cameras are not known: calibrate "
            "their extrinsics there"
        )
    remarks += [f"{path}: [{key}]: has no pose (rotation, translation) and is left out" for key in unposed]
    return Loose(cameras, metres=None, remarks=tuple(remarks))


TOML = Reader(read_toml, lambda path: has_suffix(path, _SUFFIXES), _SUFFIXES)


def _tables(tables: dict[str, Any], before: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Tables of cameras and their keys, however deep."""
    for key, table in tables.items():
        if not isinstance(table, dict):
            continue
        if table.keys() >= _LENS or (
            "size" in table and not any(isinstance(v, dict) for v in table.values())
        ):
            yield f"{before}{key}", table
        else:
            yield from _tables(table, f"{before}{key}.")


def _camera(where: str, key: str, table: dict[str, Any]) -> LooseCamera:
    missing = [field for field in ("rotation", "translation") if table.get(field) is None]
    if missing:
        raise CalibrationError(
            f"{where} {missing[0]}: is missing: this camera's pose is not known: calibrate its extrinsics "
            "there"
        )
    said = next((table[name] for name in _NAMES if name in table), None)
    last = key.rsplit(".", 1)[-1]
    if said is not None and last.isdecimal():
        last = f"cam_{last}"  # caliscope's, whose key is only its number
    name = said if isinstance(said, str) else last
    size = None
    if "size" in table:
        width, height = array_of(table["size"], (2,), f"{where} size")
        size = round(width), round(height)
    return LooseCamera(
        name=name,
        K=array_of(table["matrix"], (3, 3), f"{where} matrix"),
        distortion=array_of(table["distortions"], (-1,), f"{where} distortions"),
        R=rotation_of(table["rotation"], f"{where} rotation"),
        t=array_of(table["translation"], (3,), f"{where} translation"),
        size_px=size,
        fisheye=table.get("fisheye") is True,
    )
