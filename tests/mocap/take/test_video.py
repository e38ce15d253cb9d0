import shutil
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from av.stream import Disposition
from hypothesis import given, settings
from hypothesis import strategies as st

from rotation_tag import tag_a_quarter_turn
from services.mocap.errors import TakeError
from services.mocap.take.video import PicturePicker, VideoReader
from services.mocap.take.video_index import index_video
from services.mocap.take.writer import video_writer, write_picture
from services.mocap.types import Bytes

N_FRAMES, FPS = 70, 15.0  # three groups of pictures


def numbered(frame: int) -> Bytes:
    """A picture (48, 64, 3) with its number in binary: eight stripes of 8 pixels, black or white."""
    bits = np.array([255 * (frame >> bit & 1) for bit in range(8)], np.uint8)
    return np.tile(np.repeat(bits, 8)[:, None], (48, 1, 3))


def number_of(picture: Bytes) -> int:
    return sum(1 << bit for bit in range(8) if picture[24, 8 * bit + 4, 1] > 127)


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("video") / "cam01.mp4"
    with video_writer(path, 64, 48, FPS) as writer:
        for frame in range(N_FRAMES):
            writer.write(numbered(frame))
    return path


def test_what_is_written_is_what_browsers_play(video: Path) -> None:
    data = video.read_bytes()
    assert data.index(b"moov") < data.index(b"mdat")  # playing starts before all is loaded
    with av.open(str(video)) as container:
        stream = container.streams.video[0]
        assert (stream.codec_context.name, stream.codec_context.pix_fmt) == ("h264", "yuv420p")
        assert (stream.frames, stream.average_rate) == (N_FRAMES, Fraction(15))
    assert [path.name for path in video.parent.iterdir()] == ["cam01.mp4"]


def test_the_index_is_exact(video: Path) -> None:
    index = index_video(video)
    assert (index.width_px, index.height_px, index.n_frames) == (64, 48, N_FRAMES)
    np.testing.assert_allclose(index.times_s, np.arange(N_FRAMES) / FPS, atol=1e-4)
    keyframes = [number for number, _ in index.keyframes]
    assert keyframes[0] == 0
    assert np.diff(keyframes).max() <= 2 * FPS  # at least every two seconds


@settings(max_examples=25, deadline=None)
@given(st.data())
def test_frames_are_numbered_exactly_wherever_reading_starts(video: Path, data: st.DataObject) -> None:
    start = data.draw(st.integers(0, N_FRAMES))
    stop = data.draw(st.integers(start, N_FRAMES))
    with VideoReader(video, start, stop) as reader:
        for _ in range(2):  # each iteration starts anew
            assert [number_of(picture) for picture in reader] == list(range(start, stop))


@pytest.mark.parametrize("bgr", [(30, 60, 220), (200, 120, 10), (128, 128, 128), (15, 240, 90)])
def test_colours_come_back(tmp_path: Path, bgr: tuple[int, int, int]) -> None:
    with video_writer(tmp_path / "x.mp4", 64, 48, FPS) as writer:
        writer.write(np.full((48, 64, 3), bgr, np.uint8))
    with VideoReader(tmp_path / "x.mp4") as reader:
        (picture,) = reader
    assert np.abs(picture.astype(int) - bgr).max() <= 4
    ok, seen = cv2.VideoCapture(str(tmp_path / "x.mp4")).read()
    assert ok
    assert np.abs(seen.astype(int) - picture).max() <= 3  # other readers see the same colours


def test_pictures_stored_lying_are_turned_upright_as_opencv_does(video: Path, tmp_path: Path) -> None:
    turned = Path(shutil.copy(video, tmp_path / "turned.mp4"))
    tag_a_quarter_turn(turned, height_px=48)
    with VideoReader(turned, 0, 1) as reader:
        (picture,) = reader
    ok, seen = cv2.VideoCapture(str(turned)).read()
    assert ok
    assert (reader.index.width_px, reader.index.height_px, reader.index.is_turned) == (48, 64, True)
    assert picture.shape == seen.shape == (64, 48, 3)
    assert np.abs(picture.astype(int) - seen).max() <= 3


@pytest.mark.parametrize("hidden", [5, 40])
def test_frames_that_an_edit_list_hides_are_not_counted(video: Path, tmp_path: Path, hidden: int) -> None:
    data = bytearray(video.read_bytes())
    entry = data.index(b"elst") + 12  # its one entry: duration (ms), first time shown (stamps), rate
    duration_ms, first = (int.from_bytes(data[entry + i : entry + i + 4], "big") for i in (0, 4))
    data[entry : entry + 4] = (duration_ms - hidden * 1000 // 15).to_bytes(4, "big")
    data[entry + 4 : entry + 8] = (first + hidden * 1024).to_bytes(4, "big")
    trimmed = tmp_path / "trimmed.mp4"
    trimmed.write_bytes(data)
    with VideoReader(trimmed) as reader:
        assert [number_of(picture) for picture in reader] == list(range(hidden, N_FRAMES))
    with VideoReader(reader.index, 7, 20) as reader:
        assert [number_of(picture) for picture in reader] == list(range(hidden + 7, hidden + 20))


_OPEN = {
    "libx264": {"x264-params": "open-gop=1:keyint=20:min-keyint=20:scenecut=0:b-adapt=0:bframes=3"},
    "libx265": {
        "x265-params": "open-gop=1:keyint=20:min-keyint=20:scenecut=0:b-adapt=0:bframes=3:log-level=none"
    },
}


def encode_open(path: Path, codec: str) -> None:
    """Numbered pictures with a keyframe every 20, before which frames are shown that need it."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=15, options=_OPEN[codec])
        assert isinstance(stream, av.VideoStream)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for frame in range(N_FRAMES):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(numbered(frame), format="bgr24")))
        container.mux(stream.encode(None))


@pytest.mark.parametrize("codec", _OPEN)
def test_frames_shown_before_their_keyframe_are_found(tmp_path: Path, codec: str) -> None:
    path = tmp_path / "open.mp4"
    encode_open(path, codec)
    for start in (1, 17, 18, 19, 20, 21, 39, 58, 69):
        with VideoReader(path, start) as reader:
            assert [number_of(picture) for picture in reader] == list(range(start, N_FRAMES))


def test_frames_are_counted_from_a_keyframe_that_nothing_after_it_looks_back_beyond(tmp_path: Path) -> None:
    """AVI has no time of frames out of order; after a seek, those before a keyframe would be missing."""
    encode_open(tmp_path / "open.avi", "libx264")
    index = index_video(tmp_path / "open.avi")
    assert [number for number, _ in index.keyframes] == [0]
    picker = PicturePicker(index)
    for start in (0, 1, 17, 18, 19, 20, 21, 39, 58, 69):
        with VideoReader(index, start) as reader:
            assert [number_of(picture) for picture in reader] == list(range(start, N_FRAMES))
        assert number_of(picker.read(start)) == start


@pytest.mark.parametrize("name", ["cut.mkv", "cut.ts"])
@pytest.mark.parametrize("begins_with_keyframe", [True, False])
def test_frames_that_a_cut_without_coding_anew_made_undecodable_are_left_out(
    tmp_path: Path, name: str, begins_with_keyframe: bool
) -> None:
    encode_open(tmp_path / "open.mp4", "libx265")
    with av.open(str(tmp_path / "open.mp4")) as source, av.open(str(tmp_path / name), "w") as target:
        stream = target.add_stream_from_template(source.streams.video[0])
        packets = [packet for packet in source.demux(video=0) if packet.size]
        key = [n for n, packet in enumerate(packets) if packet.is_keyframe][1]
        begin = packets[key if begins_with_keyframe else 5].pts or 0
        for packet in packets[key if begins_with_keyframe else 5 :]:
            packet.pts, packet.dts = (packet.pts or 0) - begin, (packet.dts or 0) - begin
            packet.stream = stream
            target.mux(packet)
    index = index_video(tmp_path / name)
    np.testing.assert_allclose(np.diff(index.times_s), 1 / 15, atol=2e-3)
    for start in (0, 1, 19, 20, 45):
        with VideoReader(index, start) as reader:
            assert [number_of(picture) for picture in reader] == list(range(20 + start, N_FRAMES))
    picker = PicturePicker(index)
    assert [number_of(picker.read(frame)) for frame in (40, 0, 19)] == [60, 20, 39]
    assert index.n_left_out == len(packets[key if begins_with_keyframe else 5 :]) - index.n_frames


def test_a_damaged_frame_is_named_and_none_passed_over(video: Path, tmp_path: Path) -> None:
    with av.open(str(video)) as container:
        packets = [(p.pts or 0, p.pos or 0, p.size) for p in container.demux(video=0) if p.size]
    _, at, size = sorted(packets)[45]
    data = bytearray(video.read_bytes())
    data[at + 5 : at + size] = b"\xff" * (size - 5)
    (tmp_path / "bad.mp4").write_bytes(data)
    read: list[int] = []
    with (
        pytest.raises(TakeError, match=r"bad.mp4: frame \d+ cannot be decoded") as refused,
        VideoReader(tmp_path / "bad.mp4") as reader,
    ):
        read.extend(number_of(picture) for picture in reader)
    assert read == list(range(len(read)))
    assert f"frame {len(read)} cannot" in str(refused.value)
    assert 30 <= len(read) <= 45  # no earlier than its own group of pictures


def test_a_title_in_unknown_letters_does_not_matter(video: Path, tmp_path: Path) -> None:
    path = tmp_path / "titled.mp4"
    with av.open(str(video)) as source, av.open(str(path), "w") as target:
        target.metadata["title"] = "a title of letters"
        stream = target.add_stream_from_template(source.streams.video[0])
        for packet in source.demux(video=0):
            packet.stream = stream
            if packet.dts is not None:
                target.mux(packet)
    data = path.read_bytes()
    assert b"a title of letters" in data
    path.write_bytes(data.replace(b"a title of letters", b"a t\xeftle of letter\xdf"))  # Latin 1, not UTF-8
    with VideoReader(path) as reader:
        assert [number_of(picture) for picture in reader] == list(range(N_FRAMES))


def test_frames_outside_the_file_are_refused(video: Path) -> None:
    with pytest.raises(TakeError, match="frames 60 to 71 were requested, but it has 70"):
        VideoReader(video, 60, 71)


def test_odd_sizes_are_refused(tmp_path: Path) -> None:
    with (
        pytest.raises(TakeError, match=r"x.mp4: cannot be written in 63x48 pixels: expected an even"),
        video_writer(tmp_path / "x.mp4", 63, 48, FPS),
    ):
        pytest.fail("the block must not run")


@pytest.mark.parametrize("shape", [None, (48, 62, 3), (48, 64)])
def test_a_failed_video_leaves_nothing(tmp_path: Path, shape: tuple[int, ...] | None) -> None:
    with pytest.raises(ValueError, match="picture"), video_writer(tmp_path / "x.mp4", 64, 48, FPS) as writer:
        if shape:
            writer.write(numbered(0))
            writer.write(np.zeros(shape, np.uint8))
    assert not any(tmp_path.iterdir())


def test_a_picture_is_no_video(tmp_path: Path) -> None:
    (tmp_path / "cam01.mp4").write_text("not a video")
    with pytest.raises(TakeError, match=r"cam01.mp4: cannot be read as a video"):
        index_video(tmp_path / "cam01.mp4")
    with pytest.raises(TakeError, match=r"cam02.mp4: is missing"):
        index_video(tmp_path / "cam02.mp4")


def test_pictures_come_back_exactly(tmp_path: Path) -> None:
    picture = np.random.default_rng(0).integers(0, 256, (48, 64, 3)).astype(np.uint8)
    write_picture(tmp_path / "a" / "x.png", picture)
    np.testing.assert_array_equal(cv2.imread(str(tmp_path / "a" / "x.png")), picture)


def encode(
    path: Path, codec: str, not_coded: frozenset[int] = frozenset(), *, lost: int = -1, ticks: int = 1
) -> None:
    """30 numbered pictures, without the picture `lost`; the container counts `ticks` moments for each.

    Packets of MPEG-4 frames in `not_coded` say only "as before".
    """
    written, reorders = 0, codec != "mjpeg" and not not_coded
    with av.open(str(path), "w") as container:
        rate = Fraction(10 * ticks)
        stream = container.add_stream(codec, rate=rate, options={"bf": "2"} if reorders else {})
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuvj420p" if codec == "mjpeg" else "yuv420p"
        stream.codec_context.gop_size = 12
        frames = [av.VideoFrame.from_ndarray(numbered(i), format="bgr24") for i in range(30)]
        for i, frame in enumerate(frames):
            frame.pts, frame.time_base = i * ticks, 1 / rate
        for frame in (*(frame for i, frame in enumerate(frames) if i != lost), None):
            for coded in stream.encode(frame):
                packet = coded
                if written in not_coded:
                    # type P, no whole second, marker, time in 10ths, marker, not coded; stuffing
                    bits = int(f"0101{written % 10:04b}100" + "1" * 5, 2)
                    packet = av.Packet(b"\x00\x00\x01\xb6" + bits.to_bytes(2, "big"))
                    packet.pts, packet.dts, packet.stream = coded.pts, coded.dts, stream
                    packet.time_base, packet.duration = coded.time_base, coded.duration
                container.mux(packet)
                written += 1


@pytest.mark.parametrize(
    ("name", "codec"),
    [
        ("x.avi", "libx264"),  # AVI holds no presentation times: those of frames out of order are lost
        ("x.avi", "mpeg4"),
        ("x.avi", "mjpeg"),
        ("x.mov", "libx264"),
        ("x.mkv", "libx264"),
        ("x.ts", "mpeg2video"),
    ],
)
def test_frames_of_other_containers_are_numbered_exactly(tmp_path: Path, name: str, codec: str) -> None:
    encode(tmp_path / name, codec)
    index = index_video(tmp_path / name)
    np.testing.assert_allclose(np.diff(index.times_s), 0.1, atol=1e-3)
    for start, stop in ((0, 30), (17, 23), (29, 30)):
        with VideoReader(index, start, stop) as reader:
            assert [number_of(picture) for picture in reader] == list(range(start, stop))
    picker = PicturePicker(index)
    for frame in (20, 3, 4, 29):
        assert number_of(picker.read(frame)) == frame


@pytest.mark.parametrize(("default", "read"), [(0, 0), (1, 1), (None, 0)])
def test_of_two_streams_the_default_one_is_read(tmp_path: Path, default: int | None, read: int) -> None:
    """Some recorders store a small copy of the video in front of it."""
    with av.open(str(tmp_path / "x.mkv"), "w") as container:
        for number in range(2):
            stream = container.add_stream("mjpeg", rate=10)
            stream.width, stream.height, stream.pix_fmt = 64, 48, "yuvj420p"
            stream.disposition = Disposition.default if number == default else Disposition(0)
        for number, stream in enumerate(container.streams.video):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(numbered(number), format="bgr24")))
            container.mux(stream.encode(None))
    with VideoReader(tmp_path / "x.mkv") as reader:
        assert [number_of(picture) for picture in reader] == [read]


@pytest.mark.parametrize(("codec", "lost", "ticks"), [("libx264", -1, 2), ("mjpeg", 10, 1)])
def test_moments_without_a_frame_do_not_cut_an_avi_off(
    tmp_path: Path, codec: str, lost: int, ticks: int
) -> None:
    encode(tmp_path / "x.avi", codec, lost=lost, ticks=ticks)
    numbers = [frame for frame in range(30) if frame != lost]
    with VideoReader(tmp_path / "x.avi") as reader:
        assert [number_of(picture) for picture in reader] == numbers
    np.testing.assert_allclose(reader.index.times_s, np.array(numbers) / 10, atol=1e-6)
    data = (tmp_path / "x.avi").read_bytes()
    (tmp_path / "cut.avi").write_bytes(data[: (data.index(b"movi") + 2 * data.rindex(b"idx1")) // 3])
    with pytest.raises(
        TakeError, match=r"cut.avi: cut off after [12]\d of 30 frames: copy or record it again"
    ):
        index_video(tmp_path / "cut.avi")


@pytest.mark.parametrize("name", ["x.avi", "x.mp4"])
def test_a_frame_that_is_not_coded_shows_the_picture_before(tmp_path: Path, name: str) -> None:
    encode(tmp_path / name, "mpeg4", frozenset({5, 6, 29}))
    index = index_video(tmp_path / name)
    shown = [4 if frame in (5, 6) else 28 if frame == 29 else frame for frame in range(30)]
    for start, stop in ((0, 30), (6, 8), (29, 30)):
        with VideoReader(index, start, stop) as reader:
            assert [number_of(picture) for picture in reader] == shown[start:stop]
    picker = PicturePicker(index)
    for frame in (29, 6, 7, 5):
        assert number_of(picker.read(frame)) == shown[frame]
