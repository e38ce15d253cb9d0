"""Which file of a folder belongs to which camera, by the names that people and tools give to files."""

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from functools import reduce
from operator import and_
from pathlib import Path

from services.mocap.camera.camera import nfc
from services.mocap.errors import TakeError, nearest
from services.mocap.take import layout
from services.mocap.take.settings import TakeFile, misplaced

VIDEO_SUFFIXES = (
    ".mp4", ".mov", ".avi", ".mkv", ".m4v", ".mpg", ".mpeg", ".mts", ".m2ts", ".ts", ".webm", ".wmv",
    ".mxf", ".flv", ".3gp",
)  # fmt: skip
_WORDS = (r"[^\W\d_]+|\d+", r"[^\W\d_]+\d+")
"""Words and numbers; and words with a number, which tell `walk1_cam1` from `walk1_cam2`."""


def files_of(folder: Path, suffixes: tuple[str, ...] = VIDEO_SUFFIXES) -> list[Path]:
    """The visible files in a folder with one of some suffixes, in order; none if there is no folder.

    Raises TakeError for a folder that cannot be read.
    """
    if not folder.is_dir():
        return []
    try:
        visible = [path for path in sorted(folder.iterdir()) if not path.name.startswith(".")]
    except OSError as problem:
        raise TakeError(f"{folder}: cannot be read ({problem.strerror}): change its permissions") from None
    return [path for path in visible if path.suffix.lower() in suffixes and path.is_file()]


def find_videos(folder: Path, cameras: Sequence[str], stated: Mapping[str, str]) -> dict[str, Path]:
    """The videos of a take folder by camera: those stated in take.toml, the others by their names.

    stated: paths from the take folder. Raises TakeError if one is missing or of no camera.
    """
    check_names(folder, "videos", stated, cameras)
    found = {camera: layout.as_spelt(folder / name) for camera, name in stated.items()}
    for camera, path in found.items():
        if not path.is_file():
            raise TakeError(
                f"{folder / layout.SETTINGS}: videos: {camera}: {path} is missing: expected a path from "
                f"{folder} to a video"
            )
    left = [camera for camera in cameras if camera not in found]
    return found | match_by_name(left, unused(files_of(folder / layout.VIDEOS), found))


def unused(files: Iterable[Path], found: Mapping[str, Path]) -> list[Path]:
    """The files that are not among those found."""
    used = {path.resolve() for path in found.values()}
    return [path for path in files if path.resolve() not in used]


def unused_remarks(files: Iterable[Path], found: Mapping[str, Path]) -> list[str]:
    """A sentence for each file that is not among those found for the cameras."""
    names = {nfc(name): camera for camera, used in found.items() for name in (camera, used.stem)}

    def said(path: Path) -> str:
        camera = names.get(nfc(path.stem))
        if camera is None:
            return f"{path}: belongs to no camera of {layout.CALIBRATION} and is not used"
        used = found[camera].name
        return f"{path}: is a second file of {camera} beside {used}, which is used: keep one of them"

    return list(map(said, unused(files, found)))


def check_names(folder: Path, table: str, stated: Iterable[str], cameras: Sequence[str]) -> None:
    """Raise TakeError if a table of take.toml names a camera that is not calibrated."""
    path = folder / layout.SETTINGS
    for camera in stated:
        if camera in cameras:
            continue
        if camera in TakeFile.model_fields:
            raise misplaced(path, table, camera)
        raise TakeError(
            f"{path}: {table}: {camera}: is no camera of {layout.CALIBRATION}: {nearest(camera, cameras)}"
        )


def match_by_name(cameras: Sequence[str], files: Sequence[Path]) -> dict[str, Path]:
    """The files of cameras: those named as a camera is, then those that can only be meant for one camera.

    Words and numbers that all names of one kind share (`int_cam01_img`, `take3-cam01`) are ignored, as often
    as all have them (one 2 of `cam2_take2` beside `cam1_take2`), and so are case and leading zeros. A file is
    matched if its remaining words hold those of just one camera, or the other way round, and no other file
    is. The result is in the cameras' order.
    """
    by_name = {nfc(path.stem): path for path in reversed(files)}
    exact = {camera: by_name[nfc(camera)] for camera in cameras if nfc(camera) in by_name}
    other_cameras = [camera for camera in cameras if camera not in exact]
    other_files = [path for path in files if path not in exact.values()]
    stems = [path.stem for path in other_files]
    fits: set[tuple[str, Path]] = set()
    for pattern in _WORDS:
        of_files = list(zip(other_files, _own_words(stems, pattern), strict=True))
        for camera, words in zip(other_cameras, _own_words(other_cameras, pattern), strict=True):
            fits |= {
                (camera, path) for path, own in of_files if words and own and (words <= own or own <= words)
            }
    by_words = {
        camera: path
        for camera, path in fits
        if sum(camera == c for c, _ in fits) == 1 and sum(path == p for _, p in fits) == 1
    }
    found = exact | by_words
    return {camera: found[camera] for camera in cameras if camera in found}


def _own_words(names: Iterable[str], pattern: str) -> list[Counter[str]]:
    """How often each name has each word, beyond how often all names have it; as it is, of a single name."""
    spelt_alike = (nfc(name).lower() for name in names)
    plain = [re.sub(r"(?<!\d)0+(?=\d)", "", name) for name in spelt_alike]  # without leading zeros
    each = [Counter(re.findall(pattern, name)) for name in plain]
    shared = reduce(and_, each) if len(each) > 1 else Counter[str]()
    return [words - shared for words in each]
