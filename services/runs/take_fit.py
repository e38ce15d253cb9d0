"""What a fit found: the actor of a take, and the poses of some of its frames."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from services.mocap.body.actor import Actor, build_body
from services.mocap.body.measures import Measure, measure, with_uncertainties
from services.mocap.camera.camera import Camera
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes
from services.mocap.fit.fitting import Fit
from services.mocap.search.lacking_ends import lacking_ends
from services.mocap.search.model import model_on_cpu
from services.mocap.search.unsure_parts import untold_parts
from services.mocap.take.actor_file import rounded
from services.mocap.take.folder import Take
from services.mocap.take.tables import PoseTable
from services.mocap.types import Bytes, Floats, Mask

log = logging.getLogger(__name__)

LEAST_USUAL_IOU = 0.82
"""Overlap with the silhouettes in wide clothes. A body that overlaps less likely has a wrong pose: how far
its measures are off is not known."""

_SKIRT = (
    "the actor seems to wear a skirt or a coat that hangs %.0f cm under the hip joints: what the legs do in "
    "it is estimated from what is visible of them"
)
_HAT = (
    "the actor seems to wear a hat with a brim or a peak: it is part of the fitted head, but no measure "
    "includes it; which way the head is turned is estimated from what is visible of it"
)
_OCCLUDED = (
    "%s: something hides the actor from %s in %.1f%% of the picture, furniture perhaps: these pixels count "
    "for nothing"
)


@dataclass(frozen=True, eq=False)
class TakeFit:
    """The actor of a take, and the poses of some of its frames, usually the first."""

    frames: Sequence[int]
    """In increasing order."""
    cameras: tuple[Camera, ...]
    """Cameras with usable silhouettes."""
    seen: TriPlanes
    """(F, P, H, W) of these cameras."""
    start: Actor
    """The body before the fit."""
    start_pose: Floats
    """The pose (D,) of the first frame from which the fit began."""
    actor: Actor
    """The fitted actor, as written to actor.toml."""
    fit: Fit
    measures: tuple[Measure, ...]
    seconds: dict[str, float]
    warnings: list[str]
    occluded: Mapping[str, Mask] = field(default_factory=dict)
    """By camera the pixels (h, w) in which something hides the actor, found by fitting or by tracking."""
    colour_tables: Mapping[str, Bytes] = field(default_factory=dict)
    """By camera what the actor's colour classes look like there, as tracking told them."""
    lacking: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """By camera which of hands, feet and head its silhouettes lack (lacking_ends)."""
    moved_take: Take | None = None
    """The take with the cameras where the tracked body shows them, if some stand elsewhere than its
    calibration says; poses are in its world."""
    run_poses: PoseTable | None = None
    """The poses of the run that it started from, of frames that it did not mark, and of its first
    frame, unless the body is lost there."""

    def pose_table(self, fps: float) -> PoseTable:
        """The poses that are known: the fitted ones, and of other frames those of the run."""
        frames, poses = np.array(self.frames, np.int32), self.fit.poses
        energies_px = self.fit.after.energy_px
        if self.run_poses is not None:
            others = ~np.isin(self.run_poses.frames, frames)
            frames = np.concatenate([frames, self.run_poses.frames[others]])
            poses = np.concatenate([poses, self.run_poses.poses[others]])
            energies_px = np.concatenate([energies_px, self.run_poses.energies_px[others]])
        order = np.argsort(frames)
        return PoseTable(frames[order], frames[order] / fps, poses[order], energies_px[order])

    @property
    def is_refined(self) -> bool:
        """Whether it was fitted to frames of the whole take, by the poses of a result."""
        return not isinstance(self.frames, range)

    @property
    def iou(self) -> float:
        """Mean overlap of the fitted body and the silhouettes (intersection over union)."""
        return float(self.fit.after.iou.mean())


def frames_in_words(found: TakeFit) -> str:
    """Which frames an actor was fitted to."""
    ends = f"{found.frames[0]} to {found.frames[-1]}"
    return f"{len(found.frames)} frames from {ends}" if found.is_refined else f"frames {ends}"


def occluded_by_camera(cameras: Sequence[Camera], masks: Mask) -> dict[str, Mask]:
    """By camera the pixels (h, w) in which something hides the actor, of masks (C, H, W); those of which it
    hides nothing are left out."""
    cut = {
        camera.name: mask[: camera.height_px, : camera.width_px]
        for camera, mask in zip(cameras, masks, strict=True)
    }
    return {name: mask for name, mask in cut.items() if mask.any()}


def warn_of_occluded(take: Take, occluded: Mapping[str, Mask]) -> None:
    """Say in which part of which pictures something hides the actor."""
    for name, mask in occluded.items():
        log.warning(_OCCLUDED, take.folder, name, 100.0 * mask.mean())


def concluded(
    frames: Sequence[int],
    cameras: tuple[Camera, ...],
    seen: TriPlanes,
    start: tuple[Actor, Floats],
    fit: Fit,
    seconds: dict[str, float],
    warnings: list[str],
) -> TakeFit:
    """A fit with its results: the actor to write, its measures, and the unsure parts."""
    actor = rounded(fit.actor)
    with model_on_cpu(actor, Rig.of(cameras)) as model:
        names, when = [camera.name for camera in cameras], f"the {len(frames)} frames of the fit"
        where = "its overlay.png shows where"
        sentence = untold_parts(model, seen, fit.poses, names, when, where)
        lacking = lacking_ends(model, seen, fit.poses, names)
    if sentence:
        log.warning("%s", sentence)
    if actor.skirt is not None:
        log.warning(_SKIRT, 100.0 * actor.skirt.length * actor.height)
    if actor.hat is not None:
        log.warning(_HAT)
    measures = measure(build_body(actor.bare))
    if fit.shape_covariance is not None and fit.after.iou.mean() >= LEAST_USUAL_IOU:
        measures = with_uncertainties(measures, actor, fit.shape_covariance)
    return TakeFit(frames, cameras, seen, *start, actor, fit, measures, seconds, warnings, lacking=lacking)
