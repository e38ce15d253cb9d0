"""Silhouettes of some frames of a take."""

import logging
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from pathlib import Path

import numpy as np

from services.mocap.body.actor import Actor
from services.mocap.camera.camera import Camera
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes, in_common_size, pack_trimaps, unpack_trimaps
from services.mocap.search.model import model_on_cpu
from services.mocap.search.other_people import told_apart, without_others
from services.mocap.search.plausibility import look_first
from services.mocap.search.tracker import FLOOR_PLACE
from services.mocap.search.two_people import NOWHERE, Places, TwoPeople
from services.mocap.side_by_side import side_by_side
from services.mocap.take.folder import Take
from services.mocap.types import ACTOR, BACKGROUND, Floats, Trimap
from services.runs.reporting import kept_warnings
from services.segmentation.background import CameraBackground
from services.segmentation.kept_trimaps import KeptTrimaps
from services.segmentation.segmenters import AUTO, READY, PlateCheck, chosen_segmenter, make_segmenter
from services.segmentation.silhouettes import Moment, Segmenter

log = logging.getLogger(__name__)


class TakeSilhouettes:
    """The silhouettes of a take for all steps of a command: learnt once, when they are first needed."""

    def __init__(self, take: Take, segmenter: str = AUTO, kept: Path | None = None) -> None:
        """kept: a folder for silhouettes once made, and what was learnt for them; see make_segmenter."""
        self.take, self.name, self._kept = take, segmenter, kept
        self._plate_checks: list[PlateCheck] = []
        self.backgrounds = {
            camera.name: CameraBackground(take, camera)
            for camera in take.cameras
            if take.has_background(camera)
        }
        """Of the cameras with a recorded clean plate; estimates hold many pictures in memory."""
        self.said: list[str] = []
        """What is wrong with the empty stage, as far as it was noticed while learning it."""

    @property
    def are_ready(self) -> bool:
        """Whether they are the take's own."""
        return chosen_segmenter(self.take, self.name) == READY

    @property
    def has_stage(self) -> bool:
        """Whether they are ready, or the empty stage was recorded for all cameras, so that it need not be
        estimated from the videos."""
        return self.are_ready or all(map(self.take.has_background, self.take.cameras))

    @cached_property
    def segmenter(self) -> Segmenter:
        """What makes them; raises UserError as make_segmenter does."""
        with kept_warnings() as said:
            segmenter = make_segmenter(
                self.take, self.take.cameras, self.name, self._plate_checks.append, self._kept,
                self.backgrounds,
            )  # fmt: skip
        self.said = sorted(said)  # cameras are learnt side by side
        return segmenter

    @cached_property
    def kept(self) -> KeptTrimaps | None:
        """The silhouettes that are kept; None if none are, or they are the take's own."""
        if self._kept is None or self.are_ready:
            return None
        return KeptTrimaps(self._kept, self.take.cameras)

    @cached_property
    def remarks(self) -> list[str]:
        """What is wrong with the empty stage, after clean plates were checked, 0.25 s each."""
        _ = self.segmenter
        with kept_warnings() as of_plates:
            side_by_side(lambda check: check(), self._plate_checks)
        return [*self.said, *sorted(of_plates)]


def seen_of(
    take: Take,
    frames: Sequence[int],
    segmenter: Segmenter,
    progress: Callable[[float], None],
    posed: tuple[Actor, Floats] | None = None,
) -> tuple[tuple[Camera, ...], TriPlanes]:
    """The usable cameras and their silhouettes (F, P, H, W), in the form that segmentation sends.

    posed: the actor and about the poses (F, D), where known. Other people are unsure, who are told apart by
    them, or else from the first frame on, one by one.
    """
    trimaps = trimaps_of(take, frames, segmenter, progress)
    rig = Rig.of(take.cameras)
    places, as_seen = NOWHERE, trimaps[0].copy()
    if posed is not None:
        actor, poses = posed
        places = Places(poses[0, FLOOR_PLACE])
        with model_on_cpu(actor, rig) as model:
            for f, pose in enumerate(poses):
                seen = without_others(model, pack_trimaps(trimaps[f]), pose)
                trimaps[f] = unpack_trimaps(seen, rig.n_cameras)
    names, first = take.camera_names, trimaps[0]
    others = (as_seen == ACTOR) & (first != ACTOR)
    look = look_first(rig, first == ACTOR, names, first != BACKGROUND, places, others)
    for remark in look.remarks:
        log.warning("%s", remark)
    if look.two is not None and posed is not None:
        trimaps[0] = unpack_trimaps(look.alone(pack_trimaps(first)), rig.n_cameras)
    elif look.two is not None:
        trimaps = _of_actor(rig, trimaps, look.two, look.left_out)
    left_out = set(look.left_out) - set(look.hidden_by_others)
    chosen = [c for c in range(len(take.cameras)) if c not in left_out]
    cameras = tuple(take.cameras[c] for c in chosen)
    height_px, width_px = Rig.of(cameras).shape_px
    cut = trimaps[:, chosen, :height_px, :width_px]
    return cameras, TriPlanes.of_frames([pack_trimaps(of_frame) for of_frame in cut])


def _of_actor(rig: Rig, trimaps: Trimap, two: TwoPeople, left_out: tuple[int, ...]) -> Trimap:
    """Successive silhouettes (F, C, H, W), in which others than the actor of the first frame are unsure.

    left_out: cameras that do not count.
    """
    actor_m, others_m, alone = two.actor_world_m, two.others_world_m, np.empty_like(trimaps)
    for f, of_frame in enumerate(trimaps):
        seen, actor_m, others_m = told_apart(rig, pack_trimaps(of_frame), actor_m, others_m, left_out)
        alone[f] = unpack_trimaps(seen, rig.n_cameras)
    return alone


def trimaps_of(
    take: Take, frames: Sequence[int], segmenter: Segmenter, progress: Callable[[float], None]
) -> Trimap:
    """The silhouettes (F, C, H, W) of all cameras."""
    height_px, width_px = Rig.of(take.cameras).shape_px
    trimaps: Trimap = np.zeros((len(frames), len(take.cameras), height_px, width_px), np.uint8)
    for f, moment in enumerate(read_moments(frames, segmenter, with_pictures=False)):
        for c, trimap in enumerate(moment.trimaps):
            trimaps[f, c] = in_common_size(trimap, width_px, height_px)
        progress((f + 1) / len(frames))
    return trimaps


def read_moments(frames: Sequence[int], segmenter: Segmenter, *, with_pictures: bool) -> Iterator[Moment]:
    """What all cameras show, frame by frame."""
    if isinstance(frames, range) and frames.step == 1:
        return segmenter.moments(frames.start, frames.stop, with_pictures=with_pictures)
    return (next(segmenter.moments(n, n + 1, with_pictures=with_pictures)) for n in frames)
