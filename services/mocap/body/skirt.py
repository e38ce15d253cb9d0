"""A skirt, or the tails of a coat: a cone that hangs about the legs, and webs between them (cloth_frames.py).

Without webs, legs would be searched at the outline of the cloth.
"""

from functools import lru_cache

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from services.mocap.body import shape_profiles
from services.mocap.body.body_mesh import BodyMesh
from services.mocap.body.cloth_frames import WEBS
from services.mocap.body.shape import EDGE_HEIGHTS, SegmentMesh
from services.mocap.body.shape_loft import loft_mesh

_MESHES_KEPT = 64
_WEB = SegmentMesh(
    "web",
    np.vstack([np.zeros((1, 3)), np.eye(3)]),
    np.array([(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)], np.int32),
)
"""A unit tetrahedron, whose corners a web's frame takes to points of the legs: not in body heights."""


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
    """A body's mesh in a skirt."""
    cone = SegmentMesh("pelvis", *loft_mesh(shape_profiles.skirt(skirt.length, skirt.flare), EDGE_HEIGHTS))
    cloth = (cone, *[_WEB] * len(WEBS))
    return BodyMesh(mesh.segments, mesh.offsets_heights, mesh.lengths_heights, cloth)
