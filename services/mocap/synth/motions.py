"""The motions that the synthetic studio can be asked for: some by name, and any BVH file."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from services.mocap.body.actor import Body
from services.mocap.errors import UserError
from services.mocap.synth.bvh_performance import perform_bvh
from services.mocap.synth.motion import walk
from services.mocap.synth.rounds import ROUND_S, basic, dance
from services.mocap.types import Floats


def _walk(n_frames: int, fps: float, body: Body, seed: int) -> Floats:
    """The walk is the same for every seed."""
    del seed
    return walk(n_frames, fps, body)


# Name -> how long it lasts unless asked otherwise, in seconds, and the function that makes its poses.
_MOTIONS: dict[str, tuple[float, Callable[[int, float, Body, int], Floats]]] = {
    "walk": (4.0, _walk),
    "basic": (ROUND_S, basic),
    "dance": (ROUND_S, dance),
}


@dataclass(frozen=True, eq=False)
class Motion:
    """What the actor does."""

    poses: Floats
    """(N, D)"""
    joint_error_m: float | None = None
    """Of a BVH file: mean distance of the joints from the file's, had it the actor's bone lengths."""


def make_motion(
    name: str, n_frames: int | None, fps: float, body: Body, seed: int, start_s: float = 0.0
) -> Motion:
    """The motion of a name or a BVH file, as long as it lasts by itself where n_frames is None.

    It begins with motion.STAND_S in the A pose. start_s: how much of a file's beginning to leave out. Raises
    UserError for a name that is not known and for a file that cannot be worked with.
    """
    if Path(name).suffix.lower() == ".bvh":
        performance = perform_bvh(Path(name), n_frames, start_s, fps, body)
        return Motion(performance.poses, performance.joint_error_m)
    if name not in _MOTIONS:
        raise UserError(f"synth: motion = {name}: expected {', '.join(_MOTIONS)} or a file that ends in .bvh")
    if start_s:
        raise UserError(f"synth: start = {start_s:g}: expected 0, since {name} is not a BVH file")
    seconds, make = _MOTIONS[name]
    return Motion(make(n_frames or round(seconds * fps), fps, body, seed))
