"""Pictures spread over a camera's video, by which what does not move is told from what does."""

import numpy as np

from services.mocap.camera.camera import Camera
from services.mocap.take import layout
from services.mocap.take.folder import Take
from services.mocap.take.video import VideoIndex, VideoReader, index_video
from services.mocap.types import Bytes


def spread_pictures(take: Take, camera: Camera, most: int) -> Bytes:
    """Up to so many raw pictures (N, H, W, 3) of a camera, from the first frame to the last."""
    index = index_video(layout.video_path(take.folder, camera.name))
    first = take.settings.offset(camera.name)
    return _spread_over(index, first, first + take.settings.frames, most)


def spread_plate(take: Take, camera: Camera, most: int) -> Bytes:
    """Up to so many pictures (N, H, W, 3) of a camera's recorded clean plate, likewise."""
    path = layout.background_video_path(take.folder, camera.name)
    if not path.exists():
        return np.array(list(take.background(camera)))
    index = index_video(path)
    return _spread_over(index, 0, index.n_frames, most)


def _spread_over(index: VideoIndex, first: int, end: int, most: int) -> Bytes:
    """Long videos are read at their keyframes only, which need no other frame to be decoded."""
    keys = [key for key, _ in index.keyframes if first <= key < end]
    if len(keys) >= most:
        pictures = []
        for key in (keys[i] for i in _spread(len(keys), most)):
            with VideoReader(index, key, key + 1) as video:
                pictures += list(video)
        return np.array(pictures)
    wanted = set(_spread(end - first, most))
    with VideoReader(index, first, end) as video:
        return np.array([picture for frame, picture in enumerate(video) if frame in wanted])


def _spread(count: int, most: int) -> list[int]:
    """Up to `most` of the numbers 0 to count - 1, evenly, the first and the last among them."""
    return [int(i) for i in np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int))]
