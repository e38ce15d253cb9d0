"""Pictures picked in any order are those that reading in order gives."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import av
import numpy as np
import pytest

from services.mocap.errors import TakeError
from services.mocap.take.video import PicturePicker, VideoReader
from services.mocap.take.video_index import index_video

_N = 60
_B_FRAMES = "keyint=12:min-keyint=12:scenecut=0:b-adapt=0:bframes=3:b-pyramid=normal"


@pytest.fixture(scope="module", params=["mp4", "mkv", "mpg", "avi"])
def video(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Sixty pictures with a keyframe every 12, and B-frames that refer to each other.

    The MPEG program stream has no B-frames; a seek in it lands in the midst of a frame. In the AVI frames
    are counted.
    """
    path = tmp_path_factory.mktemp("video") / f"v.{request.param}"
    noise = np.random.default_rng(3)
    with av.open(str(path), "w") as container:
        if request.param == "mpg":
            stream = container.add_stream("mpeg2video", 25, {"g": "12"})
        else:
            stream = container.add_stream("libx264", 25, {"x264-params": _B_FRAMES})
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for n in range(_N):
            picture = noise.integers(0, 60, (48, 64, 3), np.uint8)
            picture[:, n : n + 4] = 255
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, "bgr24")))
        container.mux(stream.encode())
    return path


@pytest.mark.parametrize("step", [1, 2, 5, 13, -1, -7])
def test_pictures_in_any_order_are_exact(video: Path, step: int) -> None:
    with VideoReader(video) as reader:
        expected = list(reader)
    picker = PicturePicker(index_video(video))
    for frame in range(_N)[::step]:
        np.testing.assert_array_equal(picker.read(frame), expected[frame])


@pytest.mark.parametrize("name", ["v.mp4", "v.avi"])
def test_short_pictures_of_mpeg_4_are_no_repetitions(tmp_path: Path, name: str) -> None:
    """A B-frame of a still room in which little moves takes as few bytes as a frame that is not coded."""
    with av.open(str(tmp_path / name), "w") as container:
        stream = container.add_stream("mpeg4", 25, {"bf": "2"})
        stream.width, stream.height, stream.pix_fmt = 320, 240, "yuv420p"
        for n in range(_N):
            picture = np.full((240, 320, 3), 60, np.uint8)
            picture[96:128, 2 * n : 2 * n + 32] = 200
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, "bgr24")))
        container.mux(stream.encode())
    with VideoReader(tmp_path / name) as reader:
        expected = list(reader)
    assert reader.index.repeats
    picker = PicturePicker(reader.index)
    for frame in (*range(_N), *range(0, _N, 7), *range(_N)[::-3]):
        np.testing.assert_array_equal(picker.read(frame), expected[frame])


def test_reading_may_begin_at_any_frame(video: Path) -> None:
    with VideoReader(video) as reader:
        expected = list(reader)
    for start in range(_N):
        with VideoReader(video, start, start + 1) as reader:
            np.testing.assert_array_equal(next(iter(reader)), expected[start])


def test_going_on_decodes_less_than_all(video: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    picker = PicturePicker(index_video(video))
    reader, read = picker._reader, list[object]()
    decoded = reader._decoded

    def noted(packets: "Iterator[av.Packet[av.VideoStream]]") -> "Iterator[av.Packet[av.VideoStream]]":
        for packet in packets:
            read.append(packet)
            yield packet

    monkeypatch.setattr(reader, "_decoded", lambda packets: decoded(noted(packets)))
    picker.read(1)
    read.clear()
    picker.read(37)
    assert len(read) <= 10, "it begins at the keyframe before"
    read.clear()
    picker.read(41)
    assert len(read) <= 5


def test_before_where_reading_begins_only_what_others_depend_on_is_decoded(
    video: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with VideoReader(video, 47, 48) as reader:
        n_decoded, decoded = 0, reader._decoded

        def counted(packets: "Iterator[av.Packet[av.VideoStream]]") -> Iterator[av.VideoFrame]:
            nonlocal n_decoded
            for frame in decoded(packets):
                n_decoded += 1
                yield frame

        monkeypatch.setattr(reader, "_decoded", counted)
        next(iter(reader))
    since_keyframe = 48 - reader.index.keyframe_before(47)[0]
    assert (n_decoded < since_keyframe) == (video.suffix in (".mp4", ".mkv"))


def test_what_is_not_there_is_said(video: Path) -> None:
    picker = PicturePicker(index_video(video))
    with pytest.raises(TakeError, match="has no frame 60"):
        picker.read(_N)
    picker.read(_N - 1)
    picker.read(0)


def test_what_cannot_be_decoded_is_said_and_others_can(video: Path) -> None:
    index, content = index_video(video), bytearray(video.read_bytes())
    whole = PicturePicker(index).read(0)
    content[len(content) // 2 : len(content) // 2 + 6000] = bytes(6000)
    video.with_suffix(".hurt").write_bytes(content)
    hurt = PicturePicker(replace(index, path=video.with_suffix(".hurt")))
    failed = 0
    for frame in range(_N):
        try:
            hurt.read(frame)
        except TakeError:
            failed += 1
    assert 0 < failed < _N
    np.testing.assert_array_equal(hurt.read(0), whole)
