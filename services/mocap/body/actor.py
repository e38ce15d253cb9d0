"""An actor is the body model fitted to one person; a body is its skeleton and meshes, ready to be posed."""

import hashlib
import tomllib
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
import tomli_w
from pydantic import BaseModel, ConfigDict, Field, field_validator

from services.mocap.body.kinematics import N_DOF, segment_transforms
from services.mocap.body.profiles import SECTIONS, Profile, check_profiles, factors_along, smoothstep
from services.mocap.body.shape import generic_segments
from services.mocap.body.skeleton import JOINT_INDEX, JOINTS, SEGMENT_INDEX, SEGMENT_NAMES
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
    "hip_width": Bone(0.105, {"hip": 1}, {}),
    "pelvis": Bone(0.075, {"waist": 2}, {"pelvis": "z"}),
    "torso": Bone(0.248, {"neck": 2, "shoulder": 2}, {"torso": "z"}),
    "shoulder_width": Bone(0.215, {"shoulder": 1}, {}),
    "neck": Bone(0.058, {"head": 2}, {"neck": "z"}),
    "head": Bone(0.094, {"head_top": 2}, {"head": "xyz"}),
    "upper_arm": Bone(0.165, {"elbow": 1}, {"upper_arm": "y"}),
    "forearm": Bone(0.152, {"wrist": 1}, {"forearm": "y"}),
    "hand": Bone(0.108, {}, {"hand": "xyz"}),
    "thigh": Bone(0.243, {"knee": 2}, {"thigh": "z"}),
    "shank": Bone(0.242, {"ankle": 2}, {"shank": "z"}),
    "foot": Bone(0.152, {}, {"foot": "xy"}),
}
"""The trunk's mesh widens too: at the shoulders and above with shoulder_width, at the hips and below by as
much as the hip joints move, and smoothly from one to the other between."""

_SHOULDERS = 0.280
"""Height of the shoulder joints over the hips', in body heights."""
_HIPS_SHARE = 0.536
"""Share of the trunk's width at the hips that lies between the hip joints."""
_TRUNK_OFFSETS = {"pelvis": 0.0, "torso": 0.075}
"""The trunk's segments, and the height of their joints over the hips', in body heights."""


class Actor(BaseModel):
    """The measures that make a body: its height and, where known, bone lengths and profiles."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    height: float = Field(
        default=DEFAULT_HEIGHT_M, ge=0.5, le=2.5, description="the standing height in metres, from 0.5 to 2.5"
    )
    """Standing height without shoes, in metres; what no bone length and no profile says scales with it."""
    bone_lengths: dict[str, float] = Field(default={}, description="a table of bones with lengths in metres")
    """Bone -> metres, for those that differ from the generic proportions (names: BONES)."""
    profiles: dict[str, Profile] = Field(default={}, description="a table of segments with width and depth")
    """Segment (without its side) -> its outline's factors over the generic one at this height (SECTIONS)."""

    @field_validator("bone_lengths")
    @classmethod
    def _known_and_plausible(cls, lengths: dict[str, float]) -> dict[str, float]:
        for name, length_m in lengths.items():
            if name not in BONES:
                raise ValueError(f"{name} is not a bone; known are {', '.join(BONES)}")
            if not 0.01 <= length_m <= 1.0:
                raise ValueError(f"{name} = {length_m}: expected metres from 0.01 to 1")
        return lengths

    @field_validator("profiles", mode="before")
    @classmethod
    def _clear_complaints(cls, profiles: object) -> object:
        check_profiles(profiles)
        return profiles

    def to_toml(self) -> str:
        """The text of actor.toml, in the order of BONES and SECTIONS, so that equal actors have one hash."""
        lengths = {name: self.bone_lengths[name] for name in BONES if name in self.bone_lengths}
        profiles = {
            name: self.profiles[name].model_dump(mode="json") for name in SECTIONS if name in self.profiles
        }
        tables = {"height": self.height, "bone_lengths": lengths, "profiles": profiles}
        if not profiles:
            del tables["profiles"]  # the text, and so the hash, of actors from before there were profiles
        return tomli_w.dumps(tables)

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

    @property
    def standing_height_m(self) -> float:
        """From the soles to the top of the head when standing in the rest pose, whatever height_m says."""
        offset_m = self.offsets_m[: JOINT_INDEX["head"] + 1, 2].sum()  # pelvis, waist, neck, head in a row
        return self.pelvis_height_m + float(offset_m + self.vertices_m[SEGMENT_INDEX["head"]][:, 2].max())

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
    """The generic body scaled to an actor's height, along each bone to its length, across by profiles."""
    ratios = {
        name: length_m / (BONES[name].length_heights * actor.height)
        for name, length_m in actor.bone_lengths.items()
    }
    vertices_m: dict[str, Floats] = {}
    for name, mesh in zip(SEGMENT_NAMES, generic_segments(), strict=True):
        if name.startswith("right_"):
            vertices_m[name] = vertices_m[name.replace("right", "left", 1)] * (1.0, -1.0, 1.0)
        else:
            vertices_m[name] = _shaped(_bare(name), mesh.vertices_heights, actor, ratios)
    return Body(
        offsets_m=_offsets_m(actor, ratios),
        vertices_m=tuple(vertices_m[name] for name in SEGMENT_NAMES),
        faces=tuple(mesh.faces for mesh in generic_segments()),
        height_m=actor.height,
    )


def _offsets_m(actor: Actor, ratios: dict[str, float]) -> Floats:
    """(17, 3) each joint relative to its parent; ratios: bone -> its length over the generic one."""
    offsets_m = np.array([joint.offset_heights for joint in JOINTS]) * actor.height
    for j, joint in enumerate(JOINTS):
        for name, ratio in ratios.items():
            if _bare(joint.name) in BONES[name].joints:
                offsets_m[j, BONES[name].joints[_bare(joint.name)]] *= ratio
    return offsets_m


def _shaped(segment: str, vertices_heights: Floats, actor: Actor, ratios: dict[str, float]) -> Floats:
    """(V, 3) a segment's vertices in metres, in its frame; segment without its side."""
    scales = np.full(3, actor.height)
    for name, ratio in ratios.items():
        for axis in BONES[name].segments.get(segment, ""):
            scales["xyz".index(axis)] *= ratio
    vertices_m: Floats = vertices_heights * scales
    for extent, axis in zip(("width", "depth"), SECTIONS[segment].axes[1:], strict=True):
        vertices_m[:, "xyz".index(axis)] *= factors_along(segment, extent, actor.profiles)
    if segment in _TRUNK_OFFSETS:
        hips = 1.0 + _HIPS_SHARE * (ratios.get("hip_width", 1.0) - 1.0)
        shoulders = ratios.get("shoulder_width", 1.0)
        vertices_m[:, 1] *= hips + (shoulders - hips) * _shoulder_share(segment)
    return vertices_m


@cache
def _shoulder_share(segment: str) -> Floats:
    """(V,) how much a vertex of the trunk widens with the shoulders: 0 at the hips, 1 at the shoulders."""
    z: Floats = generic_segments()[SEGMENT_INDEX[segment]].vertices_heights[:, 2] + _TRUNK_OFFSETS[segment]
    return smoothstep(z / _SHOULDERS)
