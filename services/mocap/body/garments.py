"""What an actor wears that does more than widen trunk and limbs: a skirt or the tails of a coat; a hat."""

from functools import lru_cache

import numpy as np
from pydantic import Field

from services.mocap.body import shape_profiles
from services.mocap.body.body_mesh import EDGE_HEIGHTS, BodyMesh, SegmentMesh
from services.mocap.body.cloth_frames import WEBS
from services.mocap.body.shape_loft import loft_mesh
from services.mocap.body.surface import as_one
from services.mocap.errors import FrozenModel

_MESHES_KEPT = 64
_WEB = SegmentMesh(
    "web",
    np.vstack([np.zeros((1, 3)), np.eye(3)]),
    np.array([(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)], np.int32),
)
"""A unit tetrahedron, whose corners a web's frame takes to points of the legs: not in body heights."""


class Skirt(FrozenModel):
    """What of a skirt or a coat covers the legs: a cone that hangs about them, and webs between them.

    Without webs (cloth_frames.py), legs would be searched at the outline of the cloth.
    """

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


class Hat(FrozenModel):
    """A hat with a brim, or a cap with a peak.

    Without it, the head was fitted as wide as the brim and turned to where the brim was.
    """

    brim: float = Field(
        ge=1.0, le=3.0, description="its reach at the sides and behind over the head's, 1 to 3"
    )
    """How many times as far as the head it reaches from the head's middle, at the sides and behind."""
    peak: float = Field(ge=1.0, le=3.0, description="its reach in front over the head's, 1 to 3")
    """The same in front."""
    rim: float = Field(
        ge=0.0, le=0.08, description="its height over the head's joint, 0 to 0.08 body heights"
    )
    """Height of the brim over the head's joint, in body heights."""
    crown: float = Field(
        ge=0.0, le=0.15, description="its height over the top of the head, 0 to 0.15 body heights"
    )
    """How far the hat rises over the top of the head, in body heights."""


@lru_cache(_MESHES_KEPT)
def with_hat(mesh: BodyMesh, hat: Hat) -> BodyMesh:
    """A body's mesh in a hat, which is part of the head's surface."""
    lofts = [
        loft_mesh(loft, EDGE_HEIGHTS) for loft in shape_profiles.hat(hat.brim, hat.peak, hat.rim, hat.crown)
    ]
    segments = tuple(
        SegmentMesh("head", *as_one([(segment.vertices_heights, segment.faces), *lofts]))
        if segment.name == "head"
        else segment
        for segment in mesh.segments
    )
    return BodyMesh(segments, mesh.offsets_heights, mesh.lengths_heights, mesh.cloth)
