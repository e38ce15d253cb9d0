"""Tiles: what is drawn into the camera grid."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest

from services.mocap.body.actor import Body, build_body
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import trimap_of
from services.mocap.export.model_painter import ModelPainter
from services.mocap.export.tiles import CLASSES_BGR, DOUBTFUL_BGR, UNSURE_GREY
from services.mocap.take.actor_file import take_actor
from services.mocap.take.folder import Take
from services.mocap.take.tables import read_poses_csv
from services.mocap.types import UNSURE, Bytes, Floats
from services.viewer.picture_sources import Segmented
from services.viewer.solved_frame import SolvedFrame
from services.viewer.tiles import Content, Look, Tile, TileArtist

ALL = tuple(range(8))


class Fixed:
    """Grey pictures, and silhouettes that are the model's but for a band."""

    def __init__(self, body: Body, rig: Rig, pose: Floats, band_px: int) -> None:
        self._masks = [mask > 0 for mask in ModelPainter(body, rig).segment_masks(pose)]
        self.differing = []
        for mask in self._masks:
            middle = mask.shape[0] // 2
            self.differing.append(int(mask[middle : middle + band_px].sum()))
            mask[middle : middle + band_px] = False

    def picture(self, camera: int, frame: int) -> Bytes | None:  # noqa: ARG002
        return np.full((*self._masks[camera].shape, 3), 90, np.uint8)

    def segmented(self, camera: int, frame: int) -> Segmented | None:  # noqa: ARG002
        """Class 1 in the upper half, 7 in the lower one."""
        classes = self._masks[camera].astype(np.uint8)
        classes[len(classes) // 2 :] *= 7
        return Segmented(trimap_of(self._masks[camera]), classes)


@pytest.fixture
def scene(walk: Take, solved: Callable[..., SolvedFrame]) -> tuple[TileArtist, SolvedFrame, Fixed, Rig]:
    actor = take_actor(walk)
    assert actor is not None
    body, rig = build_body(actor), Rig.of(walk.cameras)
    pose = read_poses_csv(walk.folder / "reference" / "poses.csv").poses[12]
    pictures = Fixed(body, rig, pose, band_px=10)
    there = SolvedFrame(**{**vars(solved(12)), "pose": pose})
    return TileArtist(body, rig, pictures), there, pictures, rig


def _decoded(tile: Tile) -> Bytes:
    picture = cv2.imdecode(np.frombuffer(tile.jpeg, np.uint8), cv2.IMREAD_COLOR)
    return np.asarray(picture, np.uint8)


def _near(picture: Bytes, bgr: tuple[int, int, int]) -> int:
    return int((np.abs(picture.astype(int) - bgr).max(axis=2) < 60).sum())


def _draw(scene: tuple[TileArtist, SolvedFrame, Fixed, Rig], look: Look) -> tuple[Tile, ...]:
    return scene[0].draw(scene[1], look)


def test_a_picture_gets_the_model_s_outline(scene: tuple[TileArtist, SolvedFrame, Fixed, Rig]) -> None:
    tiles = _draw(scene, Look("pictures", ALL, None))
    assert [tile.camera for tile in tiles] == list(ALL)
    picture = _decoded(tiles[0])
    assert picture.shape == (240, 320, 3)
    assert _near(picture, (90, 90, 90)) > 0.8 * 320 * 240  # no fill
    redder = picture[..., 2].astype(int) - picture[..., 0]
    assert (redder > 60).sum() > 50  # the left side's outline
    assert (redder < -60).sum() > 50  # the right one's


@pytest.mark.parametrize("content", ["pictures", "silhouettes", "difference"])
@pytest.mark.parametrize("part", ["left_arm", "torso"])
def test_doubtful_parts_are_hatched_as_in_the_overlay(
    scene: tuple[TileArtist, SolvedFrame, Fixed, Rig],
    walk: Take,
    solved: Callable[..., SolvedFrame],
    content: Content,
    part: str,
) -> None:
    artist, shown, _, rig = scene
    marked = SolvedFrame(**{**vars(solved(12, distrusted=(part,))), "pose": shown.pose})
    actor = take_actor(walk)
    assert actor is not None
    expected = ModelPainter(build_body(actor), rig).doubtful(shown.pose, marked.distrusted)
    assert expected is not None
    look = Look(content, ALL, None)
    for plain, hatched in zip(artist.draw(shown, look), artist.draw(marked, look), strict=True):
        where = expected[plain.camera]
        changed = np.abs(_decoded(hatched).astype(int) - _decoded(plain)).max(axis=2) > 60
        near = cv2.dilate(where.astype(np.uint8), np.ones((17, 17))) > 0
        assert not changed[~near].any(), "more than a block of JPEG away"
        assert 0.2 < changed[where].mean() < 0.75, "lines with gaps"
        assert _near(_decoded(hatched), DOUBTFUL_BGR) > 0.15 * where.sum()
        assert hatched.differing_px == plain.differing_px


def test_differences_are_counted_and_coloured(scene: tuple[TileArtist, SolvedFrame, Fixed, Rig]) -> None:
    tiles = _draw(scene, Look("difference", ALL, None))
    assert [tile.differing_px for tile in tiles] == scene[2].differing
    beyond = [_near(_decoded(tile), (255, 0, 255)) for tile in tiles]
    for found, expected in zip(beyond, scene[2].differing, strict=True):
        assert 0.4 * expected < found < 1.5 * expected


def test_a_part_s_window_is_cut_out(scene: tuple[TileArtist, SolvedFrame, Fixed, Rig]) -> None:
    tiles = _draw(scene, Look("silhouettes", (1, 3), "left_arm"))
    assert [tile.camera for tile in tiles] == [1, 3]
    for tile in tiles:
        picture = _decoded(tile)
        assert picture.shape == (320, 320, 3)  # 128x128 at 320 pixels width, enlarged
        assert _near(picture, (0, 94, 243)) > 100
        assert tile.differing_px is not None and tile.differing_px <= scene[2].differing[tile.camera]


def test_what_was_just_drawn_is_not_drawn_again(scene: tuple[TileArtist, SolvedFrame, Fixed, Rig]) -> None:
    look = Look("pictures", (0,), None)
    assert _draw(scene, look) is _draw(scene, look)
    assert _draw(scene, look) is not _draw(scene, Look("pictures", (1,), None))


def test_unsure_pixels_are_no_difference_and_grey(scene: tuple[TileArtist, SolvedFrame, Fixed, Rig]) -> None:
    artist, shown, pictures, _ = scene
    known = pictures.segmented(0, 0)
    assert known is not None
    doubtful = np.full_like(known.trimap, UNSURE)
    pictures.segmented = lambda *_: Segmented(doubtful)  # type: ignore[method-assign]
    (difference,) = artist.draw(shown, Look("difference", (0,), None))
    assert difference.differing_px == 0
    assert _near(_decoded(difference), (255, 0, 255)) == 0
    (silhouettes,) = artist.draw(shown, Look("silhouettes", (0,), None))
    assert _near(_decoded(silhouettes), (UNSURE_GREY,) * 3) > 0.8 * doubtful.size


def test_colour_classes_are_shown_over_a_dark_picture(
    scene: tuple[TileArtist, SolvedFrame, Fixed, Rig],
) -> None:
    for camera, tile in enumerate(_draw(scene, Look("colours", ALL, None, tile_width_px=640))):
        picture, seen = _decoded(tile), scene[2].segmented(camera, 0)
        assert seen is not None and seen.classes is not None
        for number in (1, 7):
            expected = 4 * int((seen.classes == number).sum())
            assert 0.4 * expected < _near(picture, CLASSES_BGR[number - 1]) < 1.2 * expected
        assert _near(picture, (65, 65, 65)) > 2.8 * seen.trimap.size
        assert tile.differing_px == scene[2].differing[camera]


def test_without_classes_the_picture_is_shown(scene: tuple[TileArtist, SolvedFrame, Fixed, Rig]) -> None:
    artist, shown, pictures, _ = scene
    pictures.segmented = lambda *_: None  # type: ignore[method-assign]
    (colours,), (plain,) = (
        artist.draw(shown, Look(content, (2,), None)) for content in ("colours", "pictures")
    )
    assert colours.jpeg == plain.jpeg
    assert (colours.missing, plain.missing) == ("no colour classes of this frame", "")
