"""What is learnt of a take, and of live pictures: the same whoever asks, and no more often than needed."""

import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest

from services.mocap.camera.camera import Camera
from services.mocap.take.folder import Take, open_take
from services.mocap.types import ACTOR, Bytes, Mask
from services.segmentation import learning
from services.segmentation.joint import JointMatte
from services.segmentation.learning import LiveLearner, learn_from_take
from services.segmentation.segmenters import make_segmenter
from services.segmentation.silhouettes import pictures_of

SmallTake = Callable[..., Path]
Ball = Callable[[Camera, int], Mask]


@pytest.mark.parametrize("n_cameras", [1, 2, 4])
@pytest.mark.parametrize("has_plate", [True, False])
def test_two_segmenters_of_a_take_agree_wherever_they_begin(
    small_take: SmallTake, ball_silhouette: Ball, n_cameras: int, has_plate: bool
) -> None:
    folder = small_take(n_cameras=n_cameras, frames=18)
    if not has_plate:
        shutil.rmtree(folder / "background")
    take = open_take(folder)
    through = list(make_segmenter(take, take.cameras).trimaps(0, 18))
    other = make_segmenter(open_take(folder), take.cameras)
    for start in (11, 0, 17):
        for frame, trimaps in enumerate(other.trimaps(start, 18), start):
            for found, expected in zip(trimaps, through[frame], strict=True):
                np.testing.assert_array_equal(found, expected)
    for frame in (0, 9) if has_plate else ():
        for camera, trimap in zip(take.cameras, through[frame], strict=True):
            true = ball_silhouette(camera, frame)
            assert ((trimap == ACTOR) & true).sum() > 0.5 * ((trimap == ACTOR) | true).sum()


class Pupil(JointMatte):
    """Notes what it is asked to do."""

    def __init__(self) -> None:
        self.done: list[str] = []
        self.seen: list[Mapping[int, Bytes]] = []
        self.measured = self.floor_moments = 0
        """Moments in which a codec's errors were measured."""
        self.has_moved = False

    def allow_for_errors(self, moments: Iterable[Mapping[int, Bytes]]) -> None:
        self.measured += len(list(moments))

    def learn(self, images_bgr: Mapping[int, Bytes]) -> None:
        self.done.append("learn")
        self.seen.append(images_bgr)

    def conclude(self) -> None:
        self.done.append("conclude")

    def shifts_px(self, images_bgr: Mapping[int, Bytes]) -> list[float]:
        return [0.0 for _ in images_bgr]

    @property
    def moved(self) -> list[Mask]:
        return [np.full((2, 2), self.has_moved)] * 2

    def settle_floor(self, moments: Sequence[Mapping[int, Bytes]]) -> None:
        self.done += ["floor"] * bool(moments)
        self.floor_moments = len(moments)


@pytest.mark.parametrize("frames", [1, 4, 11, 40, 200])
def test_a_take_is_looked_at_here_and_there(
    small_take: SmallTake, monkeypatch: pytest.MonkeyPatch, frames: int
) -> None:
    take = open_take(small_take(frames=frames))
    pupil, decoded = Pupil(), list[int]()

    def counted(take: Take, cameras: Sequence[Camera], start: int, stop: int) -> Iterator[dict[int, Bytes]]:
        for images in pictures_of(take, cameras, start, stop):
            decoded.append(len(images))
            yield images

    monkeypatch.setattr(learning, "pictures_of", counted)
    learn_from_take(pupil, take, take.cameras)
    assert pupil.done[0] == "floor"
    assert pupil.done[-1] == "conclude"
    assert pupil.measured == pupil.floor_moments > 0
    learnt = pupil.done.count("learn")
    assert min(frames, 10) <= learnt <= max(16, min(frames, 24))
    assert all(sorted(images) == [0, 1] for images in pupil.seen)
    assert len(decoded) <= 2 * 56  # once for the floor, and once to learn
    with take.video(take.cameras[1]) as video:
        first = next(iter(video))
    np.testing.assert_array_equal(pupil.seen[0][1], first)


def test_live_pictures_teach_ever_more_rarely() -> None:
    pupil = Pupil()
    learner = LiveLearner(pupil, ["cam01", "cam02"])
    at_shots = list[int]()
    images = {0: np.zeros((2, 2, 3), np.uint8)}
    for shot in range(2000):
        before = pupil.done.count("learn")
        learner.see(images)
        if pupil.done.count("learn") > before:
            at_shots.append(shot)
    assert pupil.done[:2] == ["learn", "conclude"]  # it helps from the first on
    apart = np.diff(at_shots)
    assert (np.diff(apart) >= 0).all()
    assert apart[0] * 10 == apart[-1]
    assert pupil.measured == pupil.done.count("conclude")
    assert pupil.done.count("learn") / 7 < pupil.done.count("conclude") < pupil.done.count("learn") / 5


def test_an_object_that_was_moved_is_told_once(caplog: pytest.LogCaptureFixture) -> None:
    pupil = Pupil()
    learner = LiveLearner(pupil, ["cam01", "cam02"])
    for shot in range(200):
        pupil.has_moved = shot > 50
        learner.see({0: np.zeros((2, 2, 3), np.uint8)})
    (told,) = caplog.messages
    assert "cam01 near column 0, row 0, 100.0% of the picture; cam02 near" in told


def test_what_a_video_shows_at_a_moment_comes_together(small_take: SmallTake) -> None:
    take = open_take(small_take(n_cameras=3, frames=6))
    for frame, images in enumerate(pictures_of(take, take.cameras, 2, 6), 2):
        for c, camera in enumerate(take.cameras):
            with take.video(camera, frame, frame + 1) as video:
                np.testing.assert_array_equal(images[c], next(iter(video)))
