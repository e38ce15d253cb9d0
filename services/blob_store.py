"""Content that messages name by its hash, as it comes in: actors, rigs and own meshes; without a socket."""

import hashlib
from collections import OrderedDict
from typing import TypeVar

from proto.messages import Blob, LimbTask, TakeInfo
from services.mocap.body.actor import Actor, mesh_named_in
from services.mocap.body.body_mesh import OwnMesh
from services.mocap.camera.rig import Rig

K = TypeVar("K")
V = TypeVar("V")


class UnusableBlobError(Exception):
    """Content that this version cannot read; there is no use in asking for it again."""


class DamagedBlobError(UnusableBlobError):
    """Content that is not what its hash names; it may be asked for again."""


class BlobStore:
    """The content that takes or tasks name."""

    def __init__(self, most: int = 1) -> None:
        """most: how many actors, rigs and meshes are kept; the oldest are forgotten."""
        self._most = most
        self._actors: OrderedDict[str, tuple[str, str | None]] = OrderedDict()
        """Texts, and the hash of the own mesh that each names, if any."""
        self._rigs: OrderedDict[str, Rig] = OrderedDict()
        self._meshes: OrderedDict[str, OwnMesh] = OrderedDict()

    def add(self, blob: Blob) -> None:
        """Store content; raises UnusableBlobError if it is damaged or not of its kind."""
        content = blob.content.tobytes()
        if hashlib.sha256(content).hexdigest() != blob.hash:
            raise DamagedBlobError(f"{blob.kind} {blob.hash[:8]}: damaged: its hash differs")
        try:
            if blob.kind == "mesh":
                keep_latest(self._meshes, blob.hash, OwnMesh.from_bytes(content), self._most)
            elif blob.kind == "rig":
                keep_latest(self._rigs, blob.hash, Rig.from_json(content.decode()), self._most)
            else:
                text = content.decode()
                mesh = mesh_named_in(text)
                if mesh is None:
                    Actor.from_toml(text)  # one with a mesh can only be checked when that is here
                keep_latest(self._actors, blob.hash, (text, mesh), self._most)
        except (ValueError, RecursionError) as error:  # the TOML reader recurses into nested arrays
            raise UnusableBlobError(f"{blob.kind} {blob.hash[:8]}: {error}") from None

    def missing(self, named: TakeInfo | LimbTask) -> list[str]:
        """Hashes of what a take or task needs and that is not here; a mesh once its actor is here."""
        _, mesh = self._actors.get(named.actor, ("", None))
        wanted = [named.actor] if named.actor not in self._actors else []
        wanted += [mesh] if mesh is not None and mesh not in self._meshes else []
        return wanted + ([named.rig] if named.rig not in self._rigs else [])

    def actor_text(self, named: TakeInfo) -> str:
        """The text of the actor that a take names; empty as long as it is not here."""
        return self._actors.get(named.actor, ("", None))[0]

    def actor(self, named: TakeInfo | LimbTask) -> Actor:
        """The actor, nothing of which is missing; raises ValueError where it cannot be read."""
        return Actor.from_toml(self._actors[named.actor][0], lambda mesh: self._meshes[mesh.sha256])

    def rig(self, named: TakeInfo | LimbTask) -> Rig:
        """The rig, which is not missing."""
        return self._rigs[named.rig]


def keep_latest(kept: OrderedDict[K, V], key: K, value: V, most: int) -> list[V]:
    """Add to a table that drops its oldest entries; returns the dropped values."""
    kept[key] = value
    kept.move_to_end(key)
    return [kept.popitem(last=False)[1] for _ in range(len(kept) - most)]
