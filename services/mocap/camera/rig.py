"""A rig: the projections and picture sizes of all cameras, which the energy needs."""

import hashlib
import json
from dataclasses import dataclass
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from services.mocap.camera.camera import Camera, nearest_to_rays_m
from services.mocap.errors import FrozenModel
from services.mocap.types import Floats, Ints

WORKING_WIDTH_PX = 320
"""What is measured in working pixels counts as in a picture of this width."""


@dataclass(frozen=True, eq=False)
class Rig:
    """The projections and picture sizes of all cameras."""

    P_px_world: Floats
    """(C, 3, 4) homogeneous world metres to homogeneous pixels of the undistorted whole picture."""
    sizes_px: Ints
    """(C, 2) width and height."""

    @classmethod
    def of(cls, cameras: tuple[Camera, ...]) -> "Rig":
        """The rig of a take's cameras; assumes undistorted pictures."""
        return cls(
            np.array([camera.P_px_world for camera in cameras]),
            np.array([camera.size_px for camera in cameras], np.int32),
        )

    @property
    def n_cameras(self) -> int:
        """How many cameras there are."""
        return len(self.P_px_world)

    @property
    def shape_px(self) -> tuple[int, int]:
        """(height, width) that hold every camera's whole picture."""
        width, height = self.sizes_px.max(axis=0)
        return int(height), int(width)

    @property
    def scales(self) -> Floats:
        """(C,) pixels of each camera per working pixel."""
        return np.asarray(self.sizes_px[:, 0] / WORKING_WIDTH_PX, np.float64)

    @property
    def scale(self) -> float:
        """Pixels of the widest camera per working pixel."""
        return self.shape_px[1] / WORKING_WIDTH_PX

    @property
    def middle_world_m(self) -> Floats:
        """(3,) the point that all cameras look at, as nearly as possible."""
        M, p = self.P_px_world[:, :, :3], self.P_px_world[:, :, 3]
        axes = M[:, 2] / np.linalg.norm(M[:, 2], axis=1, keepdims=True)
        return nearest_to_rays_m(np.asarray(-np.linalg.solve(M, p[..., None])[..., 0], np.float64), axes)

    def to_json(self) -> str:
        """The rig as JSON text, for the wire."""
        return json.dumps({"P_px_world": self.P_px_world.tolist(), "sizes_px": self.sizes_px.tolist()})

    @classmethod
    def from_json(cls, text: str) -> "Rig":
        """Parse to_json's text; raises pydantic.ValidationError."""
        fields = _RigFields.model_validate_json(text)
        return cls(np.array(fields.P_px_world), np.array(fields.sizes_px, np.int32))

    @property
    def content_hash(self) -> str:
        """SHA-256 of the text, which names the rig on the wire."""
        return hashlib.sha256(self.to_json().encode()).hexdigest()


_Number = Annotated[float, Field(allow_inf_nan=False)]
_Row = tuple[_Number, _Number, _Number, _Number]
_Pixels = Annotated[int, Field(ge=1, le=16384)]


class _RigFields(FrozenModel):
    """The rig's text, checked."""

    P_px_world: list[tuple[_Row, _Row, _Row]]
    sizes_px: list[tuple[_Pixels, _Pixels]]

    @model_validator(mode="after")
    def _same_cameras(self) -> Self:
        if not self.P_px_world or len(self.P_px_world) != len(self.sizes_px):
            raise ValueError("expected a projection and a size for every camera, and at least one camera")
        return self
