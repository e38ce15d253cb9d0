"""A skirt, or the tails of a coat: a cone about the legs that hangs from the pelvis.

It moves with the pelvis as a rigid surface, so a leg that lifts the cloth comes out of it. Without it, legs
would be searched at the outline of the cloth.
"""

from functools import lru_cache

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from services.mocap.body import shape_profiles
from services.mocap.body.body_mesh import BodyMesh
from services.mocap.body.shape import EDGE_HEIGHTS, SegmentMesh
from services.mocap.body.shape_loft import loft_mesh
from services.mocap.body.skeleton import SEGMENT_INDEX

_MESHES_KEPT = 64


class Skirt(BaseModel):
    """What of a skirt or a coat covers the legs."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    length: float = Field(
        ge=0.05, le=0.5, description="from the hip joints to the hem, 0.05 to 0.5 body heights"
    )
    """From the hip joints to the hem, in body heights."""
    flare: float = Field(ge=0.0, le=0.2, description="hem beyond hips, on each side, 0 to 0.2 body heights")
    """How far the hem reaches beyond the hips on every side, in body heights."""


@lru_cache(_MESHES_KEPT)
def with_skirt(mesh: BodyMesh, skirt: Skirt) -> BodyMesh:
    """A body's mesh whose pelvis has the cone as one more closed surface."""
    pelvis = mesh.segments[SEGMENT_INDEX["pelvis"]]
    vertices_heights, faces = loft_mesh(shape_profiles.skirt(skirt.length, skirt.flare), EDGE_HEIGHTS)
    vertices_heights = np.vstack([pelvis.vertices_heights, vertices_heights])
    faces = np.vstack([pelvis.faces, faces + len(pelvis.vertices_heights)]).astype(np.int32)
    vertices_heights.flags.writeable = faces.flags.writeable = False
    segments = list(mesh.segments)
    segments[SEGMENT_INDEX["pelvis"]] = SegmentMesh(pelvis.name, vertices_heights, faces)
    return BodyMesh(tuple(segments), mesh.offsets_heights, mesh.lengths_heights)
