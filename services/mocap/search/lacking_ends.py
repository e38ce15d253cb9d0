"""Hands, feet and head that the silhouettes of a camera lack, though they show the rest of the actor."""

from collections.abc import Mapping, Sequence

import numpy as np

from services.mocap.body.skeleton import SEGMENT_NAMES, bare
from services.mocap.energy.bitplanes import TriPlanes, count_by_camera
from services.mocap.energy.picture import Region
from services.mocap.search.chains import ALL_SURFACES
from services.mocap.search.model import Model
from services.mocap.types import Floats

ENDS: dict[str, tuple[int, ...]] = {
    words: tuple(s for s, name in enumerate(SEGMENT_NAMES) if bare(name) == end)
    for end, words in {"hand": "hands", "foot": "feet", "head": "head"}.items()
}
"""What is judged, in words, and its segments."""
_LACKING_SHARE = 0.5
"""Of the pixels that only an end covers, and no other segment. Of ends that the silhouettes show, at most 0.3
of these pixels are missing, along the rim (40 cameras of six takes, pictures of 320x240)."""
LACKING_REMEDY = (
    "look at them (xormocap segment); gloves, shoes or hair in the colour of the background explain it, or a "
    "picture's edge"
)
_LEAST_PX = 5
"""Pixels in each frame on average; less tells nothing."""


def lacking_ends(
    model: Model, seen: TriPlanes, poses: Floats, names: Sequence[str]
) -> dict[str, tuple[str, ...]]:
    """By camera, of these names, the ENDS that its silhouettes lack in frames (F, P, H, W) with poses (F, D);
    cameras that lack nothing are left out. Unsure pixels count for nothing."""
    region, n_cameras = Region.whole(model.rig), model.rig.n_cameras
    alone_px, lacking_px = np.zeros((2, n_cameras, len(ENDS)), np.int64)
    inside = ~region.outside(model.rig)
    for silhouettes, unsure, pose in zip(seen.silhouettes, seen.unsure, poses, strict=True):
        for end, segments in enumerate(ENDS.values()):
            rest = tuple(surface for surface in ALL_SURFACES if surface not in segments)
            drawn, covered = (
                model.backend.coverage(pose[None], surfaces, region)[0] for surfaces in (segments, rest)
            )
            alone = drawn & ~covered & inside & ~unsure
            alone_px[:, end] += count_by_camera(alone, n_cameras)
            lacking_px[:, end] += count_by_camera(alone & ~silhouettes, n_cameras)
    lacks = (lacking_px > _LACKING_SHARE * alone_px) & (alone_px >= _LEAST_PX * len(poses))
    return {
        name: tuple(end for end, is_lacking in zip(ENDS, row, strict=True) if is_lacking)
        for name, row in zip(names, lacks, strict=True)
        if row.any()
    }


def lacking_in_words(lacking: Mapping[str, Sequence[str]]) -> str:
    """`silhouettes lack the hands in cam01, cam03; the head in cam02`; "" where they lack nothing."""
    by_end = {end: [name for name, ends in lacking.items() if end in ends] for end in ENDS}
    words = "; ".join(f"the {end} in {', '.join(names)}" for end, names in by_end.items() if names)
    return words and f"silhouettes lack {words}"
