"""What a session is to do, and the name of that: runs of one plan can go on from each other."""

import hashlib
import json
from dataclasses import dataclass
from importlib.metadata import version

from proto.messages import PROTOCOL_VERSION
from services.mocap.body.actor import Actor
from services.mocap.camera.rig import Rig
from services.mocap.search.settings import SearchSettings
from services.mocap.take.folder import Take
from services.mocap.take.segmenter_name import files_of_segmenter, looks_at_videos
from services.mocap.types import Floats


@dataclass(frozen=True)
class Plan:
    """What a session is to do."""

    take: Take
    frames: range
    settings: SearchSettings
    segmenter: str
    """What makes the silhouettes, as --segmenter says it: a run goes on only with the same."""
    actor: Actor | None
    """None: the generic body in the height that the take gives, or else the one that fits the first frame."""
    fitted_pose: Floats | None = None
    """(D,) of the first frame, where it was found along with the actor."""

    @property
    def name(self) -> str:
        """The SHA-256 of what poses depend on; files count by their sizes and times of writing."""
        from_videos = looks_at_videos(self.segmenter, self.take.source == "silhouettes")
        files = [*self.take.inputs(from_videos), *files_of_segmenter(self.segmenter)]
        inputs = {}
        for path in files:
            inside = path.is_relative_to(self.take.folder)
            known_as = path.relative_to(self.take.folder) if inside else path.absolute()
            inputs[known_as.as_posix()] = (path.stat().st_size, path.stat().st_mtime_ns)
        content = {
            "versions": [version("xormocap"), PROTOCOL_VERSION],
            "take": self.take.settings.model_dump(mode="json"),
            "inputs": inputs,
            "rig": Rig.of(self.take.cameras).content_hash,
            "frames": [self.frames.start, self.frames.stop],
            "search": self.settings.to_wire(),
            "segmenter": self.segmenter,
            "actor": self.actor.content_hash if self.actor else None,
            "fitted_pose": None if self.fitted_pose is None else self.fitted_pose.tolist(),
        }
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
