"""Imports a file as an own mesh, for `--mesh FILE`."""

from dataclasses import dataclass
from pathlib import Path

import fast_simplification
import numpy as np

from services.mocap.body.body_mesh import OwnMesh
from services.mocap.body.own_mesh.character import Character, Piece
from services.mocap.body.own_mesh.closing import closed
from services.mocap.body.own_mesh.gltf import read_gltf
from services.mocap.body.own_mesh.parts import character_of_parts, load_parts, parts_of_gltf
from services.mocap.body.own_mesh.proportions import body_mesh, in_rest_pose
from services.mocap.body.own_mesh.skinned_character import character_of_skin
from services.mocap.body.skeleton import SEGMENT_NAMES, TRUNK
from services.mocap.body.surface import volume_m3
from services.mocap.errors import UserError

_GLTF = (".glb", ".gltf", ".vrm")
_PARTS = (".obj", ".ply")
_MOST_FACES, _THINNED_FACES = 24_000, 20_000
_FEWEST_FACES = 60
"""Least number of faces of a segment."""
_LEAST_VOLUME = 1e-6
"""Of a segment, in cubes of the body's height; a finger has more."""


@dataclass(frozen=True, eq=False)
class Imported:
    """A mesh that was read."""

    mesh: OwnMesh
    remarks: tuple[str, ...]
    """Sentences for the user about what was changed."""


def import_mesh(path: Path) -> Imported:
    """Read a user's mesh: a skinned glTF character, or a file of parts named like our segments.

    Raises UserError if that is not possible.
    """
    rest = in_rest_pose(_character(path))
    # A dome on the trunk would stay visible as a lump when a limb is lifted.
    pieces = {name: closed(rest.pieces[name], domed=name not in TRUNK) for name in SEGMENT_NAMES}
    n_given, n_faces = _count(rest.pieces), _count(pieces)
    remarks: tuple[str, ...] = ()
    if n_faces > _MOST_FACES:
        pieces = {name: _thinned(piece, _THINNED_FACES / n_faces) for name, piece in pieces.items()}
    if n_given > _MOST_FACES:
        told = f"its {n_given} triangles were thinned to {_count(pieces)}: more would only take time"
        remarks = (f"{path}: {told}",)
    _check_volumes(path, pieces)
    return Imported(OwnMesh.of(body_mesh(Character(rest.joints, pieces), str(path))), remarks)


def _count(pieces: dict[str, Piece]) -> int:
    return sum(len(piece.faces) for piece in pieces.values())


def _character(path: Path) -> Character:
    suffix = path.suffix.lower()
    if not path.is_file():
        raise UserError(f"{path}: does not exist: expected a .glb, .obj or .ply file")
    if suffix in _GLTF:
        gltf = read_gltf(path)
        return character_of_skin(path, gltf) if gltf.skins else character_of_parts(path, parts_of_gltf(gltf))
    if suffix in _PARTS:
        return character_of_parts(path, load_parts(path))
    raise UserError(f"{path}: expected a mesh in a .glb, .vrm, .gltf, .obj or .ply file")


def _thinned(piece: Piece, share: float) -> Piece:
    """A closed piece with about that share of its faces, closed again."""
    target = max(round(share * len(piece.faces)), _FEWEST_FACES)
    if target >= len(piece.faces):
        return piece
    scale = max(float(np.ptp(piece.vertices, axis=0).max()), 1e-12)
    vertices, faces = fast_simplification.simplify(
        piece.vertices / scale, piece.faces.copy(), target_count=target
    )
    thin = Piece(
        np.asarray(vertices, np.float64) * scale, np.asarray(faces, np.int32), np.zeros(len(vertices), bool)
    )
    return closed(thin, domed=False) if len(faces) else piece


def _check_volumes(path: Path, pieces: dict[str, Piece]) -> None:
    extent = max(float(np.ptp(np.concatenate([p.vertices for p in pieces.values()])[:, 2])), 1e-12)
    flat = []
    for name, piece in pieces.items():
        if volume_m3(piece.vertices - piece.vertices.mean(axis=0), piece.faces) < _LEAST_VOLUME * extent**3:
            flat.append(name.replace("_", " "))
    if flat:
        raise UserError(f"{path}: its {', '.join(flat)} has no volume: expected closed surfaces, not sheets")
