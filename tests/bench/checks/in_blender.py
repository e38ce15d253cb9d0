"""Runs inside Blender: imports files of motion and writes where Blender puts their joints.

`blender --background --factory-startup --python in_blender.py -- FRAMES FPS OUT.json FILE…`. The output has
for each file the names of its joints, and their places in Blender's world as [frame][joint][xyz]. A bone is
named by where it begins, its end with .tip behind the name.
"""

import importlib
import importlib.util
import json
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy


def places_of(file: Path, n_frames: int, fps: float) -> tuple[list[str], list[list[list[float]]]]:
    """Names and places of a file's joints in each frame."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    if file.suffix == ".bvh":
        _mend_bvh_importer()
        bpy.ops.import_anim.bvh(filepath=str(file), frame_start=1, axis_forward="-Z", axis_up="Y")
        at = [1.0 + n for n in range(n_frames)]
    else:
        _lend_numpy()
        bpy.ops.import_scene.gltf(filepath=str(file))
        scene_fps = scene.render.fps / scene.render.fps_base
        at = [n * scene_fps / fps for n in range(n_frames)]
    found = []
    for frame in at:
        scene.frame_set(int(frame), subframe=frame - int(frame))
        found.append(dict(_bones()))
    names = list(found[0])
    return names, [[row[name] for name in names] for row in found]


def _mend_bvh_importer() -> None:
    """Blender 3.4 opens BVH files in a mode that Python 3.11, which Debian gives it, no longer knows."""
    vars(importlib.import_module("io_anim_bvh.import_bvh"))["open"] = _open


def _open(path: str, mode: str = "r", **named: Any) -> Any:
    return Path(path).open(mode.replace("U", ""), **named)


def _lend_numpy() -> None:
    """The glTF importer needs NumPy, which Debian's Blender only recommends: the caller has one."""
    if importlib.util.find_spec("numpy") is None:
        sys.path.append(os.environ["XORMOCAP_PACKAGES"])


def _bones() -> Iterator[tuple[str, list[float]]]:
    armature = next(thing for thing in bpy.data.objects if thing.type == "ARMATURE")
    for bone in armature.pose.bones:
        yield bone.name, list(armature.matrix_world @ bone.head)
        yield f"{bone.name}.tip", list(armature.matrix_world @ bone.tail)


def main(arguments: list[str]) -> None:
    """Import all files and write what was found."""
    n_frames, fps, out = int(arguments[0]), float(arguments[1]), Path(arguments[2])
    results = {}
    for file in arguments[3:]:
        names, places = places_of(Path(file), n_frames, fps)
        results[file] = {"names": names, "places": places}
    out.write_text(json.dumps(results))


if __name__ == "__main__":
    main(sys.argv[sys.argv.index("--") + 1 :])
