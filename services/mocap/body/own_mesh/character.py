"""What any file is made into first: a surface for each segment, and named joints, in the file's own frame."""

from dataclasses import dataclass

import numpy as np

from services.mocap.body.skeleton import SEGMENTS
from services.mocap.types import Floats, Ints, Mask


@dataclass(frozen=True, eq=False)
class Piece:
    """The surface of one segment, which may be open."""

    vertices: Floats
    """(V, 3)"""
    faces: Ints
    """(F, 3) counter-clockwise seen from outside."""
    cut: Mask
    """(V,) where it was cut off from its neighbours."""


@dataclass(frozen=True, eq=False)
class Character:
    """A body as a file has it: any unit, any axes, any pose between A and T."""

    joints: dict[str, Floats]
    """Where our joints (3,) are: all but pelvis, waist and head_top, which follow from the others."""
    pieces: dict[str, Piece]
    """By segment."""


NEEDED_JOINTS = tuple(segment.joint for segment in SEGMENTS if segment.part != "torso")


def welded(vertices: Floats, faces: Ints) -> tuple[Floats, Ints, Ints]:
    """Vertices (V, 3) at one place made one: those left, the faces, and which vertex each was made of.

    Files hold a vertex several times where their texture has a seam. Faces without area are left out.
    """
    step = max(float(np.ptp(vertices, axis=0).max()), 1e-12) * 1e-6
    _, first, place = np.unique(np.rint(vertices / step), axis=0, return_index=True, return_inverse=True)
    joined = place.reshape(-1)[faces]
    whole = np.all(joined != np.roll(joined, 1, axis=1), axis=1)
    return vertices[first], joined[whole].astype(np.int32), first.astype(np.int32)
