"""Takes for long runs: synthetic, with everything said that would take time to be found."""

from pathlib import Path

from services.mocap.body.actor import Actor
from services.mocap.body.skeleton import DOFS
from services.mocap.synth.take import write_synthetic_take
from services.mocap.take.actor_file import write_actor
from services.mocap.take.layout import ACTOR, SETTINGS
from services.mocap.take.settings import read_take_file
from services.mocap.take.tables import read_poses_csv


def make_take(folder: Path, frames: int, cameras: int) -> Path:
    """A synthetic take of which actor and first pose are said, so that every frame is solved soon."""
    write_synthetic_take(folder, n_frames=frames, n_cameras=cameras)
    write_actor(folder / ACTOR, Actor(height=read_take_file(folder / SETTINGS).actor_height), "nothing")
    pose = read_poses_csv(folder / "reference" / "poses.csv").poses[0]
    said = "".join(f"{dof.column} = {value}\n" for dof, value in zip(DOFS, pose.tolist(), strict=True))
    with (folder / SETTINGS).open("a", encoding="utf-8") as settings:
        settings.write(f"[initial_pose]\n{said}")
    return folder
