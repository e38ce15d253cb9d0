"""What an actor's body is made from: closed meshes about a skeleton, the generic body's or a user's own.

Every mesh is stored stretched to the generic bones, together with its real bone lengths, so that the same
rules shape all meshes. An own mesh is identified by the SHA-256 of its file.
"""

import hashlib
import io
import zipfile
from dataclasses import dataclass, field
from functools import cache, cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from services.mocap.body.bones import BONES
from services.mocap.body.kinematics import CLOTH_FRAMES
from services.mocap.body.shape_loft import loft_mesh
from services.mocap.body.skeleton import JOINTS, SEGMENT_NAMES, SEGMENTS
from services.mocap.body.surface import MIRROR, as_one, is_closed
from services.mocap.types import Floats, Ints

# Gives about 21,400 triangles in all, as many as the model of Theobalt et al. 2003 has.
EDGE_HEIGHTS = 0.0101
_FORMAT = 1
_MOST_BYTES = 48 * 1024 * 1024
_RATIO_RANGE = (0.2, 5.0)
"""Plausible ranges of bone lengths over the generic ones, and of all sizes in body heights."""


class MeshContentError(ValueError):
    """The bytes are not a body mesh; the text says why."""


@dataclass(frozen=True, eq=False)
class SegmentMesh:
    """One segment's surface: one or more closed components, each watertight."""

    name: str
    vertices_heights: Floats
    """(V, 3) in body heights in the segment's frame: origin at its carrying joint, rest-pose axes."""
    faces: Ints
    """(F, 3) vertex indices, counter-clockwise seen from outside."""

    def mirrored(self, name: str) -> "SegmentMesh":
        """The same on the other side of the body, by another name."""
        return SegmentMesh(name, self.vertices_heights * MIRROR, self.faces[:, ::-1].copy())


NOTHING = SegmentMesh("nothing", np.zeros((0, 3)), np.zeros((0, 3), np.int32))


@dataclass(frozen=True, eq=False)
class BodyMesh:
    """The surface of a body one height tall, in the rest pose."""

    segments: tuple[SegmentMesh, ...]
    """In the order of SEGMENT_NAMES, stretched to the generic bones; only the width of the trunk, and what
    bones do not stretch, is the mesh's own."""
    offsets_heights: Floats
    """(J, 3) each joint relative to its parent, likewise."""
    lengths_heights: dict[str, float]
    """How long each bone really is (names: BONES), in body heights."""
    cloth: tuple[SegmentMesh, ...] = (NOTHING,) * len(CLOTH_FRAMES)
    """The parts of a skirt, in the order of CLOTH_FRAMES."""

    @cached_property
    def surfaces(self) -> tuple[SegmentMesh, ...]:
        """All that is drawn: the segments, then the cloth."""
        return (*self.segments, *self.cloth)

    @cached_property
    def faces(self) -> tuple[Ints, ...]:
        """Per segment (F, 3)."""
        return tuple(segment.faces for segment in self.segments)

    @cached_property
    def left_forms(self) -> tuple[SegmentMesh, ...]:
        """Every segment, mirrored to the left; the left one itself if both sides are equal."""
        left = {segment.name: segment for segment in self.segments}
        forms = []
        for segment in self.segments:
            twin = left.get(segment.name.replace("right_", "left_", 1), segment)
            mirrored = segment if twin is segment else segment.mirrored(twin.name)
            alike = np.array_equal(mirrored.vertices_heights, twin.vertices_heights)
            forms.append(twin if alike else mirrored)
        return tuple(forms)


@cache
def generic_segments() -> tuple[SegmentMesh, ...]:
    """The segments of a neutral adult, in the order of SEGMENT_NAMES; the arrays are read-only.

    Right and left are mirror images. Neighbouring segments overlap at their joint in rounded ends, so that a
    bent joint shows no gap.
    """
    built: dict[str, SegmentMesh] = {}
    for segment in SEGMENTS:  # left before right
        if segment.side == "right":
            mesh = built[f"left_{segment.row.name}"].mirrored(segment.name)
        else:
            lofts = [loft_mesh(loft, EDGE_HEIGHTS) for loft in segment.row.lofts]
            mesh = SegmentMesh(segment.name, *as_one(lofts))
        mesh.vertices_heights.flags.writeable = mesh.faces.flags.writeable = False  # all callers share them
        built[segment.name] = mesh
    return tuple(built.values())


@cache
def generic_mesh() -> BodyMesh:
    """The mesh of a neutral adult."""
    offsets_heights = np.array([joint.offset_heights for joint in JOINTS])
    lengths_heights = {name: bone.length_heights for name, bone in BONES.items()}
    return BodyMesh(generic_segments(), offsets_heights, lengths_heights)


@dataclass(frozen=True, eq=False)
class OwnMesh(BodyMesh):
    """A user's mesh; two with the same content are the same."""

    content: bytes = field(kw_only=True)
    """The file that holds it."""

    @cached_property
    def content_hash(self) -> str:
        """SHA-256 of the file, which names the mesh in actor.toml and on the wire."""
        return hashlib.sha256(self.content).hexdigest()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, OwnMesh) and other.content == self.content

    def __hash__(self) -> int:
        return hash(self.content)

    @classmethod
    def of(cls, mesh: BodyMesh) -> "OwnMesh":
        """Give a mesh the file that holds it."""
        buffer = io.BytesIO()
        np.savez_compressed(
            buffer,
            format=np.array(_FORMAT, np.int32),
            offsets_heights=mesh.offsets_heights,
            lengths_heights=np.array([mesh.lengths_heights[name] for name in BONES]),
            n_vertices=np.array([len(s.vertices_heights) for s in mesh.segments], np.int32),
            n_faces=np.array([len(s.faces) for s in mesh.segments], np.int32),
            vertices_heights=np.concatenate([s.vertices_heights for s in mesh.segments]).astype(np.float32),
            faces=np.concatenate([s.faces for s in mesh.segments]).astype(np.int32),
        )
        return cls.from_bytes(buffer.getvalue())

    @classmethod
    def from_bytes(cls, content: bytes) -> "OwnMesh":
        """Read the file; raises MeshContentError where it is not one."""
        arrays = _arrays(content)
        offsets_heights, lengths = arrays["offsets_heights"].astype(np.float64), arrays["lengths_heights"]
        vertices = np.split(arrays["vertices_heights"], np.cumsum(arrays["n_vertices"])[:-1])
        faces = np.split(arrays["faces"], np.cumsum(arrays["n_faces"])[:-1])
        segments = [
            _segment(name, v.astype(np.float64), f.astype(np.int32))
            for name, v, f in zip(SEGMENT_NAMES, vertices, faces, strict=True)
        ]
        lengths_heights = dict(zip(BONES, lengths.tolist(), strict=True))
        for name, length in lengths_heights.items():
            low, high = (factor * BONES[name].length_heights for factor in _RATIO_RANGE)
            if not low <= length <= high:
                raise MeshContentError(f"its bone {name} is {length:.3f} body heights long")
        return cls(tuple(segments), offsets_heights, lengths_heights, content=content)


_ARRAYS: dict[str, tuple[str, tuple[int, ...]]] = {
    "format": ("i4", ()),
    "offsets_heights": ("f8", (len(JOINTS), 3)),
    "lengths_heights": ("f8", (len(BONES),)),
    "n_vertices": ("i4", (len(SEGMENT_NAMES),)),
    "n_faces": ("i4", (len(SEGMENT_NAMES),)),
    "vertices_heights": ("f4", (-1, 3)),
    "faces": ("i4", (-1, 3)),
}
"""The arrays of the file: type and shape, -1 for any number."""


def _arrays(content: bytes) -> dict[str, NDArray[Any]]:
    """The arrays of a file, with checked types, shapes and checksums."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            if sum(member.file_size for member in archive.infolist()) > _MOST_BYTES:
                raise MeshContentError("it is too large")
        with np.load(io.BytesIO(content), allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in _ARRAYS}
    except (OSError, EOFError, ValueError, LookupError, zipfile.BadZipFile) as error:
        if isinstance(error, MeshContentError):
            raise
        raise MeshContentError("it is not a file of xormocap") from None
    for name, (dtype, shape) in _ARRAYS.items():
        array = arrays[name]
        fits = len(array.shape) == len(shape) and all(
            b in (-1, a) for a, b in zip(array.shape, shape, strict=True)
        )
        if array.dtype != np.dtype(dtype).newbyteorder("<") or not fits:
            raise MeshContentError(f"{name} is not as xormocap writes it")
        if array.dtype.kind == "f" and not np.all(np.abs(array) < _RATIO_RANGE[1]):
            raise MeshContentError(f"{name} contains an implausible number")
    for counts, rows in (("n_vertices", "vertices_heights"), ("n_faces", "faces")):
        if arrays[counts].min() < 0 or int(arrays[counts].sum(dtype=np.int64)) != len(arrays[rows]):
            raise MeshContentError(f"{counts} and {rows} do not match")
    if int(arrays["format"]) != _FORMAT:
        raise MeshContentError("it is of another version of xormocap: import the mesh again")
    return arrays


def _segment(name: str, vertices_heights: Floats, faces: Ints) -> SegmentMesh:
    if len(faces) == 0 or faces.min() < 0 or faces.max() >= len(vertices_heights):
        raise MeshContentError(f"the faces of its {name} name vertices that do not exist")
    if not is_closed(faces):
        raise MeshContentError(f"its {name} is not closed")
    vertices_heights.flags.writeable = faces.flags.writeable = False
    return SegmentMesh(name, vertices_heights, faces)
