"""An actor who is cut off at the lower edge is told from an object that stands there."""

from collections.abc import Callable

import numpy as np
import pytest

from services.mocap.calibration.epipolar_tangents import outline_of
from services.mocap.calibration.silhouette_faults import silhouette_faults
from services.mocap.camera.camera import Camera
from services.mocap.types import ACTOR, UNSURE, Mask, Trimap

CRATE, LEGS = np.s_[36:, 4:20], np.s_[10:, 40:52]


def _seen(*parts: tuple[slice, slice]) -> Mask:
    seen = np.zeros((48, 64), bool)
    for part in parts:
        seen[part] = True
    return seen


@pytest.mark.parametrize(
    ("actor", "crate", "is_cut"),
    [
        (_seen(LEGS), None, True),
        (_seen(np.s_[10:44, 40:52]), None, False),
        (_seen(np.s_[10:40, 12:24]), _seen(CRATE), False),
        (_seen(LEGS), _seen(CRATE), True),
    ],
    ids=["cut off", "whole", "crate before the feet", "cut off beside a crate"],
)
def test_legs_at_the_lower_edge_are_told_but_no_object(
    small_cameras: Callable[[int], list[Camera]], actor: Mask, crate: Mask | None, is_cut: bool
) -> None:
    cameras = tuple(small_cameras(3))
    trimap: Trimap = np.where(actor, np.uint8(ACTOR), np.uint8(0))
    if crate is not None:
        trimap[crate] = UNSURE
    outlines = [[outline_of(trimap, camera)] for camera in cameras]
    moved = {} if crate is None else {camera.name: crate for camera in cameras}
    found = list(silhouette_faults(cameras, outlines, np.stack([trimap] * 3)[None], moved))
    assert any("legs or feet are not in view" in mistake.what for mistake in found) == is_cut
