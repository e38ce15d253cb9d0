"""The poses of one take as they come in, without a socket: what is there, and what is missing."""

import hashlib
from contextlib import suppress
from itertools import count, takewhile

from proto.messages import Blob, Pose, TakeEnd, TakeInfo
from services.mocap.body.actor import Actor, mesh_named_in
from services.mocap.body.body_mesh import OwnMesh


class Collection:
    """Gathers what is needed to write a take's results."""

    def __init__(self) -> None:
        self.info: TakeInfo | None = None
        self.poses: dict[int, Pose] = {}
        self._end: int | None = None
        self._is_empty = False
        self._blobs: dict[str, str] = {}
        self._meshes: dict[str, bytes] = {}

    def add(self, message: TakeInfo | Pose | TakeEnd | Blob) -> None:
        """Take in a message; repeated, foreign and damaged ones change nothing."""
        if isinstance(message, TakeInfo):
            self.info = self.info or message
        elif isinstance(message, Blob):
            self._add_blob(message)
        elif isinstance(message, Pose):
            self.poses.setdefault(message.frame, message)
        else:
            self._end, self._is_empty = message.end_frame, message.first_frame == message.end_frame

    def _add_blob(self, blob: Blob) -> None:
        """Keep content that is wanted and whole; what is not is asked for again."""
        content = blob.content.tobytes()
        if blob.hash not in self.missing_blobs() or hashlib.sha256(content).hexdigest() != blob.hash:
            return
        if blob.kind == "mesh":
            self._meshes[blob.hash] = content
        else:
            with suppress(UnicodeDecodeError):
                self._blobs[blob.hash] = content.decode()

    def blob(self, content_hash: str) -> str:
        """Content that has arrived."""
        return self._blobs[content_hash]

    def missing_blobs(self) -> list[str]:
        """Hashes of the content still needed."""
        if self.info is None:
            return []
        missing = [name for name in (self.info.actor, self.info.rig) if name not in self._blobs]
        mesh = None if self.info.actor in missing else mesh_named_in(self._blobs[self.info.actor])
        return missing if mesh is None or mesh in self._meshes else [*missing, mesh]

    def actor(self) -> Actor:
        """The actor of the take, whose content has arrived."""
        if self.info is None:
            raise ValueError("the take has not been announced")
        text = self._blobs[self.info.actor]
        return Actor.from_toml(text, lambda named: OwnMesh.from_bytes(self._meshes[named.sha256]))

    def missing_frames(self) -> tuple[int, int] | None:
        """The first gap in the frames, as a range; up to the latest pose or, once known, the take's end."""
        if self.info is None:
            return None
        end = self._end if self._end is not None else max(self.poses, default=0)
        lacking = [frame for frame in range(self.info.first_frame, end) if frame not in self.poses]
        if not lacking:
            return None
        gap_end = next((f for f in range(lacking[0], end) if f in self.poses), end)
        return lacking[0], gap_end

    def recorded(self) -> list[Pose]:
        """The poses from the first frame on up to the first that is missing."""
        first = self.info.first_frame if self.info else 0
        return [self.poses[f] for f in takewhile(self.poses.__contains__, count(first))]

    @property
    def complete(self) -> bool:
        """Whether the take is over and nothing is missing; its end may overtake its description."""
        if self._end is None:
            return False
        if self.info is None:
            return self._is_empty
        return self.missing_frames() is None and not self.missing_blobs()

    @property
    def end_frame(self) -> int:
        """One past the take's last frame; only when it is over."""
        if self._end is None:
            raise ValueError("the take is not over")
        return self._end
