"""Content that a take names by its hash, as it comes in: actor, rig, own mesh; without a socket."""

import hashlib
import tomllib

import pydantic

from proto.messages import Blob, TakeInfo
from services.mocap.body.actor import Actor, mesh_named_in
from services.mocap.body.body_mesh import MeshContentError, OwnMesh
from services.mocap.camera.rig import Rig


class BlobStore:
    """What one take needs to be drawn."""

    def __init__(self, info: TakeInfo) -> None:
        self._info = info
        self._kept: dict[str, bytes] = {}
        self.is_unusable = False
        """Whether something came that this version cannot read; there is no use in asking for it again."""

    def add(self, blob: Blob) -> None:
        """Keep content that is wanted and whole; what is not is asked for again."""
        content = blob.content.tobytes()
        if blob.hash in self.missing() and hashlib.sha256(content).hexdigest() == blob.hash:
            self._kept[blob.hash] = content

    def missing(self) -> list[str]:
        """Hashes of what is still needed."""
        missing = [name for name in (self._info.actor, self._info.rig) if name not in self._kept]
        if self._info.actor in missing or self.is_unusable:
            return missing
        try:
            mesh = mesh_named_in(self._kept[self._info.actor].decode())
        except (UnicodeDecodeError, tomllib.TOMLDecodeError, pydantic.ValidationError):
            self.is_unusable = True
            return missing
        return missing if mesh is None or mesh in self._kept else [*missing, mesh]

    def read(self) -> tuple[Actor, Rig] | None:
        """The actor and the rig, once nothing is missing; None where they cannot be read."""
        if self.is_unusable:
            return None
        try:
            text = self._kept[self._info.actor].decode()
            actor = Actor.from_toml(text, lambda named: OwnMesh.from_bytes(self._kept[named.sha256]))
            return actor, Rig.from_json(self._kept[self._info.rig].decode())
        except (UnicodeDecodeError, tomllib.TOMLDecodeError, pydantic.ValidationError, MeshContentError):
            self.is_unusable = True
            return None
