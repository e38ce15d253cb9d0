"""Reads and writes actor.toml, the fitted actor in a take folder."""

import hashlib
import os
import shutil
from pathlib import Path

from services.mocap.atomic import write_file
from services.mocap.body.actor import MESH_FILE, Actor, MeshName
from services.mocap.body.body_mesh import MeshContentError, OwnMesh
from services.mocap.body.profiles import Profile
from services.mocap.errors import TakeError, UserError, load_toml, validated
from services.mocap.take.folder import Take
from services.mocap.take.layout import ACTOR

_HASH = "# sha256 = "
_DIGITS = 4
"""Lengths to a tenth of a millimetre, factors to a hundredth of a percent; a fit is not more exact."""


def take_actor(take: Take, fitted: Path | None = None) -> Actor | None:
    """The actor in a folder of xormocap fit, else in the take, if any; raises TakeError if it cannot be
    used."""
    path = take.actor_path if fitted is None else fitted / ACTOR
    return read_actor(path) if path is not None else None


def read_actor(path: Path) -> Actor:
    """The actor of a file; raises TakeError if it is missing or cannot be used."""
    tables = load_toml(path, TakeError)
    if "mesh" in tables:
        tables["mesh"] = _read_mesh(path, tables["mesh"])
    return validated(Actor, tables, f"{path}: ", TakeError)


def _read_mesh(actor_toml: Path, named: object) -> OwnMesh:
    """The mesh next to an actor.toml, which names it."""
    if not isinstance(named, dict):
        raise TakeError(f"{actor_toml}: mesh: expected a table with file and sha256")
    name = validated(MeshName, named, f"{actor_toml}: mesh.", TakeError)
    path = actor_toml.with_name(name.file)
    try:
        content = path.read_bytes()
        if hashlib.sha256(content).hexdigest() != name.sha256:
            raise TakeError(
                f"{path}: is not the mesh that {actor_toml.name} names: restore that or run fit --mesh again"
            )
        return OwnMesh.from_bytes(content)
    except OSError:
        raise TakeError(
            f"{path}: is missing: expected the mesh that {actor_toml.name} names: restore it or fit again"
        ) from None
    except MeshContentError as error:
        raise TakeError(f"{path}: {error}: run xormocap fit --mesh again") from None


def copy_actor(path: Path, folder: Path) -> None:
    """Copy an actor.toml to a folder, with the mesh that it names, if any; raises as read_actor."""
    read_actor(path)
    shutil.copy(path, folder / ACTOR)
    mesh = load_toml(path, TakeError).get("mesh")
    if mesh is not None:
        shutil.copy(path.with_name(mesh["file"]), folder)


def rounded(actor: Actor) -> Actor:
    """The actor as it is written, with four decimals."""
    profiles = {
        name: Profile(
            width=tuple(round(factor, _DIGITS) for factor in profile.width),
            depth=tuple(round(factor, _DIGITS) for factor in profile.depth),
        )
        for name, profile in actor.profiles.items()
    }
    lengths_m = {name: round(length_m, _DIGITS) for name, length_m in actor.bone_lengths.items()}
    single = {name: round(getattr(actor, name), _DIGITS) for name in ("height", "hip_depth")}
    return actor.model_copy(update={**single, "bone_lengths": lengths_m, "profiles": profiles})


def write_actor(path: Path, actor: Actor, origin: str) -> None:
    """Write a fitted actor, completely or not at all, after its mesh; origin: what it was fitted to, in
    words."""
    if actor.mesh is not None:
        write_file(path.with_name(MESH_FILE), actor.mesh.content)
    measured_by = "the generic body" if actor.mesh is None else MESH_FILE
    head = (
        f"# The actor, fitted by xormocap to {origin}.",
        "# height and bone_lengths: metres. hip_depth: of the hip joints behind the front of the thighs;",
        "# profiles: width and depth of each segment, from its near to its far end; both as factors on those",
        f"# of {measured_by} at this height.",
        "# The hash is that of the numbers: while it is right, xormocap fit may replace this file.",
        f"{_HASH}{actor.content_hash}",
    )
    write_file(path, "\n".join(head) + "\n\n" + actor.to_toml())


def check_place(path: Path, force: bool) -> None:
    """Raise UserError unless a fitted actor may be written to path.

    The folder, or its parent, must be writable; and an existing file must be from an earlier fit, without
    changes by hand, unless force is given.
    """
    existing = next(folder for folder in path.resolve().parents if folder.exists())
    if not (existing.is_dir() and os.access(existing, os.W_OK | os.X_OK)):
        raise UserError(f"{existing}: cannot be written to: give another folder with --out")
    if path.exists() and not force and not _is_as_fitted(path):
        raise UserError(
            f"{path}: was made or changed by hand: keep it and give --out, or replace it with --force"
        )


def _is_as_fitted(path: Path) -> bool:
    try:
        said = [line for line in path.read_text(encoding="utf-8").splitlines() if line.startswith(_HASH)]
        return said == [f"{_HASH}{read_actor(path).content_hash}"]
    except (TakeError, OSError, UnicodeDecodeError):
        return False
