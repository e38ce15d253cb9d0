"""The table of segmenters: what `--segmenter NAME` may say, and what each is made of.

Others come in from outside, as entry points of the group `xormocap.segmenters`.
"""

from collections.abc import Callable, Sequence
from functools import partial
from importlib.metadata import entry_points
from pathlib import Path
from typing import NamedTuple, TypeAlias, TypeVar

from services.mocap.camera.camera import Camera
from services.mocap.errors import UserError, nearest
from services.mocap.take.folder import Take
from services.mocap.take.segmenter_name import AUTO as AUTO
from services.mocap.take.segmenter_name import GROUP as GROUP
from services.mocap.take.segmenter_name import READY as READY
from services.segmentation import opencv_models
from services.segmentation.chroma import ChromaKey
from services.segmentation.cleanup import SegmentationSettings
from services.segmentation.foreign import ForeignMatte
from services.segmentation.joint import JointSegmenter
from services.segmentation.learning import learn_from_take
from services.segmentation.mattes import Matte, MatteGroup
from services.segmentation.onnx_matte import OnnxMatte
from services.segmentation.paper_test import PaperTest
from services.segmentation.samples import spread_pictures
from services.segmentation.scene import Scene, check_plate, learn_plate, warn_of_guesses
from services.segmentation.source import JointMatte, ReadySegmenter, Segmenter, VideoSegmenter

_Made = TypeVar("_Made")

USUAL = "clean-plate"
_KEY_PICTURES = 8
"""From which a screen's colour is estimated."""

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
            later(partial(check_plate, scene))
        unsure_shares = {s.camera.name: s.unsure_share for s in scenes if not s.is_recorded}
        if unsure_shares:
            warn_of_guesses(take, unsure_shares)
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
        plates = [_with_place(scene, kind, partial(learn_plate, scene)) for scene in scenes]
        return JointSegmenter(cameras, plates, scenes[0].settings)
    return MatteGroup(cameras, [_matte(scene, kind, argument) for scene in scenes])


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
