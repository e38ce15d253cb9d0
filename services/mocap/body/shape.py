"""The generic actor's shape: 16 closed triangle meshes, one per segment, in body heights.

Right and left are mirror images. Neighbouring segments overlap at their joint in rounded ends, so that a
bent joint shows no gap.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np

from services.mocap.body.shape_loft import Loft, loft_mesh
from services.mocap.body.shape_profiles import CENTRE_LOFTS, LEFT_LOFTS
from services.mocap.body.skeleton import SEGMENT_NAMES
from services.mocap.types import Floats, Ints

# Gives about 21,400 triangles in all, as many as the model of Theobalt et al. 2003 has.
_EDGE_HEIGHTS = 0.0101


@dataclass(frozen=True, eq=False)
class SegmentMesh:
    """One segment's surface: one or more closed components, each watertight."""

    name: str
    vertices_heights: Floats
    """(V, 3) in body heights in the segment's frame: origin at its carrying joint, rest-pose axes."""
    faces: Ints
    """(F, 3) vertex indices, counter-clockwise seen from outside."""


@cache
def generic_segments() -> tuple[SegmentMesh, ...]:
    """The 16 segments of a neutral adult, in the order of SEGMENT_NAMES; the arrays are read-only."""
    built: dict[str, SegmentMesh] = {}
    for name, lofts in CENTRE_LOFTS.items():
        built[name] = _segment(name, lofts)
    for name, lofts in LEFT_LOFTS.items():
        left = _segment(f"left_{name}", lofts)
        built[left.name] = left
        built[f"right_{name}"] = _mirrored(left, f"right_{name}")
    return tuple(built[name] for name in SEGMENT_NAMES)


def _segment(name: str, lofts: tuple[Loft, ...]) -> SegmentMesh:
    parts = [loft_mesh(loft, _EDGE_HEIGHTS) for loft in lofts]
    first = np.cumsum([0] + [len(vertices) for vertices, _ in parts])
    faces = [part_faces + start for (_, part_faces), start in zip(parts, first[:-1], strict=True)]
    return _read_only(name, np.vstack([vertices for vertices, _ in parts]), np.vstack(faces).astype(np.int32))


def _mirrored(segment: SegmentMesh, name: str) -> SegmentMesh:
    return _read_only(name, segment.vertices_heights * (1.0, -1.0, 1.0), segment.faces[:, ::-1].copy())


def _read_only(name: str, vertices_heights: Floats, faces: Ints) -> SegmentMesh:
    vertices_heights.flags.writeable = faces.flags.writeable = False  # one copy is shared by all callers
    return SegmentMesh(name, vertices_heights, faces)
