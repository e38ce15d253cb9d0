"""Silhouettes of some frames of a take."""

import logging
from collections.abc import Callable, Iterator, Sequence
from itertools import islice

import numpy as np

from services.mocap.camera.camera import Camera
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes, in_common_size, pack_trimaps
from services.mocap.search.plausibility import look_first
from services.mocap.take.folder import Take
from services.mocap.types import ACTOR, BACKGROUND, Trimap
from services.segmentation.silhouettes import Moment, Segmenter

log = logging.getLogger(__name__)


def seen_of(
    take: Take, frames: Sequence[int], segmenter: Segmenter, progress: Callable[[float], None]
) -> tuple[tuple[Camera, ...], TriPlanes]:
    """The usable cameras and their silhouettes (F, P, H, W), in the form that segmentation sends."""
    trimaps = trimaps_of(take, frames, segmenter, progress)
    names, first = [camera.name for camera in take.cameras], trimaps[0]
    look = look_first(Rig.of(take.cameras), first == ACTOR, names, first != BACKGROUND)
    for remark in look.remarks:
        log.warning("%s", remark)
    chosen = [c for c in range(len(take.cameras)) if c not in look.left_out]
    cameras = tuple(take.cameras[c] for c in chosen)
    height_px, width_px = Rig.of(cameras).shape_px
    cut = trimaps[:, chosen, :height_px, :width_px]
    return cameras, TriPlanes.of_frames([pack_trimaps(of_frame) for of_frame in cut])


def trimaps_of(
    take: Take, frames: Sequence[int], segmenter: Segmenter, progress: Callable[[float], None]
) -> Trimap:
    """The silhouettes (F, C, H, W) of all cameras."""
    height_px, width_px = Rig.of(take.cameras).shape_px
    trimaps: Trimap = np.zeros((len(frames), len(take.cameras), height_px, width_px), np.uint8)
    for f, moment in enumerate(read_moments(frames, segmenter)):
        for c, trimap in enumerate(moment.trimaps):
            trimaps[f, c] = in_common_size(trimap, width_px, height_px)
        progress((f + 1) / len(frames))
    return trimaps


def read_moments(frames: Sequence[int], segmenter: Segmenter) -> Iterator[Moment]:
    """What all cameras show, frame by frame."""
    if isinstance(frames, range):
        return islice(segmenter.moments(frames.start, frames.stop), len(frames))
    return (next(iter(segmenter.moments(frame, frame + 1))) for frame in frames)
