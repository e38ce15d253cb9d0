"""Where Blender puts the joints of motion.bvh and motion.glb."""

import json
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bench.checks.tools import own_packages, run
from services.mocap.body.humanoid_names import Naming, bone_names
from services.mocap.body.skeleton import SEGMENT_JOINT
from services.mocap.take.tables import REFERENCE_JOINTS
from services.mocap.types import Floats

_SCRIPT = Path(__file__).with_name("in_blender.py")
_R_BLENDER_WORLD: Floats = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""Blender turns y-up files upright: who faces z there, or x in our z-up world, faces -y, towards its front
view."""
_SEGMENT_AT = {joint: segment for segment, joint in SEGMENT_JOINT.items()} | {"head_top": "head_top"}


def imported(
    program: Path, files: Sequence[Path], n_frames: int, fps: float
) -> dict[Path, dict[str, Floats]]:
    """Import files in one run of Blender; by file and joint's name in it the places (N, 3) in our world.

    Lengths are the file's. Raises UserError where Blender fails.
    """
    with tempfile.TemporaryDirectory(prefix="xormocap-blender-") as folder:
        out = Path(folder) / "places.json"
        begin = ("--background", "--factory-startup", "--python-exit-code", "1", "--python", str(_SCRIPT))
        asked = (str(n_frames), repr(fps), str(out), *map(str, files))
        run([str(program), *begin, "--", *asked], XORMOCAP_PACKAGES=own_packages())
        found = json.loads(out.read_text())
    return {
        file: dict(
            zip(found[str(file)]["names"], _to_world(np.array(found[str(file)]["places"])), strict=True)
        )
        for file in files
    }


def _to_world(places: Floats) -> Floats:
    """(J, N, 3) in our world, of places (N, J, 3) in Blender's."""
    turned: Floats = np.moveaxis(places @ _R_BLENDER_WORLD, 1, 0)
    return turned


def bvh_joints(places: dict[str, Floats], naming: Naming) -> Floats:
    """The joints of joints.csv (N, 15, 3) among those of an imported .bvh file."""
    names = bone_names(naming)
    names["head_top"] = f"{names['head']}.tip"
    return np.stack([places[names[joint]] for joint in REFERENCE_JOINTS], axis=1)


def glb_joints(places: dict[str, Floats]) -> Floats:
    """The joints of joints.csv (N, 15, 3) among the nodes of an imported .glb file."""
    return np.stack([places[_SEGMENT_AT[joint]] for joint in REFERENCE_JOINTS], axis=1)
