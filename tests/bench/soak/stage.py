"""Takes for long runs: synthetic, with everything said that would take time to be found."""

from pathlib import Path

from first_pose import say_first_pose
from known_actor import write_take_of_known_actor


def make_take(folder: Path, frames: int, cameras: int) -> Path:
    """A synthetic take of which actor and first pose are said, so that every frame is solved soon."""
    write_take_of_known_actor(folder, frames, cameras)
    say_first_pose(folder)
    return folder
