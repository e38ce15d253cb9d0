"""The checks of a take before it is fitted or tracked, which take seconds: their option, what they print."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Annotated, TypeAlias

import typer

from services.commands.consoles import progress_bar, warn
from services.mocap.calibration.epipolar_tangents import Outlines
from services.mocap.calibration.mistake import Mistake
from services.mocap.calibration.mistakes import mistakes_in, wrong_up
from services.mocap.calibration.silhouette_faults import silhouette_faults
from services.mocap.camera.camera import Camera
from services.mocap.energy.bitplanes import FULL_SHARE
from services.mocap.errors import CertainError, TakeError
from services.mocap.sampling import evenly
from services.mocap.search.plausibility import white_all_over
from services.mocap.take.folder import Take
from services.mocap.take.layout import BACKGROUND
from services.mocap.take.segmenter_name import kind_of
from services.mocap.types import ACTOR, Mask
from services.mocap.verdict.verdict import Cause, Level
from services.runs.outlines import outlines_of
from services.runs.reporting import kept_warnings
from services.runs.take_silhouettes import TakeSilhouettes, trimaps_of
from services.segmentation.foreign_plates import foreign_plates
from services.segmentation.segmenters import PlateCheck, chosen_segmenter, make_segmenter
from services.segmentation.silhouettes import Segmenter

CheckOption: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--check/--no-check",
        help="Look for mistakes in calibration and silhouettes before the work, and where the actor comes "
        "into view.",
    ),
]

_MOST_FRAMES, _FEWEST_FRAMES = 60, 12
_MOST_PX = 40 * 4 * 640 * 480
"""Pixels of videos that are segmented, in all cameras and frames together."""
_FRAMES_FOR_FEET = 5


def check_files(silhouettes: TakeSilhouettes) -> None:
    """Raise TakeError for what is wrong before anything is segmented: `up`, and plates of other cameras."""
    take = silhouettes.take
    if (turned := wrong_up(take.cameras, take.settings.up)) is not None:
        raise _refused(take, turned)
    has_plates = kind_of(chosen_segmenter(take, silhouettes.name)).needs_plate
    if has_plates and (foreign := foreign_plates(take)):
        exchanged = {name: other for name, other in foreign.items() if name != other}
        shown = [f"that of {name} shows what the video of {other} does" for name, other in exchanged.items()]
        shown += [f"that of {name} shows its video upside down" for name in foreign if name not in exchanged]
        remedies = ["exchange these videos, or the files of the plates"] if exchanged else []
        remedies += [] if foreign == exchanged else ["turn the video or the plate (ffmpeg -vf hflip,vflip)"]
        what = f"clean plates: {', '.join(shown)}"
        raise _refused(take, Mistake(f"{BACKGROUND}/", what, "; ".join(remedies)))


@dataclass(frozen=True, eq=False)
class Comparison:
    """What comparing the cameras, each of them segmented alone, has shown in some first frames."""

    frames: range
    cameras: tuple[Camera, ...]
    outlines: Outlines
    mistakes: list[Mistake]
    """None of them certain."""


def compare_cameras(silhouettes: TakeSilhouettes, frames: range) -> Comparison | None:
    """Compare a take's cameras before anything is learnt of all of them together, which takes longer.

    None if there is nothing to compare. Raises TakeError where it is certain that the take cannot be tracked.
    """
    if len(silhouettes.take.cameras) < 2 or not silhouettes.has_stage:
        return None
    with progress_bar() as show:
        found = _compared(
            silhouettes, _first_of(silhouettes, frames), lambda share: show("comparing the cameras", share)
        )
        show("cameras compared", 1.0)
    return found


def look_before(silhouettes: TakeSilhouettes, frames: range, before: Comparison | None) -> tuple[Cause, ...]:
    """Check a take, as far as its first frames tell, and print what is wrong; before: see compare_cameras.

    Raises TakeError where it is certain that the take cannot be tracked.
    """
    with progress_bar() as show:
        found = tuple(_causes(silhouettes, frames, before, lambda share: show("checking the take", share)))
        show("take checked", 1.0)
    warn(map(str, found))
    return found


def _first_of(silhouettes: TakeSilhouettes, frames: range) -> range:
    """Those of the frames in which the cameras are compared."""
    n_frames = _MOST_FRAMES
    if not silhouettes.are_ready:
        each_px = sum(camera.width_px * camera.height_px for camera in silhouettes.take.calibrated)
        n_frames = min(max(_MOST_PX // each_px, _FEWEST_FRAMES), _MOST_FRAMES)
    return range(frames.start, min(frames.stop, frames.start + n_frames))


def _compared(
    silhouettes: TakeSilhouettes,
    frames: range,
    progress: Callable[[float], None],
    moved: Mapping[str, Mask] | None = None,
) -> Comparison:
    """Compare the cameras; raises TakeError where it is certain that the take cannot be tracked.

    moved: by camera the pixels (h, w) of a moved object (SilhouetteSource.moved), which one camera alone
    takes for the actor; they are unsure.
    """
    take, plate_checks = silhouettes.take, list[PlateCheck]()

    def segmenter_of(camera: Camera) -> Segmenter:
        known = silhouettes.backgrounds
        made = make_segmenter(take, [camera], silhouettes.name, plate_checks.append, backgrounds=known)
        return made.knowing(moved or {})

    with kept_warnings() as warnings:
        cameras, outlines, middle = outlines_of(take, frames, progress, segmenter_of)
        parts = (middle[c, : one.height_px, : one.width_px] for c, one in enumerate(cameras))
        n_white = sum((part == ACTOR).mean() > FULL_SHARE for part in parts)
        if 2 * n_white > len(cameras):
            raise white_all_over(n_white, len(cameras), f"frame {frames[len(frames) // 2]}")
        found = mistakes_in(cameras, outlines, take.settings.up, take.folder, frames)
        certain = [mistake for mistake in found if mistake.is_certain]
        if certain:
            for check in plate_checks:
                check()
    if certain:
        # The cameras are segmented side by side, in any order.
        raise _refused(take, certain[0], [*silhouettes.said, *sorted(warnings)])
    return Comparison(frames, cameras, outlines, found)


def _causes(
    silhouettes: TakeSilhouettes,
    frames: range,
    before: Comparison | None,
    progress: Callable[[float], None],
) -> Iterator[Cause]:
    take = silhouettes.take
    if not silhouettes.has_stage:
        if kind_of(chosen_segmenter(take, silhouettes.name)).needs_plate:
            yield Cause(
                what=f"{BACKGROUND}/: there is no picture of the empty stage; it is estimated from the "
                "videos, and silhouettes will be wrong where the actor stays",
                remedy=f"record the empty stage for a second into {BACKGROUND}/<camera>.mp4",
                level="good",
            )
        return  # what is estimated from the videos is no proof of anything
    if len(take.cameras) < 2:
        return
    compared, first, moved = before, _first_of(silhouettes, frames), silhouettes.segmenter.source.moved()
    if compared is None or compared.frames != first or moved:
        compared = _compared(silhouettes, first, progress, moved)
    yield from map(_remark, silhouettes.remarks)
    # One camera alone is segmented less well than all together, but equally well in all frames.
    yield from (
        _cause_of(mistake)
        for mistake in compared.mistakes
        if silhouettes.are_ready or mistake.is_out_of_step or mistake.is_change
    )
    if not any(mistake.is_change for mistake in compared.mistakes):
        some = [compared.frames[k] for k in evenly(len(compared.frames), _FRAMES_FOR_FEET)]
        segmenter = silhouettes.segmenter
        together = trimaps_of(take, some, segmenter, lambda _: None)
        faults = silhouette_faults(compared.cameras, compared.outlines, together, segmenter.source.moved())
        yield from map(_cause_of, faults)


def _cause_of(mistake: Mistake) -> Cause:
    level: Level = "usable with gaps" if mistake.is_out_of_step else "good"
    return Cause(what=f"{mistake.file}: {mistake.what}", remedy=mistake.remedy, level=level)


def _remark(warning: str) -> Cause:
    """A warning of the segmentation, which may end in its remedy."""
    what, _, remedy = warning.rpartition(": ")
    return Cause(what=what or warning, remedy=remedy if what else "", level="good")


def _refused(take: Take, mistake: Mistake, warnings: Sequence[str] = ()) -> TakeError:
    """warnings: of the silhouettes that show the mistake; the first one is named before it."""
    spoilt = f"{warnings[0]}; with these silhouettes, " if warnings else ""
    return TakeError(f"{spoilt}{take.folder}/{mistake} (--no-check goes on nevertheless)")


@contextmanager
def blamed_first(checks: Sequence[Cause]) -> Iterator[None]:
    """Make a TakeError of the block, unless its reason is certain, tell first what the checks have found, as
    the likelier cause."""
    try:
        yield
    except CertainError:
        raise
    except TakeError as problem:
        if not checks:
            raise
        raise TakeError(f"{checks[0]}; this led to: {problem}") from None


def not_told(warnings: Sequence[str], checks: Sequence[Cause]) -> list[str]:
    """The warnings that the checks have not printed, each once."""
    told = {str(cause) for cause in checks}
    return [sentence for sentence in dict.fromkeys(warnings) if sentence not in told]
