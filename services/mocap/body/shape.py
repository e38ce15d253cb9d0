"""The generic actor's shape: closed triangle meshes, one per segment, in body heights.

Right and left are mirror images. Neighbouring segments overlap at their joint in rounded ends, so that a
bent joint shows no gap.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np

from services.mocap.body.shape_loft import loft_mesh
from services.mocap.body.skeleton import SEGMENTS
from services.mocap.types import Floats, Ints

# Gives about 21,400 triangles in all, as many as the model of Theobalt et al. 2003 has.
EDGE_HEIGHTS = 0.0101


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
    """The segments of a neutral adult, in the order of SEGMENT_NAMES; the arrays are read-only."""
    built: dict[str, SegmentMesh] = {}
    for segment in SEGMENTS:  # left before right
        if segment.side == "right":
            left = built[f"left_{segment.row.name}"]
            vertices_heights, faces = left.vertices_heights * (1.0, -1.0, 1.0), left.faces[:, ::-1].copy()
        else:
            parts = [loft_mesh(loft, EDGE_HEIGHTS) for loft in segment.row.lofts]
            first = np.cumsum([0] + [len(vertices) for vertices, _ in parts])
            vertices_heights = np.vstack([vertices for vertices, _ in parts])
            of_all = [own + start for (_, own), start in zip(parts, first[:-1], strict=True)]
            faces = np.vstack(of_all).astype(np.int32)
        vertices_heights.flags.writeable = faces.flags.writeable = False  # one copy is shared by all callers
        built[segment.name] = SegmentMesh(segment.name, vertices_heights, faces)
    return tuple(built.values())
