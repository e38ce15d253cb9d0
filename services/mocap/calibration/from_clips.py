"""From a folder of board clips to calibrated cameras."""

from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from services.mocap.calibration.board import Board
from services.mocap.calibration.clips import INTRINSICS, ORIGIN, Clip, check_sizes, find_clips, spread_numbers
from services.mocap.calibration.detection import Detector, look_through, upright_print
from services.mocap.calibration.diagnosis import check_prints, check_same_pictures, wrong_markers
from services.mocap.calibration.known_lenses import check_lens_sizes
from services.mocap.calibration.lens import Intrinsics, Lens
from services.mocap.calibration.rig_solving import ORIGIN_FRAME, Show, Solution, solve_rig
from services.mocap.calibration.sightings import Sighting, Sightings, is_usable
from services.mocap.errors import CalibrationError
from services.mocap.take.video_checks import unsteady_remarks
from services.mocap.take.video_index import index_video

_MOST_LOOKED_AT = 300
"""Number of pictures in which the board is searched; of longer clips every second, third and so on."""
_MOST_OF_ORIGIN = 30
_STILL_PX = 2.0
"""Allowed movement of a corner while the board lies at the origin."""
_LOOKING_SHARE = 0.6
_FIRST_SAMPLES = 6
"""Pictures of each clip in which a board with markers, or another one, is searched before all others."""


def check_clips(folder: Path, level: str | None, *, needs_origin: bool) -> list[str]:
    """Remarks on a folder of clips (see clips.py) in which nothing was looked for yet.

    level: see solve_rig. needs_origin: whether the origin's place matters. Raises CalibrationError with what
    is missing or wrong, and what to do about it.
    """
    names = [clip.camera for clip in find_clips(folder)]
    if len(names) < 2:
        raise CalibrationError(
            f"{folder}: has clips of {len(names)} cameras: expected <camera>.mp4, or a folder <camera> of "
            "pictures, for two cameras or more"
        )
    if level is not None and level not in names:
        raise CalibrationError(
            f"--level {level}: is no camera of {folder}: expected one of {', '.join(names)}"
        )
    check_sizes(folder)
    remarks = unsteady_remarks([index_video(clip.path) for clip in find_clips(folder) if clip.is_video])
    if not needs_origin:
        return remarks
    there = find_clips(folder / ORIGIN)
    if not there:
        return [
            *remarks,
            f"{folder / ORIGIN}: has no clip: the world's origin is where the board was seen first, not on "
            f"the floor, and up is up in the pictures of {level or 'all cameras on average'}: record a clip "
            "or a picture <camera>.png of the board lying on the floor"
            f"{'' if level else ', or name a level camera (--level)'}",
        ]
    if not any(clip.camera in names for clip in there):
        raise CalibrationError(
            f"{folder / ORIGIN}: {there[0].path.name} belongs to no camera: expected one of "
            f"{', '.join(names)}"
        )
    return remarks


def calibrate_clips(
    folder: Path,
    board: Board,
    lens: Lens,
    show: Show,
    known: Mapping[str, Intrinsics] | None = None,
    level: str | None = None,
    *,
    needs_origin: bool = True,
) -> tuple[Solution, list[str]]:
    """Calibrate the cameras of a folder of clips, checked by check_clips, by a board; also remarks.

    known: lenses by camera, which are held. level, needs_origin: see check_clips.

    Raises CalibrationError with what is missing or wrong, and what to do about it.
    """
    clips, remarks = find_clips(folder), []
    check_lens_sizes(known or {}, {clip.camera: clip.size_px() for clip in clips})
    if board.has_markers:
        show("looking at samples", 0.0)
        printed = _as_printed(board, clips)
        if printed.inverted and not board.inverted:
            remarks.append("the board is printed white on black (inverted = true)")
        board = printed
    detector, seen, moments = Detector(board), [], spread_numbers(clips, _MOST_LOOKED_AT)
    for c, clip in enumerate(clips):
        show(f"searching the board: {clip.camera}", _LOOKING_SHARE * c / len(clips))
        seen.append(_sightings(clip, moments, folder, detector, c, len(clips)))
    check_prints(list(zip(clips, seen, strict=True)), board)
    check_same_pictures(seen)
    remarks += [
        f"{s.camera}: saw the back of the board, as one printed on both sides has it"
        for s in seen
        if s.is_behind
    ]
    is_placed = any(ORIGIN_FRAME in sightings.by_frame for sightings in seen)
    if needs_origin and not is_placed and find_clips(folder / ORIGIN):
        raise CalibrationError(
            f"{folder / ORIGIN}: {board.in_words()} was not found in it: show it larger, evenly lit and whole"
        )

    def show_solving(what: str, share: float) -> None:
        show(what, _LOOKING_SHARE + (1 - _LOOKING_SHARE) * share)

    solution = solve_rig(seen, board, lens, show_solving, known, level)
    return replace(solution, pictures=tuple(sightings.best_picture for sightings in seen)), remarks


def _as_printed(board: Board, clips: list[Clip]) -> Board:
    """A board with markers, inverted or not as it is found in samples of the clips; as given if in none.

    Raises CalibrationError if it is in none, and another board is.
    """
    ways = (False, True) if board.inverted is None else (board.inverted,)
    prints = [board.model_copy(update={"inverted": way}) for way in ways]
    looked_at = []
    for clip in clips:
        samples = [picture for _, picture in clip.samples(_FIRST_SAMPLES)]
        for printed in prints:
            if any(Detector(printed).find(picture) for picture in samples):
                return printed
        looked_at.append((clip, [upright_print(picture, board) for picture in samples]))
    for clip, samples in looked_at:
        problem = wrong_markers(samples, board)
        if problem is not None:
            raise CalibrationError(f"{clip.path}: {problem}")
    return board


def _sightings(
    clip: Clip, moments: Collection[int], folder: Path, detector: Detector, camera: int, n_cameras: int
) -> Sightings:
    """All that a camera saw: of its clip in some moments, of its own clip for the lens, and of the origin.

    Moments of its own clip have negative numbers, which no other camera has: the board was elsewhere in those
    of the others.
    """

    seen = look_through(clip.camera, clip.pictures(moments), detector)
    by_frame = dict(seen.by_frame)
    for kind, most in ((INTRINSICS, _MOST_LOOKED_AT), (ORIGIN, _MOST_OF_ORIGIN)):
        for other in (other for other in find_clips(folder / kind) if other.camera == clip.camera):
            found = look_through(clip.camera, other.samples(most), detector)
            if kind == INTRINSICS:
                own = {-1 - camera - n_cameras * frame: view for frame, view in found.by_frame.items()}
                by_frame.update(own)
            elif (origin := _at_rest(other, list(found.by_frame.values()), detector.board)) is not None:
                by_frame[ORIGIN_FRAME] = origin
    return replace(seen, by_frame=by_frame)


def _at_rest(clip: Clip, sightings: list[Sighting], board: Board) -> Sighting | None:
    """Where each corner of a board that lies still is in the median picture."""
    if not sightings:
        return None
    points = np.full((len(sightings), board.n_corners, 2), np.nan)
    for i, sighting in enumerate(sightings):
        points[i, sighting.corners] = sighting.points_px
    often = np.flatnonzero(2 * np.isfinite(points[..., 0]).sum(axis=0) > len(sightings))
    middle_px = np.nanmedian(points[:, often], axis=0)
    away_px = np.linalg.norm(points[:, often] - middle_px, axis=-1)
    if often.size and float(np.nanmedian(np.nanmax(away_px, axis=1))) > _STILL_PX:
        raise CalibrationError(
            f"{clip.path}: the board moves in it: expected a board that lies still at the origin"
        )
    sighting = Sighting(often.astype(np.int32), middle_px)
    return sighting if is_usable(sighting, board) else None
