"""An actor is the body model fitted to one person; a body is its skeleton and meshes, ready to be posed."""

import hashlib
import tomllib
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Annotated

import numpy as np
import tomli_w
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, field_serializer, field_validator

from services.mocap.body.body_mesh import BodyMesh, OwnMesh, SegmentMesh, generic_mesh
from services.mocap.body.bones import BONES, scales_across, stretched_offsets, trunk_ratios, trunk_widening
from services.mocap.body.colours import check_colours, class_table
from services.mocap.body.garments import Hat, Skirt, with_hat, with_skirt
from services.mocap.body.kinematics import CLOTH_FRAMES, N_DOF, segment_transforms, surface_transforms
from services.mocap.body.profiles import SECTIONS, SHAPED_BY, Profile, check_profiles, factors_along
from services.mocap.body.skeleton import JOINT_INDEX, SEGMENT_INDEX, SEGMENTS
from services.mocap.body.skeleton_table import PELVIS, THIGH
from services.mocap.body.surface import MIRROR, as_one, moved, volume_m3
from services.mocap.errors import FrozenModel
from services.mocap.types import Bytes, Floats, Ints

DEFAULT_HEIGHT_M = 1.72
"""Body height if neither the take nor an actor gives one: about the mean of adults."""
MESH_FILE = "actor_mesh.npz"
"""File name of an own mesh, next to actor.toml."""
_SHAPES_KEPT = 64
"""Shapes of single segments that are kept: those of a body, and of its neighbours in the space of shapes."""
_HIP_DEPTH_HEIGHTS = 0.056
"""How deep the generic body's hip joints lie behind the front of the thighs."""
_NO_CLOTH: tuple[Floats, ...] = (np.zeros((0, 3)),) * len(CLOTH_FRAMES)


class MeshName(FrozenModel):
    """The table in actor.toml that names an own mesh."""

    file: str = Field(pattern=r"^[^/\\]{1,100}$", description="the name of a file next to actor.toml")
    sha256: str = Field(pattern="^[0-9a-f]{64}$", description="that file's SHA-256, 64 hexadecimal digits")


class Actor(BaseModel):
    """The measures that make a body: its height and, where known, bone lengths and profiles."""

    model_config = ConfigDict(frozen=True, extra="forbid", arbitrary_types_allowed=True)

    height: float = Field(
        default=DEFAULT_HEIGHT_M, ge=0.5, le=2.5, description="the standing height in metres, from 0.5 to 2.5"
    )
    """Standing height without shoes, in metres; everything without a bone length or profile scales with
    it."""
    bone_lengths: dict[str, float] = Field(default={}, description="a table of bones with lengths in metres")
    """Bone -> metres, for those that differ from the generic proportions (names: BONES)."""
    profiles: Annotated[dict[str, Profile], BeforeValidator(check_profiles)] = Field(
        default={}, description="a table of segments with width and depth"
    )
    """Segment (without its side) -> its outline's factors over the generic one at this height (SECTIONS)."""
    hip_depth: float = Field(default=1.0, ge=0.5, le=2.0, description="a factor from 0.5 to 2")
    """How deep the hip joints lie behind the front of the thighs, over the generic body's."""
    mesh: OwnMesh | None = Field(default=None, description="a table with file and sha256 of an own mesh")
    """A user's own mesh in place of the generic body; the other fields then refer to it."""

    skirt: Skirt | None = Field(default=None, description="a table with length and flare")
    """A skirt or the tails of a coat, if the actor wears one."""
    hat: Hat | None = Field(default=None, description="a table with brim, peak, rim and crown")
    """A hat with a brim, or a cap with a peak, if the actor wears one."""
    colours: Annotated[dict[str, tuple[int, ...]], BeforeValidator(check_colours)] = Field(
        default={}, description="a table of segments with four colour classes each"
    )
    """Segment, with its side, or skirt -> the colour class of each quarter (services.mocap.body.colours)."""

    @field_validator("bone_lengths")
    @classmethod
    def _known_and_plausible(cls, lengths: dict[str, float]) -> dict[str, float]:
        for name, length_m in lengths.items():
            if name not in BONES:
                raise ValueError(f"{name} is not a bone; known are {', '.join(BONES)}")
            if not 0.01 <= length_m <= 1.0:
                raise ValueError(f"{name} = {length_m}: expected metres from 0.01 to 1")
        return lengths

    @property
    def form(self) -> BodyMesh:
        """The mesh that it shapes: its own or the generic one, in a skirt and a hat if it wears them."""
        mesh: BodyMesh = self.mesh or generic_mesh()
        if self.skirt is not None:
            mesh = with_skirt(mesh, self.skirt)
        return mesh if self.hat is None else with_hat(mesh, self.hat)

    def in_skirt(self, skirt: Skirt | None) -> "Actor":
        """The same actor in another skirt, or in none."""
        return self.model_copy(update={"skirt": skirt})

    def in_hat(self, hat: Hat | None) -> "Actor":
        """The same actor in another hat, or in none."""
        return self.model_copy(update={"hat": hat})

    @property
    def bare(self) -> "Actor":
        """The same actor without skirt and hat, as measured."""
        return self.in_skirt(None).in_hat(None)

    def to_toml(self) -> str:
        """The text of actor.toml, in the order of BONES and SECTIONS, so that equal actors have one hash."""
        lengths = {name: self.bone_lengths[name] for name in BONES if name in self.bone_lengths}
        profiles = {
            name: self.profiles[name].model_dump(mode="json") for name in SECTIONS if name in self.profiles
        }
        depth = None if self.hip_depth == 1.0 else self.hip_depth
        worn = {name: getattr(self, name) for name in ("skirt", "hat")}
        tables: dict[str, object] = {"height": self.height, "hip_depth": depth, "bone_lengths": lengths}
        tables |= {"profiles": profiles or None, "mesh": self._mesh_name(self.mesh)}
        tables |= {name: None if garment is None else garment.model_dump() for name, garment in worn.items()}
        tables["colours"] = dict(sorted(self.colours.items())) or None
        return tomli_w.dumps({name: value for name, value in tables.items() if value is not None})

    @field_serializer("mesh")
    def _mesh_name(self, mesh: OwnMesh | None) -> dict[str, str] | None:
        return None if mesh is None else {"file": MESH_FILE, "sha256": mesh.content_hash}

    @classmethod
    def from_toml(cls, text: str, mesh_of: "Callable[[MeshName], OwnMesh] | None" = None) -> "Actor":
        """Read the text of actor.toml; mesh_of finds the mesh that it names, if any.

        Raises tomllib.TOMLDecodeError, pydantic.ValidationError or what mesh_of raises.
        """
        tables = tomllib.loads(text)
        if mesh_of is not None and "mesh" in tables:
            tables["mesh"] = mesh_of(MeshName.model_validate(tables["mesh"]))
        return cls.model_validate(tables)

    @property
    def content_hash(self) -> str:
        """SHA-256 of the actor's text, which names it on the wire."""
        return hashlib.sha256(self.to_toml().encode()).hexdigest()


@dataclass(frozen=True, eq=False)
class Body:
    """An actor's skeleton and segment meshes in metres."""

    offsets_m: Floats
    """(J, 3) each joint relative to its parent in the rest pose; in a skirt (J + 1, 3), with the hem relative
    to the pelvis."""
    vertices_m: tuple[Floats, ...]
    """Per segment (V, 3), in the segment's frame."""
    faces: tuple[Ints, ...]
    """Per segment (F, 3), counter-clockwise seen from outside."""
    height_m: float
    mesh: BodyMesh = field(default_factory=generic_mesh)
    """The mesh that it was made from."""

    cloth_m: tuple[Floats, ...] = _NO_CLOTH
    """Per part of a skirt (V, 3), in its frame of CLOTH_FRAMES; of webs (4, 3), corners of a tetrahedron."""
    colour_classes: Bytes = field(default_factory=lambda: class_table({}))
    """(S + 5, QUARTERS) the colour class of each piece of each surface, 0 where none is known."""

    @cached_property
    def surfaces(self) -> tuple[tuple[Floats, Ints], ...]:
        """Vertices (V, 3) and faces (F, 3) of all that is drawn: the segments, then the cloth, each in its
        frame of SURFACE_FRAMES."""
        cloth_faces = [part.faces for part in self.mesh.cloth]
        return tuple(zip((*self.vertices_m, *self.cloth_m), (*self.faces, *cloth_faces), strict=True))

    @cached_property
    def shown(self) -> tuple[tuple[Floats, Ints], ...]:
        """Vertices (V, 3) and faces (F, 3) of the segments, for what moves no cloth: a skirt's cone is part
        of the pelvis, the webs between the legs are left out."""
        meshes, pelvis = list(zip(self.vertices_m, self.faces, strict=True)), SEGMENT_INDEX["pelvis"]
        meshes[pelvis] = as_one([meshes[pelvis], (self.cloth_m[0], self.mesh.cloth[0].faces)])
        return tuple(meshes)

    def posed_m(self, pose: Floats) -> Floats:
        """(V, 3) the vertices of all surfaces, one after the other, in the world in a pose (D,)."""
        T_world_surface = surface_transforms(pose[None], self.offsets_m)[0]
        return np.concatenate([moved(v, T) for (v, _), T in zip(self.surfaces, T_world_surface, strict=True)])

    @cached_property
    def centres_m(self) -> Floats:
        """(S, 3) mean surface point of each segment in its own frame."""
        return np.array([vertices.mean(axis=0) for vertices in self.vertices_m])

    def middles_m(self, poses: Floats) -> Floats:
        """(N, 3) about where the body's middle is in the world in poses (N, D), by volume."""
        T_world_segment = segment_transforms(poses, self.offsets_m)
        R, t_m = T_world_segment[..., :3, :3], T_world_segment[..., :3, 3]
        centres_world_m = np.einsum("nsij,sj->nsi", R, self.centres_m) + t_m
        return np.asarray(np.average(centres_world_m, axis=1, weights=self._volumes_m3))

    @cached_property
    def _volumes_m3(self) -> Floats:
        meshes = zip(self.vertices_m, self.faces, strict=True)
        return np.array([volume_m3(vertices, faces) for vertices, faces in meshes])

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
        """Smallest z in the world of any vertex in a (D,) pose."""
        T_world_segment = segment_transforms(pose[None], self.offsets_m)[0]
        return min(
            float((vertices @ T[2, :3]).min() + T[2, 3])
            for vertices, T in zip(self.vertices_m, T_world_segment, strict=True)
        )


def build_body(actor: Actor) -> Body:
    """The generic body or an own mesh, scaled to height, along bones to their lengths, across by profiles."""
    mesh = actor.form
    lengths_m = {name: length * actor.height for name, length in mesh.lengths_heights.items()}
    ratios = {
        name: length_m / (BONES[name].length_heights * actor.height)
        for name, length_m in (lengths_m | actor.bone_lengths).items()
    }
    shaped_m: dict[SegmentMesh, Floats] = {}
    vertices_m = []
    for segment, form in zip(SEGMENTS, mesh.left_forms, strict=True):
        if form not in shaped_m:
            shaped_m[form] = _shaped(segment.row.name, form, actor, ratios)
        vertices_m.append(shaped_m[form] * MIRROR if segment.side == "right" else shaped_m[form])
    offsets_m = stretched_offsets(mesh.offsets_heights * actor.height, ratios)
    offsets_m[JOINT_INDEX["waist"], 0] += _hips_setback_m(actor)  # the pelvis joint stays between the hips
    cloth_m = _NO_CLOTH
    if actor.skirt:
        cone, *webs = mesh.cloth
        cloth_m = (_shaped("pelvis", cone, actor, ratios), *(web.vertices_heights for web in webs))
        offsets_m = np.vstack([offsets_m, (0.0, 0.0, cloth_m[0][:, 2].min())])
    return Body(
        offsets_m=offsets_m,
        vertices_m=tuple(vertices_m),
        faces=mesh.faces,
        height_m=actor.height,
        mesh=mesh,
        cloth_m=cloth_m,
        colour_classes=class_table(actor.colours),
    )


def mesh_named_in(text: str) -> str | None:
    """The SHA-256 of the own mesh that the text of an actor.toml names, if any; raises as from_toml."""
    mesh = tomllib.loads(text).get("mesh")
    return None if mesh is None else MeshName.model_validate(mesh).sha256


def _shaped(segment: str, form: SegmentMesh, actor: Actor, ratios: dict[str, float]) -> Floats:
    """(V, 3) a segment's vertices in metres, in its frame, on the left; segment without its side."""
    profiles = ((name, actor.profiles[name]) for name in SHAPED_BY[segment] if name in actor.profiles)
    scales = tuple(scales_across(segment, ratios).tolist())
    trunk = trunk_ratios(segment, ratios)
    setback_m = _hips_setback_m(actor) if segment in (PELVIS.name, THIGH.name) else 0.0
    return _shape(segment, form, actor.height, scales, trunk, tuple(profiles), setback_m).copy()


@lru_cache(_SHAPES_KEPT)
def _shape(
    segment: str,
    form: SegmentMesh,
    height_m: float,
    scales: tuple[float, ...],
    trunk: tuple[float, float],
    profiles: tuple[tuple[str, Profile], ...],
    setback_m: float,
) -> Floats:
    """See _shaped: of all that a segment's shape depends on. A fit changes few of them at a time."""
    heights = form.vertices_heights
    vertices_m: Floats = heights * (height_m * np.array(scales))
    for extent, axis in zip(("width", "depth"), SECTIONS[segment].axes[1:], strict=True):
        vertices_m[:, "xyz".index(axis)] *= factors_along(segment, extent, dict(profiles), form)
    vertices_m[:, 1] *= trunk_widening(segment, heights[:, 2], *trunk)
    # Pelvis and thighs stay where they are when their bones begin farther back.
    along = heights[:, 2] / THIGH.section.end if segment == THIGH.name else 0.0
    vertices_m[:, 0] += setback_m * (1.0 - np.clip(along, 0.0, 1.0))
    return vertices_m


def _hips_setback_m(actor: Actor) -> float:
    """How far the hip joints lie behind the generic body's."""
    return (actor.hip_depth - 1.0) * _HIP_DEPTH_HEIGHTS * actor.height
