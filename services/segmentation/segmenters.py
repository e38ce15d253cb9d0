"""How each segmenter of the table `KINDS` (services/mocap/take/segmenter_name.py) is made.

To add one, add a row there, a class with the method of a Matte, and a line to `_MATTES`. Other packages add
segmenters as entry points of the group `xormocap.segmenters`.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from pathlib import Path
from typing import TypeAlias, TypeVar

import cv2

from services.mocap.camera.camera import Camera
from services.mocap.errors import UserError
from services.mocap.side_by_side import side_by_side
from services.mocap.take.folder import Take
from services.mocap.take.segmenter_name import AUTO as AUTO
from services.mocap.take.segmenter_name import KINDS, USUAL, check_segmenter, kind_of
from services.mocap.take.segmenter_name import READY as READY
from services.segmentation.background import CameraBackground, spread_pictures, warn_of_guesses
from services.segmentation.baselines import PaperTest, TrainedModel
from services.segmentation.chroma import ChromaKey
from services.segmentation.external import OnnxMatte, PluginMatte
from services.segmentation.joint import JointMatte
from services.segmentation.kept_matte import learnt_once
from services.segmentation.kept_trimaps import KeptTrimaps
from services.segmentation.learning import learn_from_take
from services.segmentation.mattes import GroupMatte, Matte, SeparateMattes
from services.segmentation.silhouettes import OwnSilhouettes, Segmenter, VideoSilhouettes

_KEY_PICTURES = 8
"""Number of pictures from which a screen's colour is estimated."""

_Learnt = TypeVar("_Learnt")
PlateCheck: TypeAlias = Callable[[], None]
"""Warns if a recorded clean plate is not clean."""


def _chroma(background: CameraBackground, colour: str) -> Matte:
    if colour:
        red, green, blue = bytes.fromhex(colour)
        return ChromaKey.of_colour((blue, green, red))
    pictures = spread_pictures(background.take, background.camera, _KEY_PICTURES)
    return ChromaKey.of_pictures(pictures)


_MATTES: dict[str, Callable[[CameraBackground, str], Matte]] = {
    "paper": lambda background, _: PaperTest.learn(background.pictures()),
    # Zivkovic 2004.
    "mog2": lambda background, _: TrainedModel(
        cv2.createBackgroundSubtractorMOG2(detectShadows=True), background.pictures()
    ),
    # KaewTraKulPong 2001: the one of bgsegm that can stop learning.
    "bgsegm": lambda background, _: TrainedModel(
        cv2.bgsegm.createBackgroundSubtractorMOG(), background.pictures()
    ),
    "chroma": _chroma,
    "onnx": lambda background, file: OnnxMatte(Path(file), background.mean_picture()),
}
"""From the background and the argument of each of KINDS; all but clean-plate, which is made of all cameras'
plates together."""


def chosen_segmenter(take: Take, name: str = AUTO) -> str:
    """The segmenter for a take: the requested one, or with auto the one that suits the take.

    Raises UserError if there is none of that name, or the take lacks something that it needs.
    """
    check_segmenter(name)
    chosen = name if name != AUTO else READY if take.source == "silhouettes" else USUAL
    if chosen == READY and take.source != "silhouettes":
        raise UserError(
            f"--segmenter {READY}: {take.folder} has no silhouettes: expected silhouettes/ beside videos/"
        )
    if chosen != READY:
        for camera in take.cameras:
            if not take.has_video(camera):
                raise UserError(f"--segmenter {name}: {take.folder} has no video of {camera.name} to work on")
    return chosen


def make_segmenter(
    take: Take,
    cameras: Sequence[Camera],
    name: str = AUTO,
    later: Callable[[PlateCheck], None] = lambda check: check(),
    kept: Path | None = None,
    backgrounds: Mapping[str, CameraBackground] | None = None,
) -> Segmenter:
    """A trained segmenter for some cameras of a take; logs one warning if plates are estimated.

    Cameras of one segmenter help each other; cameras that shall be compared need separate ones. later:
    collects the checks of recorded clean plates, 0.25 s each; by default they run at once. kept: a folder
    with silhouettes that were made before (KeptTrimaps), and with what was learnt for them, which is then
    neither learnt nor checked again. backgrounds: those that may have been learnt before, by camera. Raises
    UserError if there is no segmenter of that name, or the take lacks something that it needs.
    """
    chosen = chosen_segmenter(take, name)
    if chosen == READY:
        return Segmenter(cameras, OwnSilhouettes(take, cameras))
    known = backgrounds or {}
    of_cameras = [known.get(camera.name) or CameraBackground(take, camera) for camera in cameras]
    learn = partial(_matte_of_take, take, cameras, chosen, later, of_cameras)
    matte = cache(learn if kept is None else partial(learnt_once, kept, cameras, learn))
    kept_trimaps = None if kept is None else KeptTrimaps(kept, cameras)
    if kept_trimaps is None or not kept_trimaps.has_all(take.settings.frames):
        matte()
    return Segmenter(cameras, VideoSilhouettes(take, cameras, matte, kept_trimaps))


def _matte_of_take(
    take: Take,
    cameras: Sequence[Camera],
    name: str,
    later: Callable[[PlateCheck], None],
    backgrounds: Sequence[CameraBackground],
) -> GroupMatte:
    """What a segmenter learns of a take with videos; as make_segmenter."""
    matte = _group_matte(backgrounds, name)
    if isinstance(matte, JointMatte):
        learn_from_take(matte, take, cameras)
    if kind_of(name).needs_plate:
        for background in backgrounds:
            if background.is_recorded:
                later(background.check)
        unsure_shares = {b.camera.name: b.made.unsure_share for b in backgrounds if not b.is_recorded}
        if unsure_shares:
            warn_of_guesses(take, unsure_shares)
    return matte


def live_matte(take: Take, cameras: Sequence[Camera], name: str = AUTO) -> GroupMatte:
    """The matte for live pictures of some cameras, whose empty stage is known.

    Raises UserError if there is none of that name, or it needs more than pictures of the empty stage.
    """
    check_segmenter(name)
    chosen = USUAL if name == AUTO else name
    if chosen == READY:
        raise UserError(f"--segmenter {name}: live cameras give pictures: leave it out, or choose another")
    if chosen == "chroma":
        raise UserError(f"--segmenter {name}: live, the screen's colour must be given: chroma:RRGGBB")
    return _group_matte([CameraBackground(take, camera) for camera in cameras], chosen)


def _group_matte(backgrounds: Sequence[CameraBackground], name: str) -> GroupMatte:
    """What a segmenter makes for some cameras; a UserError names the camera."""
    kind, _, argument = name.partition(":")
    row, cameras = KINDS.get(kind), [background.camera for background in backgrounds]

    def learnt(learn: Callable[[CameraBackground], _Learnt]) -> list[_Learnt]:
        """What is learnt of each camera."""

        def of_camera(background: CameraBackground) -> _Learnt:
            try:
                return learn(background)
            except UserError as error:
                if row is None or argument:  # says itself what it is about
                    raise
                what = "clean plate of " if row.needs_plate else ""
                where = f"{background.take.folder}: {what}{background.camera.name}"
                raise UserError(f"{where}: {error}") from None

        # Else in the cameras' order: estimates hold many pictures in memory.
        if kind == USUAL and all(background.is_recorded for background in backgrounds):
            return side_by_side(of_camera, backgrounds)
        return [of_camera(background) for background in backgrounds]

    if row is None:
        return SeparateMattes(cameras, learnt(lambda b: PluginMatte(kind, b.camera, b.mean_picture())))
    if kind == USUAL:
        return JointMatte(cameras, learnt(CameraBackground.plate))
    return SeparateMattes(cameras, learnt(lambda background: _MATTES[kind](background, argument)))
