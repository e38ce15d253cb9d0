"""What silhouettes lack: actors who are cut off at a picture's edge, and feet that do not reach the floor."""

from collections.abc import Iterator, Mapping, Sequence

import cv2
import numpy as np

from services.mocap.calibration.epipolar_tangents import Outline
from services.mocap.calibration.mistake import Mistake
from services.mocap.camera.camera import Camera
from services.mocap.camera.rig import Rig
from services.mocap.errors import TakeError
from services.mocap.search.hull import carve
from services.mocap.types import ACTOR, BACKGROUND, Bytes, Mask, Trimap

_OFTEN = 0.5
"""Share of the frames from which a camera that cuts the actor off is told."""
_EDGE_PX = 3
_FLOATING_M = 0.1, 0.6
"""How far above the floor the lowest point is if the feet are missing; more is another world, or a jump."""
_ON_FLOOR_M = 0.05
"""Soles are seen lower than this, even where a shadow between the shoes, or what few cameras leave open,
counts as actor."""


def silhouette_faults(
    cameras: tuple[Camera, ...],
    outlines: Sequence[Sequence[Outline | None]],
    some_trimaps: Trimap,
    moved: Mapping[str, Mask],
) -> Iterator[Mistake]:
    """What the silhouettes lack. outlines: per camera, of each frame. some_trimaps (K, C, H, W): of a few
    frames. moved: by camera where (h, w) a moved object is, which may stand at the lower edge in place
    of the actor."""
    cut = [
        camera.name
        for camera, seen in zip(cameras, outlines, strict=True)
        if _is_cut(camera, seen, moved.get(camera.name))
    ]
    if cut:
        yield Mistake(
            f"silhouettes of {', '.join(cut)}",
            "end at the lower edge of the picture: legs or feet are not in view",
            "move these cameras back or tilt them down; legs that no camera sees are guessed",
        )
        return
    low_m, high_m = _FLOATING_M
    bottoms_m = [_bottom_m(cameras, trimaps) for trimaps in some_trimaps]
    floating_m = {k: of for k, of in enumerate(bottoms_m) if of is not None and low_m < of < high_m}
    if not floating_m or any(of is not None and of < _ON_FLOOR_M for of in bottoms_m):
        return  # feet that reach the floor in another frame are not missing: a jump, or a shadow on a shoe
    k = min(floating_m, key=floating_m.__getitem__)
    reaching = [_bottom_m(cameras, some_trimaps[k], without=c) for c in range(len(cameras))]
    lacking = [cameras[c].name for c, of in enumerate(reaching) if of is not None and of < low_m]
    alone = f" of {', '.join(lacking)}" if lacking else ""
    yield Mistake(
        f"silhouettes{alone}",
        f"the actor ends {floating_m[k]:.2f} m above the floor of the calibrated world; the feet are missing "
        f"in them{'' if alone else ', or the origin of the world is not on the floor'}",
        "look at them (xormocap segment); dark shoes, furniture, or a long jump explain it too",
    )


def _bottom_m(cameras: tuple[Camera, ...], trimaps: Trimap, without: int | None = None) -> float | None:
    """Height of the soles above the floor, by trimaps (C, H, W) of all cameras but one; None if unknown."""
    silhouettes = trimaps == ACTOR
    if without is not None:
        silhouettes[without] = False
    try:
        return carve(Rig.of(cameras), silhouettes, trimaps != BACKGROUND).bottom_m
    except TakeError:
        return None  # what does not meet in space is told otherwise


def _is_cut(camera: Camera, outlines: Sequence[Outline | None], moved: Mask | None) -> bool:
    """Whether a camera's silhouettes mostly end at the lower edge of its picture, beside a moved object
    (h, w)."""
    seen = [outline for outline in outlines if outline is not None]
    is_actor = np.ones(camera.width_px, bool)
    if moved is not None:
        at_edge: Bytes = np.asarray(moved[-(2 * _EDGE_PX) :].any(axis=0), np.uint8).reshape(1, -1)
        is_actor = cv2.dilate(at_edge, np.ones((1, 2 * _EDGE_PX + 1), np.uint8))[0] == 0
    ends = []
    for outline in seen:
        pixels = outline.pixels(camera)
        lowest = pixels[pixels[:, 1] > camera.height_px - _EDGE_PX, 0]
        ends.append(is_actor[np.rint(lowest).astype(int).clip(0, camera.width_px - 1)].any())
    return bool(seen) and float(np.mean(ends)) > _OFTEN
