"""Joint centres as markers in a TRC file, as OpenSim and other biomechanics tools read it.

Axes are those of motion.bvh: y up, as OpenSim wants it; z is where somebody with heading zero faces. Lengths
are millimetres. Frame numbers and times are the take's.
"""

from pathlib import Path

import numpy as np

from services.mocap.atomic import atomic_file
from services.mocap.motion.motion import Motion, to_y_up
from services.mocap.take.tables import REFERENCE_JOINTS, reference_joints

_MM_PER_M = 1000.0


def write_trc(path: Path, motion: Motion) -> None:
    """Write the joints of joints.csv, whole or not at all."""
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
