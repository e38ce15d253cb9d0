"""Videos as people have them: their names, containers, lengths, and what take.toml need not say."""

import shutil
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import TypeAlias

import av
import numpy as np
import pytest

from services.mocap.errors import TakeError
from services.mocap.take.folder import open_take
from services.mocap.take.recordings import match_by_name

SmallTake: TypeAlias = Callable[..., Path]
Refusal: TypeAlias = Callable[[Path], str]


@pytest.mark.parametrize(
    ("cameras", "stems", "matched"),
    [
        (["cam01", "cam02"], ["cam02", "cam01", "notes"], {"cam01": "cam01", "cam02": "cam02"}),
        (
            ["int_cam01_img", "int_cam02_img"],
            ["cam01", "cam02"],
            {"int_cam01_img": "cam01", "int_cam02_img": "cam02"},
        ),
        (
            ["cam_0", "cam_1"],
            ["Camera_001_a", "Camera_000_a"],
            {"cam_0": "Camera_000_a", "cam_1": "Camera_001_a"},
        ),
        (
            ["left", "right"],
            ["GX0123_Right", "GX0124_left"],
            {"left": "GX0124_left", "right": "GX0123_Right"},
        ),
        (["cam1", "cam2"], ["walk1_cam1", "walk1_cam2"], {"cam1": "walk1_cam1", "cam2": "walk1_cam2"}),
        (["cam1", "cam2", "cam3"], ["cam1", "cam3a", "cam3b"], {"cam1": "cam1"}),  # which is the third's?
        (["cam1", "cam2"], ["a", "b"], {}),
        (["cam1", "cam12"], ["take_12", "take_1"], {"cam1": "take_1", "cam12": "take_12"}),
        (
            ["cam01", "cam02", "cam03"],
            ["cam_1_take_2", "cam_2_take_2", "cam_3_take_2"],
            {"cam01": "cam_1_take_2", "cam02": "cam_2_take_2", "cam03": "cam_3_take_2"},
        ),
        (["für", "fár"], ["fár_a", "für_a"], {"für": "für_a", "fár": "fár_a"}),
        (["левая", "правая"], ["бег-Правая", "бег-Левая"], {"левая": "бег-Левая", "правая": "бег-Правая"}),
    ],
)
def test_files_are_matched_to_cameras_by_what_tells_them_apart(
    cameras: list[str], stems: list[str], matched: dict[str, str]
) -> None:
    found = match_by_name(cameras, [Path(f"{stem}.mov") for stem in stems])
    assert [(camera, path.stem) for camera, path in found.items()] == list(matched.items())


SOUTH, SOUTH_OF_MACOS = "S\u00fcd", "Su\u0308d"


def named(folder: Path, camera: str) -> Path:
    """Give cam01 of a take this name in its calibration."""
    path = folder / "calibration.toml"
    path.write_text(path.read_text().replace('name = "cam01"', f'name = "{camera}"'))
    return folder


@pytest.mark.parametrize(
    ("camera", "file"), [(SOUTH, SOUTH_OF_MACOS), (SOUTH_OF_MACOS, SOUTH)], ids=["file", "camera"]
)
def test_names_that_look_the_same_are_the_same(small_take: SmallTake, camera: str, file: str) -> None:
    """macOS takes ü apart in file names."""
    folder = named(small_take("videos"), camera)
    for part in ("videos", "background"):
        (folder / part / "cam01.mp4").rename(folder / part / f"{file}.mp4")
    take = open_take(folder)
    assert take.videos[SOUTH].name == take.plates[SOUTH].name == f"{file}.mp4"
    assert take.remarks == ()
    (folder / f"videos/{file}.mp4").rename(folder / "videos/1.mp4")
    with (folder / "take.toml").open("a") as text:
        text.write(f'\n[videos]\n"{file}" = "videos/1.mp4"\n[offsets]\n"{file}" = 0\n')
    take = open_take(folder)
    assert take.videos[SOUTH].name == "1.mp4"
    assert take.settings.offsets == {SOUTH: 0}
    folder = named(small_take("silhouettes", source="silhouettes"), camera)
    (folder / "silhouettes/cam01").rename(folder / "silhouettes" / file)
    take = open_take(folder)
    assert len(list(take.trimaps(take.cameras[0]))) == 4


def test_a_camera_that_one_table_names_twice(small_take: SmallTake, refusal: Refusal) -> None:
    folder = named(small_take(), SOUTH)
    with (folder / "take.toml").open("a") as text:
        text.write(f'\n[offsets]\n"{SOUTH}" = 0\n"{SOUTH_OF_MACOS}" = 3\n')
    said = refusal(folder)
    assert said.startswith(f"take.toml: offsets: {SOUTH}: two entries have names that look like this one")


def test_a_camera_whose_name_toml_needs_in_quotes(small_take: SmallTake, refusal: Refusal) -> None:
    folder = named(small_take(), SOUTH)
    (folder / "videos/cam01.mp4").rename(folder / "videos/b.mp4")
    assert refusal(folder).endswith('[videos] in take.toml, such as "Süd" = "videos/b.mp4"')


def convert(source: Path, target: Path, codec: str) -> None:
    with av.open(str(source)) as read, av.open(str(target), "w") as write:
        stream = write.add_stream(codec, rate=Fraction(10))
        stream.width, stream.height = read.streams.video[0].width, read.streams.video[0].height
        stream.pix_fmt = "yuv420p"
        for i, frame in enumerate(read.decode(video=0)):
            frame.pts, frame.time_base = i, Fraction(1, 10)
            write.mux(stream.encode(frame))
        write.mux(stream.encode(None))
    source.unlink()


def test_a_take_whose_videos_have_other_names_and_containers(small_take: SmallTake) -> None:
    folder = small_take()
    convert(folder / "videos/cam01.mp4", folder / "videos/walk-Cam1.AVI", "mpeg4")
    convert(folder / "videos/cam02.mp4", folder / "videos/walk-Cam2.mov", "libx264")
    (folder / "background/cam01.mp4").rename(folder / "background/empty_1.mp4")
    convert(folder / "background/cam02.mp4", folder / "background/empty_2.mkv", "libx264")
    text = (folder / "take.toml").read_text()
    text = "\n".join(line for line in text.splitlines() if not line.startswith(("fps", "frames")))
    (folder / "take.toml").write_text(text)
    take = open_take(folder)
    assert (take.settings.fps, take.settings.frames) == (10.0, 4)
    assert [take.videos[camera.name].name for camera in take.cameras] == ["walk-Cam1.AVI", "walk-Cam2.mov"]
    for camera in take.cameras:
        with take.video(camera) as video:
            assert sum(picture.shape == (48, 64, 3) for picture in video) == 4
        assert len(list(take.background(camera))) >= 1
    assert {path.name for path in take.inputs(from_videos=True)} == {
        "calibration.toml", "walk-Cam1.AVI", "walk-Cam2.mov", "empty_1.mp4", "empty_2.mkv"
    }  # fmt: skip


def test_videos_that_take_toml_names(small_take: SmallTake, refusal: Refusal, tmp_path: Path) -> None:
    folder, settings = small_take(), tmp_path / "small/take.toml"
    (folder / "videos/cam01.mp4").rename(tmp_path / "GX010002.MP4")
    (folder / "videos/cam02.mp4").rename(folder / "videos/b.mp4")
    assert refusal(folder) == (
        "videos/cam01.mp4: is missing: expected the video of [cam01] in calibration.toml, or silhouettes in "
        "silhouettes/cam01; b.mp4 can be given to cameras by a table [videos] in take.toml, such as "
        'cam01 = "videos/b.mp4"'
    )
    text = settings.read_text()
    settings.write_text(f'{text}\n[videos]\ncam01 = "../GX010002.MP4"\ncam02 = "videos/b.mp4"\n')
    assert open_take(folder).videos["cam01"].samefile(tmp_path / "GX010002.MP4")
    settings.write_text(f'{text}\n[videos]\ncam1 = "../GX010002.MP4"\n')
    assert "take.toml: videos: cam1: is no camera of calibration.toml: did you mean cam01" in refusal(folder)
    settings.write_text(f'{text}\n[videos]\ncam01 = "videos/c.mp4"\n')
    assert "take.toml: videos: cam01: " in refusal(folder)


def test_a_video_of_no_camera_is_a_remark(small_take: SmallTake) -> None:
    folder = small_take()
    assert open_take(folder).remarks == ()
    shutil.copy(folder / "videos/cam02.mp4", folder / "videos/cam05.mp4")
    said = f"{folder}/videos/cam05.mp4: belongs to no camera of calibration.toml and is not used"
    assert open_take(folder).remarks == (said,)
    assert open_take(folder, in_step=False).remarks == (said,)
    settings = folder / "take.toml"
    settings.write_text(f'{settings.read_text()}\n[videos]\ncam02 = "videos/../videos/cam05.mp4"\n')
    (remark,) = open_take(folder).remarks
    assert remark.startswith(f"{folder}/videos/cam02.mp4: is a second file of cam02 beside cam05.mp4")


def test_a_second_video_of_a_camera_is_a_remark(small_take: SmallTake) -> None:
    folder = small_take()
    shutil.copy(folder / "videos/cam01.mp4", folder / "videos/cam01.avi")
    take = open_take(folder)
    assert take.videos["cam01"].name == "cam01.avi"
    assert take.remarks == (
        f"{folder}/videos/cam01.mp4: is a second file of cam01 beside cam01.avi, which is used: keep one of "
        "them",
    )


@pytest.mark.parametrize(
    ("rows", "field"),
    [
        ("[videos]\nactor_height = 1.75", "videos: actor_height"),
        ("[videos]\nfacing = 90", "videos: facing"),
        ('[videos]\ncam01 = "videos/cam01.mp4"\nunsure = []', "videos: unsure"),
        ('[videos]\nup = "y"', "videos: up"),
        ('[videos]\nname = "walk"', "videos: name"),
        ("[offsets]\nactor_height = 1.75", "offsets: actor_height"),
        ("[offsets]\ninit_frames = 3", "offsets: init_frames"),
        ("[initial_pose]\nfps = 25", "initial_pose: fps"),
    ],
)
def test_a_field_of_the_take_inside_a_table_is_named(
    small_take: SmallTake, refusal: Refusal, rows: str, field: str
) -> None:
    folder = small_take()
    with (folder / "take.toml").open("a") as file:
        file.write(f"\n{rows}\n")
    table = field.partition(":")[0]
    assert refusal(folder) == (
        f"take.toml: {field}: is a field of the take, not of this table: move it above [{table}]"
    )


def test_a_required_field_inside_videos_is_misplaced_rather_than_missing(
    small_take: SmallTake, refusal: Refusal
) -> None:
    folder = small_take()
    settings = folder / "take.toml"
    settings.write_text(settings.read_text().replace('units = "m"\n', "") + '\n[videos]\nunits = "m"\n')
    assert refusal(folder).startswith("take.toml: videos: units: is a field of the take")


def test_a_camera_may_be_named_like_a_field(small_take: SmallTake) -> None:
    folder = small_take()
    calibration = folder / "calibration.toml"
    calibration.write_text(calibration.read_text().replace("cam01", "up").replace("cam02", "facing"))
    shutil.rmtree(folder / "background")
    with (folder / "take.toml").open("a") as file:
        file.write('\n[videos]\nup = "videos/cam01.mp4"\nfacing = "videos/cam02.mp4"\n')
        file.write("\n[offsets]\nfacing = 0\n")
    take = open_take(folder)
    assert {name: path.name for name, path in take.videos.items()} == {
        "up": "cam01.mp4",
        "facing": "cam02.mp4",
    }


def test_silhouettes_do_not_know_their_rate_but_their_number(small_take: SmallTake) -> None:
    folder = small_take(source="silhouettes", frames=3)
    settings = folder / "take.toml"
    settings.write_text(settings.read_text().replace("frames = 3\n", ""))
    assert open_take(folder).settings.frames == 3
    settings.write_text(settings.read_text().replace("fps = 10.0\n", ""))
    with pytest.raises(TakeError, match="fps: is missing"):
        open_take(folder)


def test_videos_of_different_rates_where_take_toml_states_none(small_take: SmallTake) -> None:
    folder = small_take()
    settings = folder / "take.toml"
    settings.write_text(settings.read_text().replace("fps = 10.0\n", ""))
    (folder / "videos/cam02.mp4").unlink()
    with av.open(str(folder / "videos/cam02.mp4"), "w") as container:
        stream = container.add_stream("libx264", rate=Fraction(25))
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for _ in range(4):
            frame = av.VideoFrame.from_ndarray(np.zeros((48, 64, 3), np.uint8), format="bgr24")
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    with pytest.raises(TakeError, match="runs at 25 frames per second, but the first camera's video at 10"):
        open_take(folder)
