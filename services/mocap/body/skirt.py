"""A skirt, or the tails of a coat: a cone that hangs about the legs, and a tube between them.

The cone hangs from the hips by its weight: it turns with the pelvis, but leans half as far. Where the legs
leave it they stretch the cloth between them, which the tube stands for: one part lies halfway between the
thighs, the other one halfway between the shanks. Without them, legs would be searched at the outline of the
cloth.
"""

from functools import lru_cache

from pydantic import BaseModel, ConfigDict, Field

from services.mocap.body import shape_profiles
from services.mocap.body.body_mesh import NOTHING, BodyMesh
from services.mocap.body.shape import EDGE_HEIGHTS, SegmentMesh
from services.mocap.body.shape_loft import loft_mesh

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
    """A body's mesh in a skirt."""
    names, lofts = ("pelvis", "thigh", "shank"), shape_profiles.skirt(skirt.length, skirt.flare)
    cone, thighs, shanks = (
        SegmentMesh(name, *loft_mesh(loft, EDGE_HEIGHTS)) if loft else NOTHING
        for name, loft in zip(names, lofts, strict=True)
    )
    return BodyMesh(mesh.segments, mesh.offsets_heights, mesh.lengths_heights, (cone, thighs, shanks))
