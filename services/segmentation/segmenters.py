"""The table of segmenters: what `--segmenter NAME` may say, and what each is made of.

Others come in from outside, as entry points of the group `xormocap.segmenters`.
"""

import logging
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from importlib.metadata import entry_points
from pathlib import Path
from typing import NamedTuple, TypeAlias, TypeVar

import numpy as np

from services.mocap.camera.camera import Camera
from services.mocap.errors import UserError, nearest
from services.mocap.take.folder import Take
from services.mocap.take.segmenter_name import AUTO as AUTO
from services.mocap.take.segmenter_name import GROUP as GROUP
from services.mocap.take.segmenter_name import READY as READY
from services.mocap.types import Bytes
from services.segmentation import opencv_models
from services.segmentation.chroma import ChromaKey
from services.segmentation.cleanup import SegmentationSettings
from services.segmentation.foreign import ForeignMatte
from services.segmentation.ghosts import LOOKS, find_ghost
from services.segmentation.joint import JointSegmenter
from services.segmentation.learning import learn_from_take
from services.segmentation.mattes import Matte, MatteGroup
from services.segmentation.onnx_matte import OnnxMatte
from services.segmentation.paper_test import PaperTest
from services.segmentation.plate import Plate
from services.segmentation.plate_shift import plate_shift_px, shifted
from services.segmentation.samples import KeptLooks, quick_looks, spread_pictures
from services.segmentation.source import (
    JointMatte,
    ReadySegmenter,
    Segmenter,
    VideoSegmenter,
)
from services.segmentation.take_plate import SAMPLES, TakePlate, plate_of_samples
from services.segmentation.view import LIGHT_UNCERTAINTY

log = logging.getLogger(__name__)

_Made = TypeVar("_Made")

USUAL = "clean-plate"
_UNSURE = 0.1
"""Of the part where anything moves; with more in doubt the actor is likely to be part of the plate."""
_KEY_PICTURES = 8
"""From which a screen's colour is estimated."""


@dataclass(frozen=True, eq=False)
class Scene:
    """What there is to learn one camera's background from."""

    take: Take
    camera: Camera
    settings: SegmentationSettings
    looks: KeptLooks = field(default_factory=lambda: KeptLooks(LOOKS))
    """At the recorded clean plate, once it was learnt."""

    @property
    def is_recorded(self) -> bool:
        """Whether the take has a clean plate of this camera."""
        return self.take.has_background(self.camera)

    @cached_property
    def unsure_share(self) -> float:
        """Of the part in which anything moves, what a plate made of the take does not tell for sure."""
        return self._made.unsure_share

    def plate(self) -> Iterable[Bytes]:
        """Pictures (H, W, 3) of the empty scene: the clean plate, or what the take itself tells of it."""
        return self.looks.of(self.take.background(self.camera)) if self.is_recorded else self._made.frames

    def plate_picture(self) -> Bytes | None:
        """The recorded clean plate as one picture (H, W, 3); None without one."""
        if not self.is_recorded:
            return None
        total, count = np.zeros(1), 0
        for picture in self.take.background(self.camera):
            total, count = total + picture, count + 1
        mean: Bytes = np.rint(total / max(count, 1)).astype(np.uint8)
        return mean

    @property
    def shift_px(self) -> tuple[float, float]:
        """How far to the right and down a recorded clean plate has to move to lie on the take's first
        picture."""
        if not self.is_recorded or not self.take.has_video(self.camera):
            return 0.0, 0.0
        with self.take.video(self.camera, 0, 1) as video:
            first = next(iter(video), None)
        plate = next(iter(self.take.background(self.camera)), None)
        if first is None or plate is None or first.shape != plate.shape:
            return 0.0, 0.0
        return plate_shift_px(plate, first)

    @cached_property
    def _made(self) -> TakePlate:
        return plate_of_samples(spread_pictures(self.take, self.camera, SAMPLES))


PlateCheck: TypeAlias = Callable[[], None]
"""Warns of a recorded clean plate that is not clean."""


class Kind(NamedTuple):
    """A row of the table."""

    make: Callable[[Scene, str], Matte] | None
    """Takes the scene and what stands after the colon of `NAME:ARGUMENT`, "" for nothing; None: made of all
    cameras' plates together."""
    argument: str
    """What may stand there, for messages; "" for nothing."""
    needs_argument: bool
    needs_plate: bool
    """Whether the empty scene has to be known."""


def _chroma(scene: Scene, colour: str) -> Matte:
    if colour:
        red, green, blue = bytes.fromhex(colour)
        return ChromaKey.of_colour((blue, green, red), scene.settings)
    return ChromaKey.of_pictures(spread_pictures(scene.take, scene.camera, _KEY_PICTURES), scene.settings)


KINDS: dict[str, Kind] = {
    USUAL: Kind(None, "", False, True),
    "paper": Kind(lambda scene, _: PaperTest.learn(scene.plate(), scene.settings), "", False, True),
    "mog2": Kind(lambda scene, _: opencv_models.mog2(scene.plate(), scene.settings), "", False, True),
    "bgsegm": Kind(lambda scene, _: opencv_models.bgsegm(scene.plate(), scene.settings), "", False, True),
    "chroma": Kind(_chroma, "RRGGBB", False, False),
    "onnx": Kind(
        lambda scene, file: OnnxMatte(Path(file), scene.plate_picture(), scene.settings), "FILE", True, False
    ),
}


def known_segmenters() -> list[str]:
    """Names that --segmenter takes here, those of installed plug-ins last."""
    return [AUTO, READY, *KINDS, *sorted(entry_points(group=GROUP).names)]


def check_segmenter(name: str) -> None:
    """Raise UserError, in one sentence, for what --segmenter cannot mean."""
    kind, colon, argument = name.partition(":")
    if kind not in known_segmenters():
        raise UserError(
            f"--segmenter {name}: there is no such segmenter: {nearest(kind, known_segmenters())}"
        )
    expected, needed = (KINDS[kind].argument, KINDS[kind].needs_argument) if kind in KINDS else ("", False)
    if colon and not expected:
        raise UserError(f"--segmenter {name}: {kind} takes nothing after its name: leave out :{argument}")
    if needed and not argument:
        raise UserError(f"--segmenter {name}: expected {kind}:{expected}")
    if kind == "chroma" and colon and not _is_colour(argument):
        raise UserError(f"--segmenter {name}: expected chroma:RRGGBB in hexadecimal, such as chroma:00b140")


def _is_colour(text: str) -> bool:
    return len(text) == 6 and all(digit in "0123456789abcdefABCDEF" for digit in text)


def chosen_segmenter(take: Take, name: str = AUTO) -> str:
    """The segmenter for a take: the one asked for, or with auto the one that suits what the take has.

    Raises UserError where there is none of that name, or the take lacks what it needs.
    """
    check_segmenter(name)
    chosen = name if name != AUTO else READY if take.source == "silhouettes" else USUAL
    if chosen == READY and take.source != "silhouettes":
        raise UserError(f"--segmenter {READY}: {take.folder} has none: expected silhouettes/ beside videos/")
    if chosen != READY:
        for camera in take.cameras:
            if not take.has_video(camera):
                raise UserError(f"--segmenter {name}: {take.folder} has no video of {camera.name} to work on")
    return chosen


def make_segmenter(
    take: Take,
    cameras: Sequence[Camera],
    settings: SegmentationSettings,
    name: str = AUTO,
    later: Callable[[PlateCheck], None] = lambda check: check(),
) -> Segmenter:
    """A segmenter for some cameras of a take, trained; logs one warning where a plate is a guess.

    Cameras of one segmenter help each other; those that are to be compared get one each. later: gets what
    checks each recorded clean plate, a quarter of a second each; by default it is done at once. Raises
    UserError where there is none of that name, or the take lacks what it needs.
    """
    chosen = chosen_segmenter(take, name)
    if chosen == READY:
        return ReadySegmenter(take, cameras)
    kind, _, argument = chosen.partition(":")
    scenes = [Scene(take, camera, settings) for camera in cameras]
    matte = _joint_matte(scenes, kind, argument)
    if isinstance(matte, JointSegmenter):
        learn_from_take(matte, take, cameras)
    if kind in KINDS and KINDS[kind].needs_plate:
        recorded = [scene for scene in scenes if scene.is_recorded]
        for scene in recorded:
            later(partial(_check_plate, take, scene.camera, scene.looks.pictures))
        unsure_shares = {s.camera.name: s.unsure_share for s in scenes if not s.is_recorded}
        if unsure_shares:
            _warn_of_guesses(take, unsure_shares)
    return VideoSegmenter(take, cameras, matte)


def live_matte(
    take: Take, cameras: Sequence[Camera], settings: SegmentationSettings, name: str = AUTO
) -> JointMatte:
    """What cuts the actor out of live pictures of some cameras, whose empty stage the take knows.

    Raises UserError where there is nothing of that name, or it needs more than pictures of the empty stage.
    """
    check_segmenter(name)
    chosen = USUAL if name == AUTO else name
    kind, _, argument = chosen.partition(":")
    if kind == READY:
        raise UserError(f"--segmenter {name}: live cameras give pictures: leave it out, or choose another")
    if kind == "chroma" and not argument:
        raise UserError(f"--segmenter {name}: live, the screen's colour has to be said: chroma:RRGGBB")
    return _joint_matte([Scene(take, camera, settings) for camera in cameras], kind, argument)


def _joint_matte(scenes: Sequence[Scene], kind: str, argument: str) -> JointSegmenter | MatteGroup:
    cameras = [scene.camera for scene in scenes]
    if kind in KINDS and KINDS[kind].make is None:
        plates = [_with_place(scene, kind, partial(_plate, scene)) for scene in scenes]
        return JointSegmenter(cameras, plates, scenes[0].settings)
    return MatteGroup(cameras, [_matte(scene, kind, argument) for scene in scenes])


def _plate(scene: Scene) -> Plate:
    """A camera's plate, moved to where its pictures are if the camera was touched since."""
    shift_px = scene.shift_px
    if shift_px != (0.0, 0.0):
        log.warning(
            "%s/background: clean plate of %s lies %.1f px beside the pictures and was moved: the camera was "
            "touched since, so record the empty stage again, and check the calibration "
            "(xormocap calibrate --check)",
            scene.take.folder, scene.camera.name, float(np.hypot(*shift_px)),
        )  # fmt: skip
    return Plate.learn(shifted(scene.plate(), shift_px), scene.settings, LIGHT_UNCERTAINTY)


def _matte(scene: Scene, kind: str, argument: str) -> Matte:
    make = KINDS[kind].make if kind in KINDS else None
    if make is None:
        return ForeignMatte(kind, scene.camera, scene.plate_picture(), GROUP)
    if kind == "onnx" or argument:
        return make(scene, argument)
    return _with_place(scene, kind, partial(make, scene, argument))


def _with_place(scene: Scene, kind: str, make: Callable[[], _Made]) -> _Made:
    """What is made of a camera's pictures; a UserError says whose they were."""
    try:
        return make()
    except UserError as error:
        what = "clean plate of " if KINDS[kind].needs_plate else ""
        raise UserError(f"{scene.take.folder}: {what}{scene.camera.name}: {error}") from None


def _check_plate(take: Take, camera: Camera, looks: Bytes) -> None:
    """Warn of a recorded clean plate that is not clean; looks (N, h, w, 3): small copies of its pictures."""
    ghost = find_ghost(looks, quick_looks(take, camera, LOOKS))
    if ghost is None:
        return
    what = "something moves in it" if ghost.moves else "shows something that is in no frame of the take"
    log.warning(
        "%s/background: clean plate of %s: %s (%.1f%% of the picture, about column %d, row %d), which spoils "
        "the silhouettes: record the empty stage with nobody in it",
        take.folder, camera.name, what, 100 * ghost.share, *ghost.centre_px(camera.width_px),
    )  # fmt: skip


def _warn_of_guesses(take: Take, unsure_shares: dict[str, float]) -> None:
    """Say how far plates made of the take can be trusted, by the worst of the cameras."""
    worst = max(unsure_shares, key=lambda name: unsure_shares[name])
    log.warning(
        "%s/background: is missing: the empty scene was taken from the videos themselves; in %s, the worst, "
        "%.1f%% of the part where anything moves shows it in fewer than half of %d frames%s: record the "
        "empty stage",
        take.folder, worst, 100 * unsure_shares[worst], min(SAMPLES, take.settings.frames),
        ", so that the actor hardly leaves the place and silhouettes will be wrong there"
        if unsure_shares[worst] > _UNSURE
        else " and cannot be trusted",
    )  # fmt: skip
