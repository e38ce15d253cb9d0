"""The plan of a session, and its name: a run can continue another of the same plan."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from importlib.metadata import version

from proto.messages import PROTOCOL_VERSION
from services.mocap.body.actor import Actor
from services.mocap.camera.rig import Rig
from services.mocap.search.settings import SearchSettings
from services.mocap.take.folder import Take
from services.mocap.take.segmenter_name import files_of_segmenter, looks_at_videos
from services.mocap.types import Bytes, Floats, Mask


@dataclass(frozen=True)
class Plan:
    """The plan of a session."""

    take: Take
    frames: range
    settings: SearchSettings
    segmenter: str
    """The option --segmenter: a run continues only with the same one."""
    actor: Actor | None
    """None: the generic body with the take's height, or with the height that fits the first frame."""
    known_poses: Mapping[int, Floats] = field(default_factory=dict)
    """The poses (D,) that came with the actor, by frame; their frames are searched from there, too."""
    occluded: Mapping[str, Mask] = field(default_factory=dict)
    """By camera the pixels (h, w) in which the fit found the actor hidden; these are unsure."""
    colour_tables: Mapping[str, Bytes] = field(default_factory=dict)
    """By camera what the actor's colour classes look like there, as the fit learnt it."""

    @cached_property
    def rig(self) -> Rig:
        """Of the take's cameras."""
        return Rig.of(self.take.cameras)

    @cached_property
    def name(self) -> str:
        """The SHA-256 of everything that poses depend on; files count by their sizes and modification
        times."""
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
            "rig": self.rig.content_hash,
            "frames": [self.frames.start, self.frames.stop],
            "search": self.settings.model_dump(mode="json"),
            "segmenter": self.segmenter,
            "actor": self.actor.content_hash if self.actor else None,
            "known_poses": {frame: pose.tolist() for frame, pose in self.known_poses.items()},
            "occluded": _hashes(self.occluded),
            "colour_tables": _hashes(self.colour_tables),
        }
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _hashes(pictures: Mapping[str, Mask | Bytes]) -> dict[str, str]:
    return {name: hashlib.sha256(picture.tobytes()).hexdigest() for name, picture in pictures.items()}
