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
    """The segments of a neutral adult, in the order of SEGMENT_NAMES; the arrays are read-only."""
    built: dict[str, SegmentMesh] = {}
    for segment in SEGMENTS:  # left before right
        if segment.side == "right":
            left = built[f"left_{segment.row.name}"]
            vertices_heights, faces = left.vertices_heights * (1.0, -1.0, 1.0), left.faces[:, ::-1].copy()
        else:
            vertices_heights, faces = _joined([loft_mesh(loft, _EDGE_HEIGHTS) for loft in segment.row.lofts])
        vertices_heights.flags.writeable = faces.flags.writeable = False  # one copy is shared by all callers
        built[segment.name] = SegmentMesh(segment.name, vertices_heights, faces)
    return tuple(built.values())


def _joined(parts: list[tuple[Floats, Ints]]) -> tuple[Floats, Ints]:
    """Vertices (V, 3) and faces (F, 3) of several closed surfaces as one mesh."""
    first = np.cumsum([0] + [len(vertices) for vertices, _ in parts])
    faces = [part_faces + start for (_, part_faces), start in zip(parts, first[:-1], strict=True)]
    return np.vstack([vertices for vertices, _ in parts]), np.vstack(faces).astype(np.int32)
