"""A folder of board clips: its cameras and their numbered pictures.

<camera>.mp4, or <camera>/ with pictures    the board moved about, the same moments in all cameras
intrinsics/<camera>.mp4 or <camera>/        the board close before one camera alone, if recorded
origin/<camera>.mp4, .png or <camera>/      the board lying still where the world's origin shall be

Single pictures elsewhere, such as coverage.png, are no clips.
"""

import re
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from services.mocap.camera.camera import nfc
from services.mocap.errors import CalibrationError
from services.mocap.take.pictures import read_picture
from services.mocap.take.recordings import VIDEO_SUFFIXES
from services.mocap.take.video import VideoReader
from services.mocap.take.video_index import index_video
from services.mocap.types import Bytes

INTRINSICS, ORIGIN = "intrinsics", "origin"
_PICTURES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp")


@dataclass(frozen=True)
class Clip:
    """One camera's video, or its pictures."""

    camera: str
    path: Path
    """A video, a picture, or a folder of pictures."""

    def n_frames(self) -> int:
        """The number of pictures; raises TakeError if the clip cannot be read."""
        return index_video(self.path).n_frames if self.is_video else len(self._files())

    def size_px(self) -> tuple[int, int] | None:
        """Width and height of the first picture, None if there is none; raises TakeError."""
        if self.is_video:
            index = index_video(self.path)
            return index.width_px, index.height_px
        for file in self._files()[:1]:
            height, width = read_picture(file).shape[:2]
            return width, height
        return None

    @property
    def is_video(self) -> bool:
        """False for pictures."""
        return self.path.suffix.lower() in VIDEO_SUFFIXES

    def numbers(self) -> Sequence[int]:
        """The pictures' numbers: those at the ends of file names, if all have one, else their positions."""
        if self.is_video:
            return range(self.n_frames())
        files = self._files()
        ends = [re.search(r"[0-9]+$", file.stem) for file in files]
        numbers = [int(end[0]) for end in ends if end]
        return numbers if len(set(numbers)) == len(files) else range(len(files))

    def pictures(self, numbers: Collection[int]) -> Iterator[tuple[int, Bytes]]:
        """The pictures (H, W, 3) of these numbers, with them; raises TakeError if one cannot be read."""
        if self.is_video:
            with VideoReader(self.path) as reader:
                yield from ((frame, picture) for frame, picture in enumerate(reader) if frame in numbers)
            return
        for number, file in zip(self.numbers(), self._files(), strict=True):
            if number in numbers:
                yield number, read_picture(file)

    def samples(self, most: int) -> Iterator[tuple[int, Bytes]]:
        """At most so many of the pictures, evenly spread; see pictures."""
        return self.pictures(spread_numbers([self], most))

    def _files(self) -> list[Path]:
        if self.path.is_file():
            return [self.path]
        return sorted(file for file in self.path.iterdir() if file.suffix.lower() in _PICTURES)


def spread_numbers(clips: Sequence[Clip], most: int) -> frozenset[int]:
    """At most so many of the numbers of clips' pictures, evenly spread: the same moments in all clips.

    Numbers that two clips have, if there are any: one clip may be much longer than the others.
    """
    n_clips = Counter(number for clip in clips for number in clip.numbers())
    numbers = sorted(number for number, n in n_clips.items() if n > 1) or sorted(n_clips)
    return frozenset(numbers[:: max(1, -(-len(numbers) // most))])


def find_clips(folder: Path) -> list[Clip]:
    """The clips in a folder, sorted by camera; raises CalibrationError if one camera has two."""
    clips: dict[str, Clip] = {}
    suffixes = (*VIDEO_SUFFIXES, *(_PICTURES if folder.name == ORIGIN else ()))
    for path in sorted(folder.iterdir()) if folder.is_dir() else []:
        if path.name.startswith(".") or path.name in (INTRINSICS, ORIGIN):
            continue
        if path.is_dir():
            camera, is_clip = path.name, any(file.suffix.lower() in _PICTURES for file in path.iterdir())
        else:
            camera, is_clip = path.stem, path.suffix.lower() in suffixes
        camera = nfc(camera)
        if is_clip and camera in clips:
            raise CalibrationError(
                f"{path}: is a second clip of {camera} beside {clips[camera].path.name}: keep one of them"
            )
        if is_clip:
            clips[camera] = Clip(camera, path)
    return sorted(clips.values(), key=lambda clip: clip.camera)


def check_sizes(folder: Path) -> None:
    """Raise CalibrationError if a camera's clips in a folder and its sub-folders have different sizes."""
    first = {clip.camera: clip.size_px() for clip in find_clips(folder)}
    for other in (clip for kind in (INTRINSICS, ORIGIN) for clip in find_clips(folder / kind)):
        size, found = first.get(other.camera), other.size_px()
        if size is None or found is None or size == found:
            continue
        turned = ", and hold it the same way" if found == size[::-1] else ""
        raise CalibrationError(
            f"{other.path}: is {found[0]}x{found[1]} pixels, but the camera's other clip is "
            f"{size[0]}x{size[1]}: record all clips of a camera with the same settings{turned}"
        )
