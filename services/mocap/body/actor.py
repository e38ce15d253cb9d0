"""An actor is the body model fitted to one person; a body is its skeleton and meshes, ready to be posed."""

import hashlib
import tomllib
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import tomli_w
from pydantic import BaseModel, ConfigDict, Field, field_validator

from services.mocap.body.kinematics import N_DOF, segment_transforms
from services.mocap.body.shape import generic_segments
from services.mocap.body.skeleton import JOINTS, SEGMENT_NAMES
from services.mocap.types import Floats, Ints

DEFAULT_HEIGHT_M = 1.72
"""Body height where neither the take nor an actor gives one: about the mean of adults."""


@dataclass(frozen=True)
class Bone:
    """A length that may differ between people, and what it stretches (left and right alike)."""

    length_heights: float
    """The generic body's length, in body heights."""
    joints: dict[str, int]
    """Joint (without its side) -> the axis of its offset from its parent that scales with this bone."""
    segments: dict[str, str]
    """Segment (without its side) -> the axes of its mesh that scale with this bone."""


BONES: dict[str, Bone] = {
    "hip_width": Bone(0.105, {"hip": 1}, {"pelvis": "y"}),
    "pelvis": Bone(0.075, {"waist": 2}, {"pelvis": "z"}),
    "torso": Bone(0.248, {"neck": 2, "shoulder": 2}, {"torso": "z"}),
    "shoulder_width": Bone(0.215, {"shoulder": 1}, {"torso": "y"}),
    "neck": Bone(0.058, {"head": 2}, {"neck": "z"}),
    "head": Bone(0.094, {"head_top": 2}, {"head": "xyz"}),
    "upper_arm": Bone(0.165, {"elbow": 1}, {"upper_arm": "y"}),
    "forearm": Bone(0.152, {"wrist": 1}, {"forearm": "y"}),
    "hand": Bone(0.108, {}, {"hand": "xyz"}),
    "thigh": Bone(0.243, {"knee": 2}, {"thigh": "z"}),
    "shank": Bone(0.242, {"ankle": 2}, {"shank": "z"}),
    "foot": Bone(0.152, {}, {"foot": "xy"}),
}


class Actor(BaseModel):
    """The measures that make a body: its height and, where known, bone lengths, in metres."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    height: float = Field(default=DEFAULT_HEIGHT_M, ge=0.5, le=2.5)
    """Standing height without shoes, in metres."""
    bone_lengths: dict[str, float] = {}
    """Bone -> metres, for those that differ from the generic proportions (names: BONES)."""

    @field_validator("bone_lengths")
    @classmethod
    def _known_and_plausible(cls, lengths: dict[str, float]) -> dict[str, float]:
        for name, length_m in lengths.items():
            if name not in BONES:
                raise ValueError(f"{name} is not a bone; known are {', '.join(BONES)}")
            if not 0.01 <= length_m <= 1.0:
                raise ValueError(f"{name} = {length_m}: expected metres from 0.01 to 1")
        return lengths

    def to_toml(self) -> str:
        """The text of actor.toml, bones in the order of BONES, so that equal actors have one content hash."""
        lengths = {name: self.bone_lengths[name] for name in BONES if name in self.bone_lengths}
        return tomli_w.dumps({**self.model_dump(), "bone_lengths": lengths})

    @classmethod
    def from_toml(cls, text: str) -> "Actor":
        """Read the text of actor.toml; raises tomllib.TOMLDecodeError or pydantic.ValidationError."""
        return cls.model_validate(tomllib.loads(text))

    @property
    def content_hash(self) -> str:
        """SHA-256 of the actor's text, which names it on the wire."""
        return hashlib.sha256(self.to_toml().encode()).hexdigest()


@dataclass(frozen=True, eq=False)
class Body:
    """An actor's skeleton and segment meshes in metres."""

    offsets_m: Floats
    """(17, 3) each joint relative to its parent in the rest pose."""
    vertices_m: tuple[Floats, ...]
    """Per segment (V, 3), in the segment's frame."""
    faces: tuple[Ints, ...]
    """Per segment (F, 3), counter-clockwise seen from outside."""
    height_m: float

    @cached_property
    def centres_m(self) -> Floats:
        """(16, 3) mean surface point of each segment in its own frame."""
        return np.array([vertices.mean(axis=0) for vertices in self.vertices_m])

    @property
    def pelvis_height_m(self) -> float:
        """Height of the hip centres over the soles when standing in the rest pose."""
        return -self.lowest_point_m(np.zeros(N_DOF))

    def lowest_point_m(self, pose: Floats) -> float:
        """Smallest z in the world of any vertex in a (35,) pose."""
        T_world_segment = segment_transforms(pose[None], self.offsets_m)[0]
        return min(
            float((vertices @ T[2, :3]).min() + T[2, 3])
            for vertices, T in zip(self.vertices_m, T_world_segment, strict=True)
        )


def _bare(name: str) -> str:
    """A joint's or segment's name without its side."""
    return name.removeprefix("left_").removeprefix("right_")


def build_body(actor: Actor) -> Body:
    """The generic body scaled to an actor's height, then along each bone to its given length."""
    ratios = {
        name: length_m / (BONES[name].length_heights * actor.height)
        for name, length_m in actor.bone_lengths.items()
    }
    offsets_m = np.array([joint.offset_heights for joint in JOINTS]) * actor.height
    scales = np.full((len(SEGMENT_NAMES), 3), actor.height)
    for name, ratio in ratios.items():
        for j, joint in enumerate(JOINTS):
            if _bare(joint.name) in BONES[name].joints:
                offsets_m[j, BONES[name].joints[_bare(joint.name)]] *= ratio
        for s, segment in enumerate(SEGMENT_NAMES):
            for axis in BONES[name].segments.get(_bare(segment), ""):
                scales[s, "xyz".index(axis)] *= ratio
    meshes = generic_segments()
    return Body(
        offsets_m=offsets_m,
        vertices_m=tuple(mesh.vertices_heights * s for mesh, s in zip(meshes, scales, strict=True)),
        faces=tuple(mesh.faces for mesh in meshes),
        height_m=actor.height,
    )
