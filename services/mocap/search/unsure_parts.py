"""Which parts of the actor cannot be told from the background, and in which cameras."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from services.mocap.body.skeleton import bare
from services.mocap.energy.bitplanes import TriPlanes, count_by_camera, pack, unpack
from services.mocap.energy.picture import Region
from services.mocap.search.error_by_part import PART_SEGMENTS
from services.mocap.search.model import Model
from services.mocap.search.unsure_shares import REMEDY, UNTOLD, without_rims
from services.mocap.take.marks import LIMB_PAIRS, PARTS, Part
from services.mocap.types import Floats, Ints, Mask

UNTOLD_SHARE = 0.4
"""Share of a part's pixels in a picture. A hand or a foot is a fifth of its limb: the rest determines the
limb. With the forearm or the shank it is half, and nothing determines the bend of elbow or knee."""
_LEAST_PX = 20
"""A part with fewer pixels in a picture, because it is at the edge, is not judged there."""
_PAIRS = {f"{bare(pair[0])}s": pair for pair in LIMB_PAIRS}
"""`arms`, `legs`: the limbs of a pair in one word."""


@dataclass(frozen=True, eq=False)
class PartPixels:
    """Number of pixels that the parts of a body (PARTS) cover in each camera's picture."""

    covered: Ints
    """(C, 6) all of them."""
    unsure: Ints
    """(C, 6) the unsure ones."""

    @property
    def shown(self) -> Mask:
        """(C, 6) whether a part is in a picture."""
        return self.covered >= _LEAST_PX

    @property
    def untold(self) -> Mask:
        """(C, 6) whether a part cannot be told from the background in a picture."""
        untold: Mask = self.shown & (self.unsure > UNTOLD_SHARE * self.covered)
        return untold

    @property
    def mostly_untold(self) -> Mask:
        """(6,) whether that is so in more than half of the pictures that show a part."""
        mostly: Mask = 2 * self.untold.sum(axis=0) > self.shown.sum(axis=0)
        return mostly


def part_pixels(model: Model, seen: TriPlanes, poses: Floats) -> PartPixels:
    """Draw every part in poses (F, D) and count its pixels, of all frames together; rims are never unsure.

    seen (F, P, H, W).
    """
    region, n_cameras = Region.whole(model.rig), model.rig.n_cameras
    covered, unsure = np.zeros((2, n_cameras, len(PARTS)), np.int32)
    inside = ~region.outside(model.rig)
    for planes, pose in zip(seen.unsure, poses, strict=True):
        blobs = pack(np.array([without_rims(mask) for mask in unpack(planes, n_cameras)]))
        for part, segments in enumerate(PART_SEGMENTS.values()):
            drawn = model.backend.coverage(pose[None], segments, region)[0] & inside
            covered[:, part] += count_by_camera(drawn, n_cameras)
            unsure[:, part] += count_by_camera(drawn & blobs, n_cameras)
    return PartPixels(covered, unsure)


def parts_in_words(untold: Mask, names: Sequence[str]) -> str:
    """`legs in cam02, cam04; left arm in cam01` of parts (C, 6) and the cameras' names; "" without any."""
    cameras: dict[str, list[str]] = {}
    for name, of_camera in zip(names, untold, strict=True):
        for part in _paired(part for part, is_untold in zip(PARTS, of_camera, strict=True) if is_untold):
            cameras.setdefault(part, []).append(name)
    parts: dict[str, list[str]] = {}
    for part, where in cameras.items():
        parts.setdefault(", ".join(where), []).append(part)
    return "; ".join(f"{_listed(which)} in {where}" for where, which in parts.items())


def _listed(words: Sequence[str]) -> str:
    return " and ".join(filter(None, (", ".join(words[:-1]), words[-1])))


def _paired(parts: Iterable[Part]) -> list[str]:
    """Parts in words, both of a pair in one."""
    left = list(parts)
    pairs = {pair: sides for pair, sides in _PAIRS.items() if set(sides) <= set(left)}
    in_pairs = [side for sides in pairs.values() for side in sides]
    return [part.replace("_", " ") for part in left if part not in in_pairs] + list(pairs)


def untold_parts(
    model: Model, seen: TriPlanes, poses: Floats, names: Sequence[str], when: str, where: str
) -> str:
    """The sentence for the user on frames (F, P, H, W) and poses (F, D) in them; "" where all can be told.

    names: of the cameras; when: the frames in words; where: where to look, in words.
    """
    if not seen.unsure.any():
        return ""
    parts = parts_in_words(part_pixels(model, seen, poses).untold, names)
    if not parts:
        return ""
    return f"silhouettes: parts of the actor {UNTOLD} in {when} ({parts}): {REMEDY}; {where}"
