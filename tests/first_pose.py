"""The first pose of a synthetic take, said in its take.toml."""

from pathlib import Path

from services.mocap.body.skeleton import DOFS
from services.mocap.take.layout import SETTINGS
from services.mocap.take.tables import read_poses_csv


def say_first_pose(folder: Path) -> None:
    """Say the true pose of a take's first frame, so that this frame takes no longer than another."""
    pose = read_poses_csv(folder / "reference" / "poses.csv").poses[0]
    said = "".join(f"{dof.column} = {value}\n" for dof, value in zip(DOFS, pose.tolist(), strict=True))
    with (folder / SETTINGS).open("a") as settings:
        settings.write(f"[initial_pose]\n{said}")
