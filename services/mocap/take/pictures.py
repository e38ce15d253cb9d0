"""Reads PNG pictures (silhouettes and clean plates), and checks a file completely without decoding it."""

import struct
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np

from services.mocap.camera.camera import Camera
from services.mocap.camera.undistort import resized_trimap
from services.mocap.errors import TakeError
from services.mocap.take.layout import CALIBRATION, silhouette_path
from services.mocap.types import ACTOR, BACKGROUND, UNSURE, Bytes, Mask, Trimap

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_THRESHOLD = 127
_AGAIN = "export it again"


def check_png(path: Path, camera: Camera) -> None:
    """Checks a PNG's size and all its checksums, a hundred times faster than decoding.

    Raises TakeError if the file is missing, empty, not a PNG, damaged, cut off or of another size.
    """
    data = _bytes(path)
    if not data.startswith(_SIGNATURE):
        raise TakeError(
            f"{path}: is not a PNG file: expected a PNG of {camera.width_px}x{camera.height_px} pixels"
        )
    if not _chunks_are_whole(data):
        raise TakeError(f"{path}: is damaged or cut off: {_AGAIN}")
    width_px, height_px = struct.unpack(">II", data[16:24])
    check_size(path, width_px, height_px, camera)


def check_size(path: Path, width_px: int, height_px: int, camera: Camera, *, is_turned: bool = False) -> None:
    """Raises TakeError when the picture's size is not the calibrated one.

    is_turned: whether a rotation tag in the file turned the picture by a quarter turn.
    """
    if (width_px, height_px) == camera.size_px:
        return
    tag = ", turned by a quarter turn as its rotation tag says" if is_turned else ""
    raise TakeError(
        f"{path}: is {width_px}x{height_px} pixels{tag}, but [{camera.name}] size in {CALIBRATION} is "
        f"{camera.width_px}x{camera.height_px}: {_size_remedy(width_px, height_px, camera, is_turned)}"
    )


def _size_remedy(width_px: int, height_px: int, camera: Camera, is_turned: bool) -> str:
    """What to do about pictures of another size than the calibrated one."""
    size_px, is_across = camera.size_px, (height_px, width_px) == camera.size_px
    if is_across and is_turned:
        return (
            "remove the tag (ffmpeg -display_rotation 0 -i IN -c copy OUT), or calibrate with clips that "
            "have the same tag"
        )
    if is_across:
        return (
            "turn the pictures by a quarter turn (ffmpeg -i IN -vf transpose=1 OUT; transpose=2 if they are "
            "then upside down), or calibrate with pictures as these"
        )
    if width_px * size_px[1] == height_px * size_px[0]:
        return (
            f"scale the pictures (ffmpeg -i IN -vf scale={size_px[0]}:{size_px[1]} OUT), or calibrate with "
            "pictures of this size"
        )
    return "record the take with the settings of the calibration, or calibrate with pictures of this size"


def read_trimap(path: Path, unsure: Sequence[int] = (UNSURE, UNSURE)) -> Trimap:
    """(H, W): unsure where the grey is in the range `unsure`, else actor where it is above 127.

    unsure: the lowest and the highest unsure grey, or empty. The opacity of a picture that is transparent
    somewhere takes the place of its grey. Raises TakeError if the file cannot be decoded.
    """
    grey = _matte(path)
    meanings: Trimap = np.where(np.arange(256) > _THRESHOLD, ACTOR, BACKGROUND).astype(np.uint8)
    if unsure:
        meanings[unsure[0] : unsure[1] + 1] = UNSURE
    return np.asarray(cv2.LUT(grey, meanings), np.uint8)


def check_greys(paths: Sequence[Path], unsure: Sequence[int]) -> None:
    """Raise TakeError if some of a camera's silhouettes seem to use other greys: no pixel of them is actor or
    unsure, but some are not black.

    unsure: the lowest and the highest unsure grey, or empty.
    """
    if any(read_trimap(path, unsure).any() for path in paths):
        return
    brightest = {path: int(_matte(path).max()) for path in paths}
    path = max(brightest, key=lambda path: brightest[path])
    if brightest[path] > 0:
        raise TakeError(
            f"{path}: its brightest grey is {brightest[path]}: expected 0 outside the actor, 255 inside"
        )


def read_silhouette(path: Path) -> Mask:
    """(H, W), true where a file's grey is above 127, and unsure greys are not; raises as read_trimap does."""
    return np.asarray(read_trimap(path) == ACTOR)


def read_picture(path: Path) -> Bytes:
    """BGR (H, W, 3); raises TakeError when it cannot be decoded."""
    return _decoded(path, cv2.IMREAD_COLOR)


def read_trimaps(
    folder: Path,
    start: int,
    stop: int,
    unsure: Sequence[int] = (UNSURE, UNSURE),
    camera: Camera | None = None,
) -> Iterator[Trimap]:
    """One camera's trimaps (H, W) from frame `start` up to but not including `stop`; raises as read_trimap
    does.

    unsure: the lowest and the highest unsure grey, or empty. camera: they are reduced to its size.
    """
    for frame in range(start, stop):
        trimap = read_trimap(silhouette_path(folder, frame), unsure)
        yield trimap if camera is None else resized_trimap(trimap, camera)


def _bytes(path: Path) -> bytes:
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise TakeError(f"{path}: is missing: expected a PNG picture") from None
    except OSError as problem:
        raise TakeError(f"{path}: cannot be read ({problem.strerror}): expected a PNG picture") from None
    if not data:
        raise TakeError(f"{path}: is empty (0 bytes): {_AGAIN}")
    return data


def _matte(path: Path) -> Bytes:
    """(H, W) the greys of a picture; its opacity, if it is transparent somewhere."""
    picture = _decoded(path, cv2.IMREAD_UNCHANGED)
    if picture.ndim == 3 and picture.shape[2] == 4 and picture[..., 3].min() < 255:
        return np.ascontiguousarray(picture[..., 3])
    return picture if picture.ndim == 2 else _decoded(path, cv2.IMREAD_GRAYSCALE)


def _decoded(path: Path, flag: int) -> Bytes:
    try:
        picture = cv2.imdecode(np.frombuffer(_bytes(path), np.uint8), flag)
    except cv2.error:
        picture = None
    if picture is None:
        raise TakeError(f"{path}: cannot be decoded as a picture: {_AGAIN}")
    return np.asarray(picture // 256 if picture.dtype == np.uint16 else picture, np.uint8)


def _chunks_are_whole(data: bytes) -> bool:
    """Whether the file is a sequence of chunks with correct checksums, from IHDR to IEND."""
    at, kind = len(_SIGNATURE), b""
    while kind != b"IEND":
        if at + 12 > len(data):
            return False
        (length,) = struct.unpack(">I", data[at : at + 4])
        end = at + 8 + length
        if (not kind and data[at + 4 : at + 8] != b"IHDR") or end + 4 > len(data):
            return False
        kind = data[at + 4 : at + 8]
        if zlib.crc32(data[at + 4 : end]) != struct.unpack(">I", data[end : end + 4])[0]:
            return False
        at = end + 4
    return True
