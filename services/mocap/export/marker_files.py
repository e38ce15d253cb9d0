"""Joint centres as markers: in a C3D file, and in a TRC file as OpenSim and other biomechanics tools read it.

Lengths are millimetres. Axes of the C3D file are those of the world inside: z up, x where an actor with
heading zero faces; the file states this in POINT:X_SCREEN and POINT:Y_SCREEN. Axes of the TRC file are those
of motion.bvh: y up, as OpenSim requires; z is where an actor with heading zero faces.
"""

from pathlib import Path

import ezc3d
import numpy as np

from services.mocap.atomic import atomic_file
from services.mocap.errors import UserError
from services.mocap.motion.motion import Motion, to_y_up
from services.mocap.take.tables import REFERENCE_JOINTS, reference_joints

_MM_PER_M = 1000.0
_MOST_FRAMES = 2**16 - 1


def write_c3d(path: Path, motion: Motion) -> None:
    """Write the joints of joints.csv, completely or not at all; raises UserError for more than 65,535 frames.

    Frames are counted from 1 in such files: the take's frame 0 is frame 1. Where the last number would be too
    large for the format, the motion's first frame is 1.
    """
    n_frames = len(motion.frames)
    if n_frames > _MOST_FRAMES:
        raise UserError(
            f"{path.name}: cannot hold {n_frames} frames: the format ends at {_MOST_FRAMES}: use another"
        )
    joints_mm = _MM_PER_M * reference_joints(motion.poses, motion.body.offsets_m)
    points = np.ones((4, len(REFERENCE_JOINTS), len(joints_mm)))  # homogeneous coordinates, for the library
    points[:3] = joints_mm.transpose(2, 1, 0)
    file, first = ezc3d.c3d(), int(motion.frames[0])
    file["data"]["points"] = points
    file["header"]["points"]["first_frame"] = first if first + n_frames <= _MOST_FRAMES else 0
    about = file["parameters"]["POINT"]
    about["LABELS"]["value"] = list(REFERENCE_JOINTS)
    about["DESCRIPTIONS"]["value"] = [f"centre of {name.replace('_', ' ')}" for name in REFERENCE_JOINTS]
    about["RATE"]["value"] = [motion.fps]
    about["UNITS"]["value"] = ["mm"]
    file.add_parameter("POINT", "X_SCREEN", ["+X"])
    file.add_parameter("POINT", "Y_SCREEN", ["+Z"])
    file.add_parameter("MANUFACTURER", "COMPANY", ["xormocap"])
    with atomic_file(path) as part:
        file.write(str(part))


def write_trc(path: Path, motion: Motion) -> None:
    """Write the joints of joints.csv, completely or not at all. Frame numbers and times are the take's."""
    joints_mm = _MM_PER_M * to_y_up(reference_joints(motion.poses, motion.body.offsets_m))
    rows = np.column_stack([motion.frames, motion.times_s, joints_mm.reshape(len(joints_mm), -1)])
    with atomic_file(path) as part, part.open("w", encoding="ascii", newline="\n") as file:
        file.write("\n".join(_head(path.name, motion)) + "\n")
        np.savetxt(file, rows, fmt=["%d", "%.6f", *["%.3f"] * (rows.shape[1] - 2)], delimiter="\t")


def _head(name: str, motion: Motion) -> list[str]:
    """The lines above the numbers; their columns are joined by tabs."""
    counts = f"{len(motion.frames)}\t{len(REFERENCE_JOINTS)}"
    fps, first = f"{motion.fps:g}", motion.frames[0]
    axes = [f"{axis}{n + 1}" for n in range(len(REFERENCE_JOINTS)) for axis in "XYZ"]
    return [
        f"PathFileType\t4\t(X/Y/Z)\t{name}",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        f"{fps}\t{fps}\t{counts}\tmm\t{fps}\t{first}\t{len(motion.frames)}",
        "Frame#\tTime\t" + "\t\t\t".join(REFERENCE_JOINTS) + "\t\t",
        "\t\t" + "\t".join(axes),
        "",
    ]
