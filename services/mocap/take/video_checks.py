"""What can be wrong with the videos of a take: sizes, lengths, frame rates, damage."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from services.mocap.camera.camera import Camera
from services.mocap.errors import TakeError
from services.mocap.take import layout
from services.mocap.take.pictures import check_png, check_size
from services.mocap.take.settings import TakeFile, TakeSettings
from services.mocap.take.video import VideoReader
from services.mocap.take.video_index import VideoIndex, index_video

_LARGEST_RATE_ERROR = 0.01
_ROUNDING_S = 0.001
"""Matroska rounds time stamps to milliseconds; a video's length is wrong by up to this."""
_HARMLESS_DRIFT, _LARGEST_DRIFT = 0.5, 2.0
"""Frames by which cameras of different rates may be apart at the end of a take: with more they are remarked,
and refused."""
_LARGEST_GAP = 1.5
"""In median frame intervals: with a larger gap, frame numbers no longer give the time."""
_QUICK_TO_DECODE_PX = 200 * 320 * 240
"""Videos of up to this many pixels, 200 frames of 320x240, are decoded completely, which takes over a second
for eight; longer ones only at their end."""
_FEW_S = 0.25
"""Cameras that are started and stopped together differ by no more; the longer videos are cut."""
_FEWEST_CUT = 2
_CONVERSION = "ffmpeg -i IN -vf fps={:g} OUT"


def rate_of(indices: Sequence[VideoIndex], settings: Path) -> float:
    """The frame rate of videos, where take.toml has none; raises TakeError if no video tells it."""
    index = next((index for index in indices if index.n_frames > 1), None)
    if index is None:
        why = "videos of one frame do not tell" if indices else "only videos know by themselves"
        raise TakeError(
            f"{settings}: fps: is missing: expected a positive number of frames per second, which {why}"
        )
    return round(_steady_rate(index), 3)


def _steady_rate(index: VideoIndex) -> float:
    """The frame rate of a video of two frames or more, without the gaps of lost frames.

    It is a mean, as some formats round time stamps to milliseconds.
    """
    gaps_s = np.diff(index.times_s)
    return 1 / float(gaps_s[gaps_s <= _LARGEST_GAP * np.median(gaps_s)].mean())


def check_video_size(index: VideoIndex, camera: Camera) -> None:
    """Raise TakeError if a video has another size than the camera, with what to do about it."""
    check_size(index.path, index.width_px, index.height_px, camera, is_turned=index.is_turned)


def check_video(index: VideoIndex, camera: Camera, settings: TakeSettings, said: TakeFile) -> None:
    """Raise TakeError if a video has another size than the camera, too few frames, gaps or another rate.

    said: take.toml as it is written.
    """
    check_video_size(index, camera)
    ahead = settings.offset(camera.name)
    frames = settings.frames + ahead
    if index.n_frames < frames:
        begin = f" from frame {ahead} on, the camera's offset" if ahead else ""
        claim = f"{layout.SETTINGS} says frames = {settings.frames}{begin}: lower that number"
        if said.frames is None:
            enough = f"state frames = {index.n_frames - ahead} in {layout.SETTINGS}"
            claim = f"there are silhouettes of {frames}: {enough}"
        raise TakeError(f"{index.path}: has {index.n_frames} frames, but {claim} or record the camera again")
    if frames < 2:
        return
    gaps_s = np.diff(index.times_s[:frames])
    if (gap := _gap_in(index, frames, settings.fps)) is not None:
        raise TakeError(gap)
    fps, error_s = 1 / gaps_s.mean(), gaps_s.sum() - (frames - 1) / settings.fps
    if abs(fps / settings.fps - 1) > _LARGEST_RATE_ERROR and abs(error_s) > _ROUNDING_S:
        if said.fps is None:
            raise TakeError(
                f"{index.path}: runs at {fps:.4g} frames per second, but the first camera's video at "
                f"{settings.fps:g}: convert one of them ({_CONVERSION.format(settings.fps)})"
            )
        raise TakeError(
            f"{index.path}: runs at {fps:.4g} frames per second, but {layout.SETTINGS} says fps = "
            f"{settings.fps:g}: correct that number or convert the video"
        )


def _gap_in(index: VideoIndex, frames: int, fps: float) -> str | None:
    """A sentence about the first gap between a video's first frames; None if it has none."""
    gaps_s = np.diff(index.times_s[:frames])
    late = np.flatnonzero(gaps_s > _LARGEST_GAP * np.median(gaps_s))
    if not late.size:
        return None
    return (
        f"{index.path}: lacks frames between its frames {late[0]} and {late[0] + 1}, which are "
        f"{gaps_s[late[0]]:.3f} s apart: convert it to a constant frame rate ({_CONVERSION.format(fps)})"
    )


def unsteady_remarks(indices: Sequence[VideoIndex]) -> list[str]:
    """A remark for each video that has gaps or another rate than the first, if frames of one number should
    show one moment."""
    long = [index for index in indices if index.n_frames > 1]
    rates = [_steady_rate(index) for index in long]
    gaps = [_gap_in(index, index.n_frames, rate) for index, rate in zip(long, rates, strict=True)]
    others = [
        f"{index.path}: runs at {rate:.4g} frames per second, but {long[0].path.name} at {rates[0]:.4g}: "
        f"convert one of them ({_CONVERSION.format(rates[0])})"
        for index, rate in zip(long, rates, strict=True)
        if abs(rate / rates[0] - 1) > _LARGEST_RATE_ERROR
    ]
    return [*(gap for gap in gaps if gap is not None), *others]


def drift_remark(indices: Mapping[str, VideoIndex], settings: TakeSettings, *, is_stated: bool) -> str | None:
    """A remark if videos, by camera, differ in rate so that they drift apart; raises TakeError if by far.

    is_stated: whether take.toml states the rate of all; then they may drift by any number of frames.
    """
    frames = settings.frames
    if frames < 2 or not indices:
        return None
    rates = {name: _fitted_rate(index, settings.offset(name), frames) for name, index in indices.items()}
    usual = min(rates, key=lambda name: abs(rates[name] - settings.fps))
    other = max(rates, key=lambda name: abs(rates[name] - rates[usual]))
    drift, rounding = (frames - 1) * abs(rates[other] / rates[usual] - 1), 2 * _ROUNDING_S * rates[usual]
    if drift <= _HARMLESS_DRIFT + rounding:
        return None
    sentence = (
        f"{indices[other].path}: runs at {rates[other]:.6g} frames per second, but "
        f"{indices[usual].path.name} at {rates[usual]:.6g}, so that they are {drift:.1f} frames apart after "
        f"{frames} frames: convert one of them ({_CONVERSION.format(rates[usual])})"
    )
    if drift > _LARGEST_DRIFT + rounding and not is_stated:
        raise TakeError(f"{sentence}, or state fps in {layout.SETTINGS} if they were recorded in step")
    return sentence


def _fitted_rate(index: VideoIndex, start: int, frames: int) -> float:
    """By a line through the times of all frames, which single unsteady or rounded times hardly turn."""
    return 1 / float(np.polyfit(np.arange(frames), index.times_s[start : start + frames], 1)[0])


def cut_remark(lengths: Mapping[Path, int], settings: TakeSettings, *, is_stated: bool) -> str | None:
    """A remark if recordings have different lengths in frames; raises TakeError if the difference is large.

    lengths: by video, or folder of silhouettes. is_stated: whether take.toml states how many frames are used;
    then recordings may be longer by any number.
    """
    ordered = sorted(lengths, key=lambda path: lengths[path])
    if settings.offsets or not ordered or lengths[ordered[0]] == lengths[ordered[-1]]:
        return None
    short, long = ordered[0], ordered[-1]
    lacking = f"{short}: has {lengths[short]} frames"
    limit = lengths[long] - max(_FEWEST_CUT, _FEW_S * settings.fps)
    if not is_stated and lengths[short] < limit:
        also = "".join(f", {path.name} {lengths[path]}" for path in ordered[1:] if lengths[path] < limit)
        raise TakeError(
            f"{lacking}{also}, but {long.name} has {lengths[long]}: cut all cameras to the same moments, run "
            "xormocap sync, or, if they begin at the same moment, use the frames that all have by "
            f"frames = {lengths[short]} in {layout.SETTINGS}"
        )
    return (
        f"{lacking}, but {long.name} has {lengths[long]}: the first {settings.frames} frames of each are "
        "used; if the cameras did not start together, run xormocap sync"
    )


def left_out_remarks(indices: Iterable[VideoIndex]) -> list[str]:
    """A remark for each video whose first pictures cannot be decoded, so that its frames begin later."""
    return [
        f"{index.path}: pictures at its start are left out ({index.n_left_out}), as they cannot be decoded "
        "without others that were cut away: run xormocap sync, unless that has found the offsets, or cut the "
        "recording again and code it anew (ffmpeg -ss START -i IN OUT)"
        for index in indices
        if index.n_left_out
    ]


def interlaced_remarks(indices: Iterable[VideoIndex]) -> list[str]:
    """A remark for each video whose pictures are marked as interlaced; some cameras mark whole ones so."""
    return [
        f"{index.path}: is marked as interlaced: if its pictures show two moments each, as combs at what "
        "moves fast, convert it (ffmpeg -i IN -vf bwdif=send_frame OUT)"
        for index in indices
        if index.is_interlaced
    ]


def check_plate(path: Path, camera: Camera, *, decoded: bool) -> None:
    """Raises TakeError for a clean plate of another size than the camera's, or a damaged one.

    decoded: whether a video is decoded to find that.
    """
    if path.suffix == ".png":
        check_png(path, camera)
        return
    index = index_video(path)
    check_video_size(index, camera)
    if decoded:
        check_decodes(index, index.n_frames)


def check_decodes(index: VideoIndex, frames: int) -> None:
    """Raises TakeError if a video is damaged: short ones are decoded up to `frames`, others at that end."""
    quick = frames * index.width_px * index.height_px <= _QUICK_TO_DECODE_PX
    start = 0 if quick else index.keyframe_before(frames - 1)[0]
    with VideoReader(index, start, frames) as reader:
        reader.check()
