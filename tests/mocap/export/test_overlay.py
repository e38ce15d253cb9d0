"""The overlay: its sheets, whose pictures are chosen so that no mix-up looks right, and its file."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest

from services.mocap.body.actor import Actor, build_body
from services.mocap.camera.camera import Camera
from services.mocap.errors import TakeError
from services.mocap.export.overlay import CAUSE_PX, HEADER_PX, draw_sheet, sheet_size_px, write_overlay
from services.mocap.export.text import write_text
from services.mocap.export.tiles import (
    CENTRE_BGR,
    LEFT_BGR,
    RIGHT_BGR,
    SILHOUETTE_GREY,
    SILHOUETTE_GROUND_GREY,
    grid_for,
    trimap_picture,
)
from services.mocap.synth.walk import walk
from services.mocap.take.folder import Take, open_take
from services.mocap.take.layout import silhouette_folder, silhouette_path
from services.mocap.take.tables import PoseTable
from services.mocap.take.writer import VideoWriter
from services.mocap.types import ACTOR, Bytes, Mask
from services.mocap.verdict.verdict import LEVELS, Cause, Level, Verdict

GROUND = 100
HALF_WAY = {
    value: (np.array(bgr) + GROUND) / 2 for value, bgr in enumerate((CENTRE_BGR, LEFT_BGR, RIGHT_BGR), 1)
}
"""What the fill makes of the ground, by the values of a segment mask."""


def camera(name: str = "cam01", width_px: int = 160, height_px: int = 120) -> Camera:
    return Camera(name, width_px, height_px, np.eye(3), np.zeros(4), np.eye(3), np.zeros(3))


def verdict_on(level: Level, *causes: Cause) -> Verdict:
    """A verdict on a frame with these causes."""
    return Verdict(level=level, frames=1, doubtful_frames=0, lost_frames=0, doubts=(), iou={}, causes=causes)


USABLE = verdict_on("usable with gaps")


def ground(camera: Camera, grey: int = GROUND) -> Bytes:
    return np.full((*camera.shape_px, 3), grey, np.uint8)


def no_masks(cameras: list[Camera]) -> list[Bytes]:
    return [np.zeros(cam.shape_px, np.uint8) for cam in cameras]


def half_masks(cameras: list[Camera]) -> list[Bytes]:
    """Two upright bars a tile, of values that differ from tile to tile, the left one higher up."""
    masks = []
    for index, cam in enumerate(cameras):
        height, width = cam.height_px, cam.width_px
        mask = np.zeros((height, width), np.uint8)
        mask[height // 4 : height * 5 // 8, width // 8 : width * 3 // 8] = 1 + index % 3
        mask[height * 3 // 8 : height * 3 // 4, width * 5 // 8 : width * 7 // 8] = 1 + (index + 1) % 3
        masks.append(mask)
    return masks


def sheet_of(
    cameras: list[Camera],
    pictures: list[Bytes],
    masks: list[Bytes],
    tile_width_px: int = 480,
    *,
    verdict: Verdict = USABLE,
    title: str = "frame 0    0.000 s",
    energy_px: float = 0.0,
    **more: Any,
) -> Bytes:
    grid = grid_for(cameras, tile_width_px)
    return draw_sheet(cameras, grid, verdict, title, energy_px, pictures, masks, **more)


def tiles(sheet: Bytes, cameras: list[Camera], tile_width_px: int) -> list[Bytes]:
    grid = grid_for(cameras, tile_width_px)
    return [grid.place(sheet[HEADER_PX:], index) for index in range(len(cameras))]


def at(tile: Bytes, x: float, y: float) -> Bytes:
    """The mean colour about a place given in fractions of the tile."""
    row, column = round(y * tile.shape[0]), round(x * tile.shape[1])
    mean: Bytes = tile[row - 2 : row + 3, column - 2 : column + 3].mean(axis=(0, 1))
    return mean


@pytest.mark.parametrize(
    ("count", "size", "columns_rows"),
    [
        (8, (320, 240), (4, 2)),
        (8, (1920, 1080), (4, 2)),
        (4, (320, 240), (2, 2)),
        (4, (544, 960), (4, 1)),
        (5, (320, 240), (3, 2)),
        (1, (320, 240), (1, 1)),
        (16, (320, 240), (4, 4)),
    ],
)
def test_grid_suits_the_screen(count: int, size: tuple[int, int], columns_rows: tuple[int, int]) -> None:
    grid = grid_for([camera(f"cam{i}", *size) for i in range(count)], 480)
    assert (grid.columns, grid.rows) == columns_rows
    assert grid.tile_width_px == 480
    assert grid.tile_height_px == pytest.approx(480 * size[1] / size[0], abs=1)


@pytest.mark.parametrize("tile_width_px", [1, 33, 101, 480])
def test_sizes_are_even(tile_width_px: int) -> None:
    cameras = [camera("a", 321, 241), camera("b", 97, 55), camera("c", 321, 243)]
    size_px = sheet_size_px(grid_for(cameras, tile_width_px), USABLE)
    assert all(side % 2 == 0 for side in size_px)
    sheet = sheet_of(cameras, [ground(cam) for cam in cameras], half_masks(cameras), tile_width_px)
    assert sheet.shape == (*size_px[::-1], 3)


@pytest.mark.parametrize("count", [1, 4, 8])
def test_limbs_have_their_colours_in_every_tile(count: int) -> None:
    cameras = [camera(f"cam{i:02d}") for i in range(1, count + 1)]
    sheet = sheet_of(cameras, [ground(cam) for cam in cameras], half_masks(cameras), 240)
    for index, tile in enumerate(tiles(sheet, cameras, 240)):
        expected_left, expected_right = HALF_WAY[1 + index % 3], HALF_WAY[1 + (index + 1) % 3]
        np.testing.assert_allclose(at(tile, 0.25, 0.31), expected_left, atol=8)
        np.testing.assert_allclose(at(tile, 0.75, 0.69), expected_right, atol=8)
        np.testing.assert_allclose(at(tile, 0.25, 0.69), GROUND, atol=4)
        np.testing.assert_allclose(at(tile, 0.75, 0.31), GROUND, atol=4)


def test_left_right_and_centre_cannot_be_mistaken() -> None:
    colours = np.array([LEFT_BGR, RIGHT_BGR, CENTRE_BGR], float)
    for one, other in ((0, 1), (1, 2), (2, 0)):
        assert np.linalg.norm(colours[one] - colours[other]) > 120
    assert LEFT_BGR[2] > 200 > LEFT_BGR[0] and RIGHT_BGR[0] > 200 > RIGHT_BGR[2]


@pytest.mark.parametrize("tile_width_px", [80, 160, 320])
def test_outline_runs_along_the_border_of_the_whole_silhouette(tile_width_px: int) -> None:
    cam = camera()
    mask = np.zeros((120, 160), np.uint8)
    mask[40:100, 40:80], mask[40:100, 80:120] = 2, 3  # one silhouette of two limbs
    sheet = sheet_of([cam], [ground(cam)], [mask], tile_width_px)
    tile = tiles(sheet, [cam], tile_width_px)[0].astype(float)
    zoom = tile_width_px / 160

    row = tile[round(70 * zoom)].min(axis=-1)
    bright = np.flatnonzero(row > 160)
    assert bright.size, "no outline"
    border = np.array([40, 119]) * zoom
    distance = np.abs(bright[:, None] - border)
    assert distance.min(axis=0).max() <= 2.0  # at both borders …
    assert distance.min(axis=1).max() <= 3.0  # … and nowhere else, not between the limbs either
    column = tile[:, round(60 * zoom)].min(axis=-1)
    lines = np.flatnonzero(column > 160)
    assert np.abs(lines[:, None] - np.array([40, 99]) * zoom).min(axis=0).max() <= 2.0
    dark = np.flatnonzero(row < 60)
    assert np.abs(dark[:, None] - border).min(axis=0).max() <= 4.0  # the halo


def test_a_hole_in_the_silhouette_is_outlined_too() -> None:
    cam = camera()
    mask = np.zeros((120, 160), np.uint8)
    mask[20:100, 40:120] = 1
    mask[45:75, 65:95] = 0
    tile = tiles(sheet_of([cam], [ground(cam)], [mask], 160), [cam], 160)[0]
    bright = np.flatnonzero(tile[60].min(axis=-1) > 160)
    assert np.abs(bright[:, None] - np.array([40, 64, 95, 119])).min(axis=0).max() <= 2
    np.testing.assert_allclose(tile[56:65, 76:85].mean(axis=(0, 1)), GROUND, atol=4)


def test_cameras_of_other_shapes_get_bars() -> None:
    cameras = [camera("wide", 200, 100), camera("square", 100, 100), camera("tall", 50, 100)]
    sheet = sheet_of(cameras, [ground(cam, 200) for cam in cameras], half_masks(cameras), 200)
    wide, square, tall = tiles(sheet, cameras, 200)
    assert wide.shape == square.shape == tall.shape == (200, 200, 3)
    for tile, size in ((wide, (200, 100)), (square, (200, 200)), (tall, (100, 200))):
        columns = np.flatnonzero(tile[180 if size[1] == 200 else 140].min(axis=-1) > 100)
        rows = np.flatnonzero(tile[:, 100].min(axis=-1) > 100)
        for lit, length in ((columns, size[0]), (rows, size[1])):
            assert abs(lit[0] - (200 - length) / 2) <= 1 and abs(lit[-1] - ((200 + length) / 2 - 1)) <= 1
    # the mask went along with the picture into its narrower place
    np.testing.assert_allclose(at(tall, 0.375, 0.31), (np.array(RIGHT_BGR) + 200) / 2, atol=10)


def test_without_pictures_the_silhouette_is_grey() -> None:
    cameras = [camera("pictured"), camera("silhouetted")]
    trimap = np.zeros((120, 160), np.uint8)
    trimap[:, 80:] = ACTOR
    pictures = [ground(cameras[0]), trimap_picture(trimap)]
    first = tiles(sheet_of(cameras, pictures, no_masks(cameras), 160), cameras, 160)
    np.testing.assert_allclose(at(first[0], 0.75, 0.5), GROUND, atol=3)
    np.testing.assert_allclose(at(first[1], 0.75, 0.5), SILHOUETTE_GREY, atol=3)
    np.testing.assert_allclose(at(first[1], 0.25, 0.5), SILHOUETTE_GROUND_GREY, atol=3)


def test_header_and_names_are_written() -> None:
    cameras = [camera("cam01"), camera("cam02")]
    pictures, none = [ground(cam, 40) for cam in cameras], no_masks(cameras)

    def titled(title: str, energy_px: float) -> Bytes:
        return sheet_of(cameras, pictures, none, 320, title=title, energy_px=energy_px).astype(int)

    same, other = titled("frame 3    0.120 s", 1234.0), titled("frame 4    0.160 s", 987.0)
    np.testing.assert_array_equal(titled("frame 3    0.120 s", 1234.0), same)
    changed = np.argwhere(np.abs(other - same).max(axis=-1) > 60)
    assert len(changed) > 20
    assert changed[:, 0].max() < HEADER_PX and changed[:, 1].max() < 400
    legend = same[:HEADER_PX, -120:]
    assert (legend[..., 2] - legend[..., 0]).max() > 100 and (legend[..., 0] - legend[..., 2]).max() > 100
    left, right = tiles(same.astype(np.uint8), cameras, 320)
    for tile in (left, right):
        assert tile[:30, :70].max() > 200 and tile[40:].max() < 60
    assert np.abs(left[:30, :80].astype(int) - right[:30, :80]).max() > 60  # each its own name


def test_doubtful_parts_are_hatched_and_the_header_says_so() -> None:
    cam = camera("cam01")
    doubtful = np.zeros((120, 160), bool)
    doubtful[40:100, 40:120] = True

    def said(words: str, hatched: list[Mask] | None = None) -> Bytes:
        given, verdict = ([cam], [ground(cam, 128)], no_masks([cam])), verdict_on("not usable")
        return sheet_of(*given, 320, verdict=verdict, doubtful=hatched, words=words).astype(int)

    plain, marked = said("good"), said("doubtful: head", [doubtful])
    red = marked[..., 2] - marked[..., :2].max(axis=-1) > 40
    inside, tile = red[HEADER_PX + 84 : HEADER_PX + 196, 84:236], red[HEADER_PX:]
    assert 0.25 < inside.mean() < 0.75  # lines with gaps
    assert tile.sum() < 1.2 * inside.sum()  # and nowhere else
    assert red[:30].any() and not (plain[..., 2] - plain[..., :2].max(axis=-1) > 40)[:30, :200].any()
    assert plain[32:HEADER_PX, :90].max() > 200  # the title


def test_good_is_green_only_where_all_frames_are() -> None:
    cam, greens = camera("cam01"), {}
    given = [cam], [ground(cam)], no_masks([cam])
    for level in LEVELS:
        unjudged, judged = (
            sheet_of(*given, verdict=verdict_on(level), words=words)[:HEADER_PX].astype(int)
            for words in ("", "good")
        )
        assert np.abs(judged - unjudged).max() > 100, "good is written at every level"
        greens[level] = bool((judged[..., 1] - judged[..., [0, 2]].max(axis=-1) > 40).any())
    assert greens == {"good": True, "usable with gaps": False, "not usable": False}


@pytest.mark.parametrize("count", [1, 8])
def test_the_first_cause_is_a_line_of_its_own_that_fits_the_sheet(count: int) -> None:
    cameras = [camera(f"cam{i}") for i in range(count)]
    short, long = (Cause(what=what, remedy="", level="not usable") for what in ("cam01 late", 100 * "late "))
    sheets = {}
    for name, causes in {"none": (), "short": (short,), "both": (short, long), "long": (long, short)}.items():
        verdict, pictures = verdict_on("not usable", *causes), [ground(cam) for cam in cameras]
        sheets[name] = sheet_of(cameras, pictures, no_masks(cameras), verdict=verdict).astype(int)
    height, width, _ = sheets["none"].shape
    assert {name: sheet.shape[0] - height for name, sheet in sheets.items()} == {
        "none": 0, "short": CAUSE_PX, "both": CAUSE_PX, "long": CAUSE_PX,
    }  # fmt: skip
    lines = {name: sheet[HEADER_PX : HEADER_PX + CAUSE_PX] for name, sheet in sheets.items()}
    assert np.abs(lines["short"] - lines["both"]).max() < 40, "only the first one is written"
    columns = np.flatnonzero((lines["long"].max(axis=-1) > 150).any(axis=0))
    assert 0.9 * width < columns.max() < width - 3
    last = lines["long"][:, columns.max() - 6 : columns.max() + 1].max(axis=-1) > 120
    assert not last[:8].any() and last[8:14].any(), "it ends in dots, which lie on the base line"


@pytest.mark.parametrize("width_px", [20, 60, 150, 300, 900])
def test_text_never_goes_beyond_the_picture(width_px: int) -> None:
    words = "cam03 agrees less with the body than the others"
    picture, alone = np.zeros((40, width_px, 3), np.uint8), np.zeros((40, 900, 3), np.uint8)
    end = write_text(picture, words, (10, 25), (255, 255, 255), 0.5)
    whole = write_text(alone, words, (10, 25), (255, 255, 255), 0.5)
    if width_px == 900:
        assert end == whole and np.array_equal(picture, alone)
        return
    assert 10 <= end <= width_px - 4 or (width_px == 20 and not picture.any())
    assert not picture[:, width_px - 3 :].any()
    kept = max(end - 30, 10)
    assert np.array_equal(picture[:, :kept], alone[:, :kept]), "it begins as the whole text does"


def test_pictures_that_are_not_the_cameras_are_refused() -> None:
    cameras = [camera("cam01"), camera("cam02")]
    pictures, none = [ground(cam) for cam in cameras], no_masks(cameras)
    with pytest.raises(ValueError, match="zip"):
        sheet_of(cameras, pictures, none[:1])
    said = r"^cam01: expected a picture of shape \(120, 160\), got \(60, 80\)$"
    with pytest.raises(ValueError, match=said):
        sheet_of(cameras, pictures, [np.zeros((60, 80), np.uint8), none[1]])
    said = r"^cam02: expected a picture of shape \(120, 160\), got \(240, 320, 3\)$"
    with pytest.raises(ValueError, match=said):
        sheet_of(cameras, [pictures[0], np.zeros((240, 320, 3), np.uint8)], none)


N_FRAMES = 5
SmallTake = Callable[..., Path]


def draw_overlay(take: Take, path: Path, hurry: Callable[[], bool] = lambda: False) -> None:
    """The overlay of someone who walks."""
    body = build_body(Actor(height=1.7))
    frames = np.arange(N_FRAMES, dtype=np.int32)
    table = PoseTable(frames, frames / 29.97, walk(N_FRAMES, 29.97, body), np.zeros(N_FRAMES))
    write_overlay(path, take, body, table, 29.97, USABLE, hurry)


def test_file_is_one_that_browsers_play(
    small_take: SmallTake, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, sheets = tmp_path / "out" / "overlay.mp4", list[Bytes]()

    def draw(*given: Any, **more: Any) -> Bytes:
        sheets.append(draw_sheet(*given, **more))
        return sheets[-1]

    monkeypatch.setattr("services.mocap.export.overlay.draw_sheet", draw)
    draw_overlay(open_take(small_take(n_cameras=8, frames=N_FRAMES)), path)
    assert [file.name for file in path.parent.iterdir()] == ["overlay.mp4"]

    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        assert (stream.codec_context.name, stream.codec_context.pix_fmt) == ("h264", "yuv420p")
        assert float(stream.average_rate or 0) == pytest.approx(29.97, rel=1e-4)
        assert (stream.width, stream.height) == (4 * 480, 2 * 360 + HEADER_PX)
        decoded = [frame.to_ndarray(format="bgr24").astype(int) for frame in container.decode(stream)]
    off = np.array([[np.abs(frame - sheet).mean() for sheet in sheets] for frame in decoded])
    assert off.shape == (N_FRAMES, N_FRAMES)
    assert off.argmin(axis=1).tolist() == list(range(N_FRAMES)) and off.diagonal().max() < 3
    content = path.read_bytes()
    assert 0 < content.index(b"moov") < content.index(b"mdat")  # it plays before all of it has come


@pytest.fixture
def earlier(tmp_path: Path) -> Path:
    """The file of an earlier run."""
    path = tmp_path / "out" / "overlay.mp4"
    path.parent.mkdir()
    path.write_text("from an earlier run")
    return path


def assert_untouched(earlier: Path) -> None:
    assert [file.name for file in earlier.parent.iterdir()] == ["overlay.mp4"]
    assert earlier.read_text() == "from an earlier run"


@pytest.mark.parametrize("failing", [0, 1, N_FRAMES - 1])
def test_what_goes_wrong_while_a_frame_is_encoded_is_raised(
    failing: int, small_take: SmallTake, earlier: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the last frame as well, while no further one is drawn."""
    take, write = open_take(small_take(frames=N_FRAMES, source="silhouettes")), VideoWriter.write

    def fail(video: VideoWriter, sheet: Bytes) -> None:
        if video.n_frames == failing:
            raise OSError("no room")
        write(video, sheet)

    monkeypatch.setattr(VideoWriter, "write", fail)
    with pytest.raises(OSError, match="no room"):
        draw_overlay(take, earlier)
    assert_untouched(earlier)


def test_nothing_is_left_behind_after_an_error(small_take: SmallTake, earlier: Path) -> None:
    take = open_take(small_take(frames=N_FRAMES, source="silhouettes"))
    silhouette_path(silhouette_folder(take.folder, "cam02"), 2).unlink()
    with pytest.raises(TakeError, match=r"000002\.png"):
        draw_overlay(take, earlier)
    assert_untouched(earlier)


def test_nothing_is_written_in_a_hurry(small_take: SmallTake, earlier: Path) -> None:
    asked = iter((False, False, True))
    draw_overlay(open_take(small_take(frames=N_FRAMES)), earlier, lambda: next(asked))
    assert_untouched(earlier)
