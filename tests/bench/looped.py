"""A take that goes on for longer than it was recorded: its videos over and over, copied as they are."""

import re
import shutil
from pathlib import Path

import av

from services.mocap.errors import UserError
from services.mocap.take import layout
from services.mocap.take.folder import Take, open_take
from services.mocap.take.video import opened_video, video_stream


def looped(take: Take, n_frames: int, folder: Path) -> Take:
    """A take of at least so many frames in a new folder; raises UserError for one without videos."""
    if take.source != "videos":
        raise UserError(f"{take.folder}: has no videos: expected a take with pictures to show")
    shutil.copytree(take.folder, folder, ignore=shutil.ignore_patterns("videos"))
    times = -(-n_frames // take.settings.frames)
    for camera in take.cameras:
        path = layout.video_path(folder, camera.name)
        path.parent.mkdir(exist_ok=True)
        _repeat(layout.video_path(take.folder, camera.name), path, times)
    settings = folder / layout.SETTINGS
    frames = f"frames = {times * take.settings.frames}"
    settings.write_text(re.sub(r"(?m)^frames\s*=.*$", frames, settings.read_text(encoding="utf-8")))
    return open_take(folder)


def _repeat(source: Path, copy: Path, times: int) -> None:
    """Write a video's packets so many times, one after the other."""
    with opened_video(source) as videos, av.open(str(copy), "w") as written:
        stream = video_stream(videos, source)
        out = written.add_stream_from_template(stream)
        span = stream.duration or 0
        for n in range(times):
            videos.seek(0, stream=stream)
            for packet in videos.demux(stream):
                if packet.size and packet.pts is not None and packet.dts is not None:
                    packet.pts, packet.dts = packet.pts + n * span, packet.dts + n * span
                    packet.stream = out
                    written.mux(packet)
