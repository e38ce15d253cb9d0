"""Records the empty stage from live cameras at the start, if there are no pictures of it."""

import logging
import time
from collections.abc import Sequence
from pathlib import Path

from services.health import beat
from services.mocap.errors import UserError
from services.mocap.take.layout import background_video_path
from services.mocap.take.live import LiveTake
from services.mocap.take.video import VideoReader
from services.mocap.take.writer import video_writer
from services.mocap.types import Bytes
from services.process import StopRequest
from services.segmentation.live.group import Feed
from services.segmentation.live.sources import StreamSource

_PICTURES = 30
"""Per camera, at most; more hardly improve the background."""
_OPENING_S = 20.0
"""How long sources may take to deliver their first picture."""
_FEWEST = 3

log = logging.getLogger(__name__)


def has_empty_stage(take: LiveTake, cameras: Sequence[int], folder: Path) -> bool:
    """Whether a folder has clean plates of all these cameras: now the actor may be on the stage."""
    return all(background_video_path(folder, take.calibrated[c].name).exists() for c in cameras)


def see_empty_stage(take: LiveTake, cameras: Sequence[int], folder: Path, stop: StopRequest) -> None:
    """Store the cameras' present pictures as clean plates in a folder, unless a stop is requested.

    For a file, its first seconds are used. Raises UserError if a camera delivers no pictures.
    """
    log.info("keep the stage empty for the next %.1f s", take.live.empty_stage_s)
    seen: dict[int, list[Bytes]] = {c: _of_file(take, c) if take.sources[c].is_file else [] for c in cameras}
    feeds = {c: _feed(take, c, seen[c]) for c in cameras if not take.sources[c].is_file}
    try:
        _wait(take, feeds, seen, stop)
    finally:
        for feed in feeds.values():
            feed.stop()
        for feed in feeds.values():
            feed.join()
    if stop:
        return
    for c, pictures in seen.items():
        camera = take.calibrated[c]
        if len(pictures) < _FEWEST:
            raise UserError(
                f"{camera.name}: delivered no pictures of the empty stage: is its source available?"
            )
        path = background_video_path(folder, camera.name)
        path.parent.mkdir(parents=True, exist_ok=True)
        with video_writer(path, *camera.size_px, take.live.fps) as writer:
            for picture in pictures:
                writer.write(picture)
    log.info("recorded the empty stage with %d cameras", len(seen))


def _of_file(take: LiveTake, camera: int) -> list[Bytes]:
    """Pictures of a file's first seconds."""
    wanted = max(_FEWEST, round(take.live.empty_stage_s * take.live.fps))
    with VideoReader(Path(str(take.sources[camera].source))) as reader:
        pictures = [picture for _, picture in zip(range(wanted), reader, strict=False)]
    return pictures[:: -(-len(pictures) // _PICTURES)]


def _feed(take: LiveTake, c: int, pictures: list[Bytes]) -> Feed:
    apart_s, last_s = take.live.empty_stage_s / _PICTURES, -1.0

    def keep(image: Bytes, taken_s: float) -> None:
        nonlocal last_s
        if taken_s - last_s >= apart_s and len(pictures) < _PICTURES:
            last_s = taken_s
            pictures.append(image)

    camera = take.calibrated[c]
    return Feed(camera, lambda _: StreamSource(take.sources[c], camera, take.live.fps), keep)


def _wait(take: LiveTake, feeds: dict[int, Feed], seen: dict[int, list[Bytes]], stop: StopRequest) -> None:
    """Wait until all streams have started, and then for the time of the empty stage."""
    deadline_s = time.monotonic() + _OPENING_S
    while not stop and time.monotonic() < deadline_s and not all(seen[c] for c in feeds):
        beat()
        time.sleep(0.05)
    end_s = time.monotonic() + (take.live.empty_stage_s if feeds else 0.0)
    while not stop and time.monotonic() < end_s:
        beat()
        time.sleep(0.05)
    for feed in feeds.values():
        if feed.problem is not None:
            raise feed.problem
