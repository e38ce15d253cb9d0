"""The takes that are tracked: folders that the user names, and synthetic ones that are made once and kept."""

import hashlib
import shutil
from pathlib import Path

import services.mocap.body
import services.mocap.synth
from bench.command import xormocap
from services.mocap.body.actor import Actor
from services.mocap.energy.detail.cache import cache_folder
from services.mocap.errors import UserError
from services.mocap.take.actor_file import write_actor
from services.mocap.take.layout import ACTOR, SETTINGS
from services.mocap.take.settings import read_take_file

MOTIONS = ("basic", "dance", "walk")
"""What xormocap synth can show; basic is like the paper's sequence A, dance like its sequence B."""
SYNTHETIC_FRAMES = 400
"""As long as the paper's sequences."""


def take_folder(name: str) -> Path:
    """The folder of a take: that of a path, or a synthetic one by the name of its motion, made if need be.

    A synthetic take holds its very actor in actor.toml. Raises UserError for what is neither.
    """
    folder = Path(name)
    if folder.is_dir():
        return folder
    if name not in MOTIONS:
        raise UserError(f"{name}: is no folder and no motion: expected a take, or {', '.join(MOTIONS)}")
    return _synthetic(name)


def _synthetic(motion: str) -> Path:
    kept = cache_folder() / "takes"
    folder = kept / f"{motion}-{_sources()}"
    if (folder / ACTOR).exists():
        return folder
    for other in kept.glob(f"{motion}-*"):
        shutil.rmtree(other)  # of other sources, or half-made
    kept.mkdir(parents=True, exist_ok=True)
    xormocap("synth", folder, "--motion", motion, "--frames", SYNTHETIC_FRAMES)
    height_m = read_take_file(folder / SETTINGS).actor_height
    if height_m is None:
        raise UserError(f"{folder / SETTINGS}: has no actor_height")
    write_actor(folder / ACTOR, Actor(height=height_m), "nothing: it is the actor who was drawn")
    return folder


def _sources() -> str:
    """A digest of what draws synthetic takes."""
    digest = hashlib.sha256()
    for package in (services.mocap.body, services.mocap.synth):
        for folder in package.__path__:
            for path in sorted(Path(folder).rglob("*.py")):
                digest.update(path.read_bytes())
    return digest.hexdigest()[:12]
