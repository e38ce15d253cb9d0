"""angles.csv: the anatomical angles of services.mocap.motion.angles, a column each."""

from pathlib import Path

from services.mocap.motion.angles import joint_angles_deg
from services.mocap.motion.motion import Motion
from services.mocap.take.csv_columns import as_cells, write_columns


def write_angles_csv(path: Path, motion: Motion) -> None:
    """Write frame, time_s and every angle in degrees, whole or not at all."""
    columns = {
        "frame": [str(frame) for frame in motion.frames],
        "time_s": as_cells("time_s", motion.times_s, ".6f"),
    }
    for name, angles_deg in joint_angles_deg(motion.T_world_joint).items():
        columns[f"{name}_deg"] = as_cells(name, angles_deg, ".4f")
    write_columns(path, columns)
