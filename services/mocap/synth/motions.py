"""The motions that the synthetic studio can be asked for: some by name, and any BVH file."""

from collections.abc import Callable
from pathlib import Path

from services.mocap.body.actor import Body
from services.mocap.errors import UserError
from services.mocap.synth.bvh_performance import Performance, perform_bvh
from services.mocap.synth.rounds import ROUND_S, basic, dance
from services.mocap.synth.walk import walk
from services.mocap.types import Floats

# Name -> how long it lasts unless asked otherwise, in seconds, and the function that makes its poses.
_MOTIONS: dict[str, tuple[float, Callable[[int, float, Body, int], Floats]]] = {
    "walk": (4.0, lambda n_frames, fps, body, _seed: walk(n_frames, fps, body)),
    "basic": (ROUND_S, basic),
    "dance": (ROUND_S, dance),
}


def make_motion(
    name: str, n_frames: int | None, fps: float, body: Body, seed: int, start_s: float = 0.0
) -> Performance:
    """The motion of a name or a BVH file, as long as it lasts by itself where n_frames is None.

    It begins with walk.STAND_S in the A pose. start_s: how much of a file's beginning to leave out. Raises
    UserError for a name that is not known and for a file that cannot be worked with.
    """
    if Path(name).suffix.lower() == ".bvh":
        return perform_bvh(Path(name), n_frames, start_s, fps, body)
    if name not in _MOTIONS:
        raise UserError(f"synth: motion = {name}: expected {', '.join(_MOTIONS)} or a file that ends in .bvh")
    if start_s:
        raise UserError(f"synth: start = {start_s:g}: expected 0, since {name} is not a BVH file")
    seconds, make = _MOTIONS[name]
    return Performance(make(n_frames or round(seconds * fps), fps, body, seed))
