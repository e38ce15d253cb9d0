"""The file names in a results folder, for writers and readers."""

from pathlib import Path

from services.mocap.body.actor import MESH_FILE
from services.mocap.take.fit_record import FIT_FOLDER
from services.mocap.take.journal import JOURNAL
from services.mocap.take.layout import ACTOR, CALIBRATION

POSES, POSES_SMOOTH, JOINTS = "poses.csv", "poses_smooth.csv", "joints.csv"
BVH, GLB, TRC, C3D = "motion.bvh", "motion.glb", "motion.trc", "motion.c3d"
ANGLES, TIMINGS, ENERGIES = "angles.csv", "timings.csv", "energies.csv"
POSES_PARQUET, JOINTS_PARQUET, ANGLES_PARQUET = "poses.parquet", "joints.parquet", "angles.parquet"
OVERLAY, REPORT, RUN_JSON, LOGS = "overlay.mp4", "report.html", "run.json", "logs"
CORRECTED_FRAMES = "corrected_frames_by_part"
"""The entry of run.json that only results have that were tracked both ways."""
KNOWN = {
    *(POSES, POSES_SMOOTH, JOINTS, BVH, GLB, TRC, C3D, ANGLES, TIMINGS, ENERGIES),
    *(POSES_PARQUET, JOINTS_PARQUET, ANGLES_PARQUET, OVERLAY, REPORT, RUN_JSON, LOGS),
    *(ACTOR, CALIBRATION, MESH_FILE, FIT_FOLDER, JOURNAL),
}
"""All files that a results folder may contain."""


def partial_of(folder: Path) -> Path:
    """The folder of a run's journal, and of incomplete results if there are older ones."""
    folder = folder.resolve()
    return folder.with_name(f"{folder.name}.partial")


def journal_of(folder: Path) -> Path:
    """The journal of a run's poses, frame by frame, until all its results are written."""
    return partial_of(folder) / JOURNAL
