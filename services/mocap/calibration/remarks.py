"""Warnings about calibrated cameras: not certainly wrong, but worth checking."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from services.mocap.calibration.coverage import covered_share
from services.mocap.calibration.rig_solving import Solution
from services.mocap.camera.camera import Camera
from services.mocap.take.settings import LONGEST_SIDE

_UPSIDE_DOWN, _LEVEL = -0.5, 0.5
"""Of the cosine between a picture's upward direction and the world's."""
_SAME_PLACE_M, _SAME_COSINE = 0.05, 0.995
_NEAR_M, _FAR_M = 0.5, 30.0
"""From the world's origin; cameras of a studio stand farther away than the one and nearer than the other."""
_UNDERGROUND_M = -0.3
_MANY_BAD = 0.3
_LARGE_ERROR_PX, _LARGE_RATIO = 1.0, 3.0
_LITTLE_COVERED = 0.4


def remarks_on(cameras: Sequence[Camera], *, is_floor_known: bool = True) -> list[str]:
    """One sentence for each implausible property of cameras in a z-up world.

    is_floor_known: whether its origin lies on the stage's floor.
    """
    remarks = [
        f"{camera.name}: stands {-camera.centre_world_m[2]:.2f} m under the floor: check that the board at "
        "the origin lay on the floor, print up"
        for camera in cameras
        if is_floor_known and camera.centre_world_m[2] < _UNDERGROUND_M
    ]
    upward = np.array([-camera.R_camera_world[1, 2] for camera in cameras])
    if is_floor_known and np.median(upward) < _LEVEL:  # rather the origin's board is not on the floor
        remarks.append(
            "most cameras are tilted by more than 60 degrees against the floor: check that the board at "
            "the origin lay flat on the floor, print up, and that the pictures are upright"
        )
    else:
        remarks += [
            f"{camera.name}: hangs upside down, its pictures show the floor above; the calibration is for "
            "these pictures: do not rotate the videos"
            for camera, up in zip(cameras, upward, strict=True)
            if up < _UPSIDE_DOWN
        ]
    remarks += [
        f"{one.name} and {other.name}: have the same position and direction: check that they are "
        "not one camera under two names"
        for one, other in combinations(cameras, 2)
        if np.linalg.norm(one.centre_world_m - other.centre_world_m) < _SAME_PLACE_M
        and one.R_camera_world[2] @ other.R_camera_world[2] > _SAME_COSINE
    ]
    away_m = float(np.median(np.linalg.norm([camera.centre_world_m for camera in cameras], axis=1)))
    if not _NEAR_M < away_m < _FAR_M:
        remarks.append(
            f"the cameras stand {away_m:.2g} m from the origin (median): check the side of the board's "
            "squares, or the units"
        )
    return remarks


def remarks_on_views(solution: Solution) -> list[str]:
    """Sentences about cameras with too few useful views, or that do not fit the others."""
    remarks = [
        f"{camera.name}: {n_bad} views do not fit those of the other cameras and were left out: check that "
        "its clip shows the same moments as theirs, and that the board is flat"
        for camera, n_good, n_bad in zip(
            solution.cameras, solution.n_views, solution.n_bad_views, strict=True
        )
        if n_bad > _MANY_BAD * (n_good + n_bad)
    ]
    return [*remarks, *_on_errors(solution), *_on_coverage(solution)]


def _on_errors(solution: Solution) -> list[str]:
    """A sentence on all cameras whose corners are far off."""
    cameras = solution.cameras
    errors_px = [solution.error_px(c) for c in range(len(cameras))]
    unlike_others_px = max(_LARGE_ERROR_PX, _LARGE_RATIO * float(np.median(errors_px)))
    limits_px = [min(_large_error_px(camera), unlike_others_px) for camera in cameras]
    large = [c for c in range(len(cameras)) if errors_px[c] > limits_px[c]]
    if not large:
        return []
    named = ", ".join(f"{cameras[c].name} ({errors_px[c]:.2f} px)" for c in large)
    return [
        f"{named}: corners are off by too much on average, expected {min(limits_px[c] for c in large):.2g} "
        "px at most: lock the focus, glue the board on something flat, and record it again: near, all over "
        "the picture, moved slowly so that it is not blurred; or try another --lens"
    ]


def _large_error_px(camera: Camera) -> float:
    """The largest usual error, which grows with pictures beyond the size to which takes reduce theirs."""
    return _LARGE_ERROR_PX * max(1.0, max(camera.size_px) / LONGEST_SIDE)


def _on_coverage(solution: Solution) -> list[str]:
    """A sentence on all cameras whose lens was estimated from a small part of the picture."""
    shares = {
        c: share
        for c, lens in enumerate(solution.lenses)
        if not lens.is_held and (share := covered_share(solution, c)) < _LITTLE_COVERED
    }
    if not shares:
        return []
    named = ", ".join(f"{solution.cameras[c].name} ({100 * share:.0f}%)" for c, share in shares.items())
    simple = [solution.cameras[c].name for c in shares if solution.lenses[c].is_simple]
    which = "" if len(simple) == len(shares) else f" for {', '.join(simple)}"
    chosen = f" (a simple lens model was chosen{which})" if simple else ""
    return [
        f"{named}: the board was seen in this share of the picture only: the lens is not known elsewhere"
        f"{chosen}: move the board through the whole picture, record it close up (intrinsics/), or give a "
        "known lens (--lens FILE)"
    ]
