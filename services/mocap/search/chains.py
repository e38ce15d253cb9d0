"""The chains: which parameters a sub-problem varies, what it draws, and where it looks."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import CLOTH_JOINTS, SEGMENT_JOINTS, SURFACE_FRAMES, segment_transforms
from services.mocap.body.skeleton import BODY_DOFS, SEGMENTS, BodyName, dofs_of, segments_below
from services.mocap.camera.rig import Rig
from services.mocap.take.marks import LIMB_NAMES, LimbName
from services.mocap.types import Floats, Ints

_REFERENCE_CAMERAS = 8

ALL_SURFACES: tuple[int, ...] = tuple(range(len(SURFACE_FRAMES)))
"""The segments, then the cloth of a skirt, which is empty on bodies without one."""


@dataclass(frozen=True)
class Stage:
    """One sub-problem."""

    dofs: tuple[int, ...]
    surfaces: tuple[int, ...]
    """What moves, drawn at every evaluation: segments, and the cloth that they move."""
    window_px: int
    """Window size in working pixels; 0: no window, the whole picture at half resolution."""

    @property
    def others(self) -> tuple[int, ...]:
        """The other surfaces, which are pre-rendered."""
        return tuple(s for s in ALL_SURFACES if s not in self.surfaces)

    @property
    def segments(self) -> tuple[int, ...]:
        """The moving segments."""
        return tuple(s for s in self.surfaces if s < len(SEGMENTS))

    def of(self, body: BodyName) -> "Stage":
        """The same with only the parameters that vary in a body."""
        return replace(self, dofs=tuple(d for d in self.dofs if d in BODY_DOFS[body]))


@dataclass(frozen=True)
class Limb:
    """An arm with its hand, or a leg with its foot."""

    main: Stage
    extremity: Stage

    @property
    def dofs(self) -> tuple[int, ...]:
        """All parameters that the limb's search finds."""
        return self.main.dofs + self.extremity.dofs

    @property
    def whole(self) -> Stage:
        """All of it as one stage, in the windows of its main part."""
        return Stage(self.dofs, self.main.surfaces, self.main.window_px)


def _stages(part: str) -> list[Stage]:
    """The stages of a part, from the trunk outwards; each draws all below its first joint."""
    joints: dict[int, list[str]] = {}
    for segment in SEGMENTS:  # parents precede children
        if segment.part == part:
            joints.setdefault(segment.row.window_px, []).append(segment.joint)
    return [Stage(dofs_of(*turned), _surfaces_below(turned[0]), px) for px, turned in joints.items()]


def _surfaces_below(joint: str) -> tuple[int, ...]:
    segments = segments_below(joint)
    carriers = SEGMENT_JOINTS[list(segments)]
    cloth = [len(SEGMENTS) + k for k, joints in enumerate(CLOTH_JOINTS) if np.isin(joints, carriers).any()]
    return (*segments, *cloth)


(TORSO,) = _stages("torso")
(HEAD,) = _stages("head")
LIMBS: dict[LimbName, Limb] = {name: Limb(*_stages(name)) for name in LIMB_NAMES}


def pixel_scale(rig: Rig) -> float:
    """How many pixels of a rig's pictures stand for one working pixel of eight pictures."""
    return rig.scale**2 * rig.n_cameras / _REFERENCE_CAMERAS


def window_size_px(stage: Stage, rig: Rig) -> int:
    """A stage's window size for a rig's pictures."""
    return round(stage.window_px * rig.scale)


def window_origins_px(stages: Sequence[Stage], pose: Floats, body: Body, rig: Rig) -> Ints:
    """Where the windows (N, C, 2) of N stages lie when their segments are centred in them, kept inside the
    pictures.

    pose (D,) says where the segments are. The paper, section 4.2.
    """
    T_world_segment = segment_transforms(pose[None], body.offsets_m)[0]
    turned_m = np.einsum("sij,sj->si", T_world_segment[:, :3, :3], body.centres_m)
    centres_m = turned_m + T_world_segment[:, :3, 3]
    of_stages_m = np.array([centres_m[list(stage.segments)].mean(axis=0) for stage in stages])
    P = rig.P_px_world
    homogeneous = of_stages_m @ P[:, :, :3].transpose(0, 2, 1) + P[:, None, :, 3]
    depth_m = np.maximum(homogeneous[:, :, 2:], 1e-3)  # behind a camera: the window is at the picture's edge
    sizes_px = np.array([window_size_px(stage, rig) for stage in stages], np.int32)[:, None, None]
    centres_px = np.rint(homogeneous[:, :, :2] / depth_m).transpose(1, 0, 2)
    origins_px = (centres_px - sizes_px // 2).astype(np.int32)
    inside_px: Ints = np.clip(origins_px, 0, np.maximum(rig.sizes_px - sizes_px, 0))
    return inside_px
