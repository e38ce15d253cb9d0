import errno
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TypeAlias
from unittest.mock import Mock

import av
import numpy as np
import pytest

from services.mocap.errors import TakeError
from services.mocap.take.folder import open_take
from services.mocap.take.recordings import files_of
from services.mocap.take.video_checks import unsteady_remarks
from services.mocap.take.video_index import index_video
from services.mocap.take.writer import video_writer

SmallTake: TypeAlias = Callable[..., Path]
Refusal: TypeAlias = Callable[[Path], str]


def test_what_may_not_be_read_is_said(small_take: SmallTake, monkeypatch: pytest.MonkeyPatch) -> None:
    """Not every user is root."""
    folder = small_take()
    denied = PermissionError(errno.EACCES, "Permission denied")
    with monkeypatch.context() as patch:
        patch.setattr(Path, "iterdir", Mock(side_effect=denied))
        with pytest.raises(TakeError, match=r"videos: cannot be read \(Permission denied\): change its"):
            files_of(folder / "videos")
    monkeypatch.setattr(av, "open", Mock(side_effect=denied))
    with pytest.raises(TakeError, match=r"cam01\.mp4: cannot be read \(Permission denied\): change its"):
        index_video(folder / "videos" / "cam01.mp4")


def test_a_missing_video_names_the_camera(small_take: SmallTake, refusal: Refusal) -> None:
    folder = small_take()
    (folder / "videos/cam02.mp4").unlink()
    assert refusal(folder) == (
        "videos/cam02.mp4: is missing: expected the video of [cam02] in calibration.toml, "
        "or silhouettes in silhouettes/cam02; if it did not record, leave it out of calibration.toml"
    )


@pytest.mark.parametrize("clean_plate", ["video", "picture"])
def test_a_missing_clean_plate_names_the_camera(
    small_take: SmallTake, refusal: Refusal, clean_plate: str
) -> None:
    folder = small_take(clean_plate=clean_plate)
    (folder / "background" / ("cam02.mp4" if clean_plate == "video" else "cam02.png")).unlink()
    assert refusal(folder) == (
        "background/cam02.mp4: is missing: expected the clean plate of cam02 (the empty stage), as this "
        "video or as cam02.png, or no folder background at all"
    )


def test_without_any_clean_plate_the_take_itself_has_to_do(small_take: SmallTake) -> None:
    folder = small_take()
    shutil.rmtree(folder / "background")
    take = open_take(folder)
    assert take.source == "videos"
    assert not any(take.has_background(camera) for camera in take.cameras)


def rewrite_video(path: Path, n_frames: int, fps: float = 10.0, size_px: tuple[int, int] = (64, 48)) -> None:
    with video_writer(path, *size_px, fps) as writer:
        for _ in range(n_frames):
            writer.write(np.zeros((*size_px[::-1], 3), np.uint8))


def leave_to_videos(folder: Path, line: str) -> None:
    text = (folder / "take.toml").read_text()
    assert f"{line}\n" in text
    (folder / "take.toml").write_text(text.replace(f"{line}\n", ""))


def test_an_offset_beyond_the_end(small_take: SmallTake, refusal: Refusal) -> None:
    folder = small_take()
    leave_to_videos(folder, "frames = 4")
    settings = folder / "take.toml"
    settings.write_text(settings.read_text() + "[offsets]\ncam02 = 4\n")
    assert refusal(folder) == (
        "take.toml: offsets: cam02: is 4, but the camera has 4 frames: expected less than that"
    )


def test_an_offset_beyond_the_end_of_the_video_beside_silhouettes(
    small_take: SmallTake, refusal: Refusal
) -> None:
    folder = small_take(source="silhouettes")
    leave_to_videos(folder, "frames = 4")
    rewrite_video(folder / "videos/cam01.mp4", 2)
    settings = folder / "take.toml"
    settings.write_text(settings.read_text() + "[offsets]\ncam01 = 3\n")
    assert refusal(folder) == (
        "take.toml: offsets: cam01: is 3, but the camera has 2 frames: expected less than that"
    )


def test_a_video_that_is_shorter_than_the_silhouettes(small_take: SmallTake, refusal: Refusal) -> None:
    folder = small_take(source="silhouettes")
    leave_to_videos(folder, "frames = 4")
    rewrite_video(folder / "videos/cam01.mp4", 3)
    assert refusal(folder) == (
        "videos/cam01.mp4: has 3 frames, but there are silhouettes of 4: state frames = 3 in take.toml or "
        "record the camera again"
    )


def test_clips_that_do_not_show_one_moment_in_each_frame(small_take: SmallTake) -> None:
    folder = small_take(n_cameras=4)
    rewrite_video(folder / "videos/cam02.mp4", 4, fps=12.0)
    indices = [index_video(folder / f"videos/cam0{c}.mp4") for c in (1, 2, 3, 4)]
    indices[3] = replace(indices[3], times_s=np.round(indices[3].times_s / 2.997, 3))  # as Matroska does
    indices[3] = replace(indices[3], times_s=indices[3].times_s * 2.997)
    indices[2] = replace(indices[2], times_s=indices[2].times_s + np.array([0.0, 0.0, 0.1, 0.1]))
    gap, rate = unsteady_remarks(indices)
    assert gap == (
        f"{folder}/videos/cam03.mp4: lacks frames between its frames 1 and 2, which are 0.200 s apart: "
        "convert it to a constant frame rate (ffmpeg -i IN -vf fps=10 OUT)"
    )
    assert rate == (
        f"{folder}/videos/cam02.mp4: runs at 12 frames per second, but cam01.mp4 at 10: convert one of them "
        "(ffmpeg -i IN -vf fps=10 OUT)"
    )


def test_videos_of_different_lengths(small_take: SmallTake, refusal: Refusal) -> None:
    folder = small_take(n_cameras=4)
    leave_to_videos(folder, "frames = 4")
    for camera, frames in ("cam01", 9), ("cam02", 9), ("cam03", 5):
        rewrite_video(folder / f"videos/{camera}.mp4", frames)
    assert refusal(folder) == (
        "videos/cam04.mp4: has 4 frames, cam03.mp4 5, but cam02.mp4 has 9: cut all cameras to the same "
        "moments, run xormocap sync, or, if they begin at the same moment, use the frames that all have by "
        "frames = 4 in take.toml"
    )
    assert open_take(folder, in_step=False).settings.frames == 4


@pytest.mark.parametrize(("is_stated", "frames"), [(False, 6), (True, 6), (True, 40)])
def test_videos_that_are_cut_are_remarked(small_take: SmallTake, is_stated: bool, frames: int) -> None:
    """As of cameras that were stopped one after the other, or as take.toml wants it."""
    folder = small_take()
    if not is_stated:
        leave_to_videos(folder, "frames = 4")
    rewrite_video(folder / "videos/cam02.mp4", frames)
    take = open_take(folder)
    assert take.settings.frames == 4
    assert take.remarks == (
        f"{folder}/videos/cam01.mp4: has 4 frames, but cam02.mp4 has {frames}: the first 4 frames of each "
        "are used; if the cameras did not start together, run xormocap sync",
    )
    assert [len(list(take.video(camera))) for camera in take.cameras] == [4, 4]


def test_an_interlaced_video_is_remarked(small_take: SmallTake) -> None:
    folder = small_take()
    path = folder / "videos/cam02.mp4"
    path.unlink()
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=10, options={"x264-params": "interlaced=1"})
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for _ in range(4):
            picture = np.zeros((48, 64, 3), np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="bgr24")))
        container.mux(stream.encode(None))
    assert open_take(folder).remarks == (
        f"{path}: is marked as interlaced: if its pictures show two moments each, as combs at what "
        "moves fast, convert it (ffmpeg -i IN -vf bwdif=send_frame OUT)",
    )


def test_pictures_that_a_cut_made_undecodable_are_remarked(small_take: SmallTake) -> None:
    """A cut before the second keyframe leaves pictures that need the first one."""
    folder = small_take(frames=8)
    path = folder / "videos/cam02.wmv"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("wmv2", rate=10)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        stream.codec_context.gop_size = 12
        pictures = [np.full((48, 64, 3), 200 * (n >= 12), np.uint8) for n in range(20)]
        frames = [av.VideoFrame.from_ndarray(picture, format="bgr24") for picture in pictures]
        packets = [packet for frame in (*frames, None) for packet in stream.encode(frame)]
        container.mux(packets[9:])
    (folder / "videos/cam02.mp4").unlink()
    take = open_take(folder)
    assert next(iter(take.video(take.cameras[1]))).min() > 150
    assert take.remarks == (
        f"{path}: pictures at its start are left out (3), as they cannot be decoded without others that were "
        "cut away: run xormocap sync, unless that has found the offsets, or cut the recording again and code "
        "it anew (ffmpeg -ss START -i IN OUT)",
    )


def test_a_video_shorter_than_the_take(small_take: SmallTake, refusal: Refusal) -> None:
    folder = small_take()
    rewrite_video(folder / "videos/cam02.mp4", 3)
    assert refusal(folder) == (
        "videos/cam02.mp4: has 3 frames, but take.toml says frames = 4: lower that number or record the "
        "camera again"
    )


@pytest.mark.parametrize("fps", [10.2, 20.0])
def test_a_video_of_another_rate(small_take: SmallTake, refusal: Refusal, fps: float) -> None:
    folder = small_take()
    rewrite_video(folder / "videos/cam02.mp4", 4, fps)
    assert refusal(folder) == (
        f"videos/cam02.mp4: runs at {fps:g} frames per second, but take.toml says fps = 10: correct that "
        "number or convert the video"
    )


def test_a_video_of_almost_the_same_rate_is_taken(small_take: SmallTake) -> None:
    folder = small_take()
    rewrite_video(folder / "videos/cam02.mp4", 4, 10.05)
    open_take(folder)


@pytest.mark.parametrize("frames", [50, 100, 300])
def test_videos_of_almost_the_same_rate_must_not_drift_apart(
    small_take: SmallTake, refusal: Refusal, frames: int
) -> None:
    folder = small_take(frames=frames)
    rewrite_video(folder / "videos/cam02.mp4", frames, 10.08)
    sentence = (
        "videos/cam02.mp4: runs at 10.08 frames per second, but cam01.mp4 at 10, so that they are "
        f"{0.008 * (frames - 1):.1f} frames apart after {frames} frames: convert one of them "
        "(ffmpeg -i IN -vf fps=10 OUT)"
    )
    assert open_take(folder).remarks == (() if frames == 50 else (f"{folder}/{sentence}",))
    leave_to_videos(folder, "fps = 10.0")
    if frames == 300:
        in_step = "or state fps in take.toml if they were recorded in step"
        assert refusal(folder) == f"{sentence}, {in_step}"


@pytest.mark.parametrize(("fps", "frames"), [(25.0, 300), (29.97, 300), (30.0, 2), (60.0, 3), (240.0, 300)])
@pytest.mark.parametrize("is_stated", [True, False])
def test_rounded_time_stamps_are_no_other_rate(
    small_take: SmallTake, fps: float, frames: int, is_stated: bool
) -> None:
    folder = small_take(fps=fps, frames=frames)
    if not is_stated:
        leave_to_videos(folder, f"fps = {fps}")
    path = folder / "videos/cam02.mp4"
    with av.open(str(path)) as source, av.open(str(path.with_suffix(".mkv")), "w") as target:
        stream = target.add_stream_from_template(source.streams.video[0])
        for packet in source.demux(video=0):
            if packet.dts is not None:
                packet.stream = stream
                target.mux(packet)
    path.unlink()
    take = open_take(folder)
    assert take.remarks == ()
    assert take.settings.fps == fps


def test_videos_of_one_frame_tell_no_rate(small_take: SmallTake, refusal: Refusal) -> None:
    folder = small_take(frames=1)
    leave_to_videos(folder, "fps = 10.0")
    assert refusal(folder) == (
        "take.toml: fps: is missing: expected a positive number of frames per second, which videos of one "
        "frame do not tell"
    )


@pytest.mark.parametrize("is_stated", [True, False])
def test_videos_that_give_pictures_the_same_time(
    small_take: SmallTake, refusal: Refusal, is_stated: bool
) -> None:
    """As a bare stream of H.264, which has no times."""
    folder = small_take()
    if not is_stated:
        leave_to_videos(folder, "fps = 10.0")
    path = folder / "videos/cam01.mp4"
    with av.open(str(path)) as source, av.open(str(folder / "bare"), "w", format="h264") as target:
        stream = target.add_stream_from_template(source.streams.video[0])
        for packet in source.demux(video=0):
            if packet.dts is not None:
                packet.stream = stream
                target.mux(packet)
    (folder / "bare").replace(path)
    assert refusal(folder) == (
        "videos/cam01.mp4: gives most pictures the same time: convert it (ffmpeg -r FPS -i IN OUT)"
    )


def lose_frames(path: Path) -> None:
    """Frames 7 and later are shown four frames later: as if four frames were lost."""
    late_path = path.with_name("gap.mp4")
    with av.open(str(path)) as source, av.open(str(late_path), "w") as target:
        stream = target.add_stream_from_template(source.streams.video[0])
        for packet in source.demux(video=0):
            if packet.pts is not None and packet.dts is not None:
                late = 1024 * 4 if packet.pts * float(packet.time_base) >= 0.7 else 0
                packet.pts, packet.dts = packet.pts + late, packet.dts + late
                packet.stream = stream
                target.mux(packet)
    late_path.replace(path)


@pytest.mark.parametrize("is_stated", [True, False])
def test_a_video_with_lost_frames(small_take: SmallTake, refusal: Refusal, is_stated: bool) -> None:
    folder = small_take(frames=12)
    if not is_stated:
        leave_to_videos(folder, "fps = 10.0")
    lose_frames(folder / "videos/cam01.mp4")
    sentence = refusal(folder)
    assert sentence.startswith("videos/cam01.mp4: lacks frames between its frames 6 and 7, which are 0."), (
        sentence
    )
    assert sentence.endswith("convert it to a constant frame rate (ffmpeg -i IN -vf fps=10 OUT)")


@pytest.mark.parametrize("part", ["videos", "background"])
def test_a_video_of_another_size(small_take: SmallTake, refusal: Refusal, part: str) -> None:
    folder = small_take()
    rewrite_video(folder / part / "cam02.mp4", 4, size_px=(48, 64))
    assert refusal(folder) == (
        f"{part}/cam02.mp4: is 48x64 pixels, but [cam02] size in calibration.toml is 64x48: "
        "turn the pictures by a quarter turn (ffmpeg -i IN -vf transpose=1 OUT; transpose=2 if they are then "
        "upside down), or calibrate with pictures as these"
    )


@pytest.mark.parametrize("part", ["videos", "background"])
@pytest.mark.parametrize("kept", [0.0, 0.3, 0.7, 0.99])
def test_a_video_whose_tail_is_cut_off(
    small_take: SmallTake, refusal: Refusal, part: str, kept: float
) -> None:
    folder = small_take(frames=20)
    path = folder / part / "cam02.mp4"
    data = path.read_bytes()
    pictures = data.index(b"mdat")
    path.write_bytes(data[: pictures + int(kept * (len(data) - pictures))])
    sentence = refusal(folder)
    assert sentence.startswith(f"{part}/cam02.mp4: "), sentence
    assert "cut off" in sentence
    assert sentence.endswith("copy or record it again")
    if kept == 0.7 and part == "videos":
        after = int(sentence.split("cut off after ")[1].split(" of 20 frames")[0])
        assert 0 < after < 20


@pytest.mark.parametrize("cut", ["no index", "empty"])
def test_a_video_without_its_index(small_take: SmallTake, refusal: Refusal, cut: str) -> None:
    folder = small_take()
    path = folder / "videos/cam02.mp4"
    data = path.read_bytes()
    index = data.index(b"moov") - 4
    index_end = index + int.from_bytes(data[index : index + 4], "big")
    path.write_bytes(data[:index] + data[index_end:] if cut == "no index" else b"")
    assert refusal(folder) == (
        "videos/cam02.mp4: cannot be read as a video (empty, cut off before its index, no video): "
        "copy or record it again"
    )


@pytest.mark.parametrize("is_cut", [True, False])
def test_a_video_without_a_known_codec(small_take: SmallTake, refusal: Refusal, is_cut: bool) -> None:
    """Whether its file ends before it names the codec, or names one that FFmpeg lacks."""
    folder = small_take()
    path = folder / "videos/cam02.mp4"
    data = path.read_bytes()
    codec = data.index(b"avc1", data.index(b"stsd"))
    path.write_bytes(data[: codec - 16] if is_cut else data[:codec] + b"none" + data[codec + 4 :])
    assert refusal(folder) == (
        "videos/cam02.mp4: contains no video that can be decoded: copy it again or convert it"
    )


def test_an_avi_with_a_damaged_frame_in_its_middle_is_refused(
    small_take: SmallTake, refusal: Refusal
) -> None:
    """What comes after it would be a frame early."""
    folder = small_take(frames=60)
    (folder / "videos/cam02.mp4").unlink()
    path = folder / "videos/cam02.avi"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mjpeg", rate=10)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuvj420p"
        for n in range(60):
            picture = np.full((48, 64, 3), 4 * n, np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="bgr24")))
        container.mux(stream.encode(None))
    content = bytearray(path.read_bytes())
    at = [match.start() for match in re.finditer(b"00dc", bytes(content))][30]
    content[at - 10 : at + 8] = b"?" * 18
    path.write_bytes(bytes(content))
    assert "cut off after 5" in refusal(folder)
