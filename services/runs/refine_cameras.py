"""Refining the extrinsics of a take's cameras by the body of an earlier run."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from services.mocap.calibration.from_body import Refined, refine_cameras
from services.mocap.camera.camera import Camera
from services.mocap.energy.bitplanes import TriPlanes, pack_trimaps
from services.mocap.errors import TakeError
from services.mocap.take.folder import Take
from services.runs.fit import Show, kept_warnings, trimaps_of
from services.runs.refine import reliable_rows, result_of
from services.segmentation.segmenters import make_segmenter

N_FRAMES = 48
"""Half of them are kept out, to judge by; more hardly make the cameras more exact."""
LEAST_FRAMES = 8
_FEWEST_CAMERAS = 2
_SEEN_AT = 0.2
"""Progress once all silhouettes are there."""


@dataclass(frozen=True, eq=False)
class TakeCameras:
    """The refined cameras of a take."""

    cameras: tuple[Camera, ...]
    """Before."""
    refined: Refined
    """… and after."""
    warnings: list[str]


def refine_take_cameras(take: Take, result: Path, show: Show) -> TakeCameras:
    """Refine a take's cameras by the body and poses of a result, in frames spread over those without a mark.

    Silhouettes are made as for the result. Cameras that a fit would leave out, because they disagree with
    the others, are among them. Raises
    UserError if the result cannot be used, belongs to another take or has fewer than eight such frames, and
    TakeError if there is but one camera.
    """
    if len(take.cameras) < _FEWEST_CAMERAS:
        raise TakeError(
            f"{take.folder}: has only one camera: expected at least two, since one agrees with any motion"
        )
    found = result_of(take, result)
    rows = reliable_rows(found, np.asarray(found.distrusted.any(axis=1), bool), N_FRAMES, LEAST_FRAMES)
    frames = tuple(found.tracked.frames[rows].tolist())
    with kept_warnings() as warnings:
        made = make_segmenter(take, take.cameras, found.segmenter)
        trimaps = trimaps_of(
            take, frames, made, lambda share: show("looking at silhouettes", _SEEN_AT * share)
        )
        refined = refine_cameras(
            take.cameras,
            TriPlanes.of_frames([pack_trimaps(of_frame) for of_frame in trimaps]),
            found.actor,
            found.tracked.poses[rows],
            lambda share: show("refining the cameras", _SEEN_AT + (1.0 - _SEEN_AT) * share),
        )
    return TakeCameras(take.cameras, refined, warnings)
