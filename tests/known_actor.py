"""A synthetic take whose actor is known, so that nothing is fitted before it is tracked."""

from pathlib import Path

from services.mocap.body.actor import Actor
from services.mocap.synth.take import write_synthetic_take
from services.mocap.take.actor_file import write_actor
from services.mocap.take.layout import ACTOR, SETTINGS
from services.mocap.take.settings import read_take_file


def write_take_of_known_actor(folder: Path, n_frames: int, n_cameras: int) -> None:
    """Write a take with an actor.toml that holds the very body that it shows."""
    write_synthetic_take(folder, n_frames=n_frames, n_cameras=n_cameras)
    write_actor(folder / ACTOR, Actor(height=read_take_file(folder / SETTINGS).actor_height), "nothing")
