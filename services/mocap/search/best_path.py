"""The best path through two tracks of a take: in every frame, which track the trunk and each limb come from.

It has the least energy and the least movement together (Viterbi's search: Forney, Proceedings of the IEEE
61(3), 1973).
"""

from collections.abc import Collection
from dataclasses import dataclass
from itertools import product

import numpy as np

from services.mocap.body.kinematics import SEGMENT_JOINTS, joint_positions
from services.mocap.energy.bitplanes import TriPlanes
from services.mocap.search.chains import LIMBS, pixel_scale
from services.mocap.search.error_by_part import PART_SEGMENTS
from services.mocap.search.model import Model
from services.mocap.search.settings import SearchSettings
from services.mocap.search.stages import whole_body_energy
from services.mocap.take.marks import PARTS
from services.mocap.types import Floats, Ints, Mask

SAME_M = 0.03
"""Two poses agree on a part if none of its joints is farther apart."""
_CORRECTED_M = 0.06
"""A part whose joints moved by more was somewhere else before."""
_MOVE_PX = 1000.0
"""Price of a joint's movement by a metre between two frames, in pixels of eight pictures 320 wide."""
_MOST_MOVED_M = 0.5
"""Movements count up to this: a track may jump to where a limb is."""
_LIMB_DOFS = [list(limb.dofs) for limb in LIMBS.values()]
_LIMB_PARTS = [PARTS.index(name) for name in LIMBS]
_TRUNK_PARTS = [part for part in range(len(PARTS)) if part not in _LIMB_PARTS]
PART_JOINTS = [sorted({int(SEGMENT_JOINTS[s]) for s in PART_SEGMENTS[part]}) for part in PARTS]
"""The joints that carry the segments of each part."""
_MOVING = sorted(joint for part in _LIMB_PARTS for joint in PART_JOINTS[part])
"""The joints whose movement counts: those of the limbs."""


@dataclass(frozen=True, eq=False)
class Chosen:
    """One frame of the best path."""

    pose: Floats
    """(D,)"""
    apart_m: Floats
    """(6,) how far the two poses of the frame are apart in each of PARTS."""
    margin_px: Floats
    """(6,) how much more it costs at least to take each of PARTS from the other pose, in pixels of eight
    pictures 320 wide."""


@dataclass(frozen=True, eq=False)
class _Choices:
    """The poses that a frame may have."""

    poses: Floats
    """(K, D)"""
    of_other: Mask
    """(K, 6) which of PARTS are of the other pose."""
    energies_px: Floats
    """(K,)"""
    apart_m: Floats
    """(6,)"""

    def chosen(self, at: int, scale: float) -> Chosen:
        """One of them, beside the others."""
        more_px = np.where(
            self.of_other != self.of_other[at], (self.energies_px - self.energies_px[at])[:, None], np.inf
        )
        return Chosen(self.poses[at], self.apart_m, more_px.min(axis=0) / scale)


class PathSearch:
    """Finds the best path through two poses of each of a sequence of frames, in either direction of time."""

    def __init__(self, model: Model, settings: SearchSettings) -> None:
        self._model, self._settings, self._scale = model, settings, pixel_scale(model.rig)
        self._choices: list[_Choices] = []
        self._from: list[Ints] = []
        """(K,) of every frame, which choice of the frame before leads to each of its own."""
        self._costs: Floats = np.zeros(1)
        """(K,) of the best path to each choice of the last frame."""
        self._joints_m: Floats = np.zeros((1, len(_MOVING), 3))

    def add(self, seen: TriPlanes, one: Floats, other: Floats, absent: Collection[int] = ()) -> None:
        """Add the next frame, whose silhouettes are `seen` (P, H, W), with two poses (D,) of it.

        absent: cameras that do not count.
        """
        offsets_m = self._model.body.offsets_m
        off_m = apart_m(one, other, offsets_m)
        poses, of_other = _mixtures(one, other, off_m > SAME_M)
        joints_m = joint_positions(poses, offsets_m)[:, _MOVING]
        steps = np.broadcast_to(self._costs, (len(poses), len(self._costs)))
        if self._choices:
            moved_m = np.linalg.norm(joints_m[:, None] - self._joints_m, axis=-1)
            steps = steps + _MOVE_PX * self._scale * np.minimum(moved_m, _MOST_MOVED_M).sum(axis=-1)
        self._from.append(steps.argmin(axis=1))
        energies_px = self._energies_px(seen, poses, absent)
        self._costs = steps.min(axis=1) + energies_px
        self._choices.append(_Choices(poses, of_other, energies_px, off_m))
        self._joints_m = joints_m

    def best(self) -> list[Chosen]:
        """The best path, in the order in which frames were added."""
        at, path = int(self._costs.argmin()), list[Chosen]()
        for choices, came_from in zip(reversed(self._choices), reversed(self._from), strict=True):
            path.append(choices.chosen(at, self._scale))
            at = int(came_from[at])
        return path[::-1]

    def _energies_px(self, seen: TriPlanes, poses: Floats, absent: Collection[int]) -> Floats:
        """(K,) what poses (K, D) cost in a frame, with what limbs inside others or in unusual poses cost."""
        picture, settings = self._model.without_cameras(seen, absent, self._settings)
        energy = whole_body_energy(self._model, picture, settings)
        return np.asarray(energy(poses) + self._model.aligner(settings).prices_px(poses, settings))


def apart_m(one: Floats, other: Floats, offsets_m: Floats) -> Floats:
    """(6,) how far the joints of each of PARTS are apart in two poses (D,), at most."""
    joints_m = joint_positions(np.stack([one, other]), offsets_m)
    off_m = np.linalg.norm(joints_m[0] - joints_m[1], axis=-1)
    return np.array([off_m[joints].max() for joints in PART_JOINTS])


def corrected_frames(first: Floats, settled: Floats, offsets_m: Floats) -> dict[str, int]:
    """In how many frames each of PARTS moved by more than 6 cm from the first poses (N, D) to the settled
    ones; only parts that did."""
    moved_m = np.array([apart_m(*pair, offsets_m) for pair in zip(first, settled, strict=True)])
    counts = (moved_m > _CORRECTED_M).sum(axis=0).tolist()
    return {part: n for part, n in zip(PARTS, counts, strict=True) if n}


def _mixtures(one: Floats, other: Floats, differs: Mask) -> tuple[Floats, Mask]:
    """The poses (K, D) that have the trunk and each limb of one pose or of the other, and which of PARTS
    (K, 6) are of the other; the two poses come first.

    differs: (6,) in which of PARTS they do; a limb in which they agree comes with the trunk.
    """
    limbs = [k for k, part in enumerate(_LIMB_PARTS) if differs[part]]
    is_same_trunk = not differs[_TRUNK_PARTS].any()
    poses, of_other = [one, other], [np.zeros(len(PARTS), bool), np.ones(len(PARTS), bool)]
    for trunk, rival in ((one, other), (other, one))[: 1 if is_same_trunk else 2]:
        for taken in list(product((False, True), repeat=len(limbs)))[1:]:
            mixed, is_rival = trunk.copy(), np.zeros(len(PARTS), bool)
            for k in (k for k, is_taken in zip(limbs, taken, strict=True) if is_taken):
                mixed[_LIMB_DOFS[k]] = rival[_LIMB_DOFS[k]]
                is_rival[_LIMB_PARTS[k]] = True
            poses.append(mixed)
            of_other.append(is_rival ^ (trunk is other))
    return np.array(poses), np.array(of_other)
