"""Warnings about calibrated cameras: not certainly wrong, but worth checking."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from services.mocap.calibration.coverage import covered_share
from services.mocap.calibration.rig_solving import Solution
from services.mocap.camera.camera import Camera

_UPSIDE_DOWN, _LEVEL = -0.5, 0.5
"""Of the cosine between a picture's upward direction and the world's."""
_SAME_PLACE_M, _SAME_COSINE = 0.05, 0.995
_NEAR_M, _FAR_M = 0.5, 30.0
"""From the world's origin; cameras of a studio stand farther away than the one and nearer than the other."""
_UNDERGROUND_M = -0.3
_MANY_BAD = 0.3
_LARGE_ERROR_PX, _LARGE_RATIO = 1.0, 3.0
_LITTLE_COVERED = 0.4


def remarks_on(cameras: Sequence[Camera]) -> list[str]:
    """One sentence for each implausible property of cameras in a z-up world with its origin on the stage's
    floor."""
    remarks = [
        f"{camera.name}: stands {-camera.centre_world_m[2]:.2f} m under the floor: check that the board at "
        "the origin lay on the floor, print up"
        for camera in cameras
        if camera.centre_world_m[2] < _UNDERGROUND_M
    ]
    upward = np.array([-camera.R_camera_world[1, 2] for camera in cameras])
    if np.median(upward) < _LEVEL:  # all of them: then rather the origin's board is not on the floor
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
    """One sentence for each camera with too few useful views, or that does not fit the others."""
    remarks = []
    errors_px = [solution.error_px(c) for c in range(len(solution.cameras))]
    for c, camera in enumerate(solution.cameras):
        if solution.n_bad_views[c] > _MANY_BAD * (solution.n_views[c] + solution.n_bad_views[c]):
            remarks.append(
                f"{camera.name}: {solution.n_bad_views[c]} views do not fit those of the other cameras "
                "and were left out: check that its clip shows the same moments as theirs, and that the "
                "board is flat"
            )
        if errors_px[c] > max(_LARGE_ERROR_PX, _LARGE_RATIO * float(np.median(errors_px))):
            remarks.append(
                f"{camera.name}: corners are off by {errors_px[c]:.1f} px on average: check its focus, "
                "motion blur, and whether another --lens suits it"
            )
        share, lens = covered_share(solution, c), solution.lenses[c]
        if share < _LITTLE_COVERED and not lens.is_held:
            simple = " (a simple lens model was chosen)" if lens.is_simple else ""
            remarks.append(
                f"{camera.name}: the board was seen in {100 * share:.0f}% of the picture only: its lens is "
                f"not known elsewhere{simple}: move the board through the whole picture, record it close up "
                "(intrinsics/), or give a known lens (--lens FILE)"
            )
    return remarks
