"""From a folder of board clips to calibrated cameras."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from services.mocap.calibration.board import Board
from services.mocap.calibration.clips import INTRINSICS, ORIGIN, Clip, find_clips
from services.mocap.calibration.diagnosis import check_prints, check_same_pictures
from services.mocap.calibration.lens import Lens
from services.mocap.calibration.rig_solving import ORIGIN_FRAME, Show, Solution, solve_rig
from services.mocap.calibration.sightings import Detector, Sighting, Sightings, is_usable, look_through
from services.mocap.errors import CalibrationError

_MOST_LOOKED_AT = 300
"""Number of pictures in which the board is searched; of longer clips every second, third and so on."""
_MOST_OF_ORIGIN = 30
_STILL_PX = 2.0
"""Allowed movement of a corner while the board lies at the origin."""
_LOOKING_SHARE = 0.6


def calibrate_clips(folder: Path, board: Board, lens: Lens, show: Show) -> tuple[Solution, list[Sightings]]:
    """Calibrate the cameras of a folder of clips (see clips.py) by a board; also what they saw of it.

    Raises CalibrationError with what is missing or wrong, and what to do about it.
    """
    clips = find_clips(folder)
    if len(clips) < 2:
        raise CalibrationError(
            f"{folder}: has clips of {len(clips)} cameras: expected <camera>.mp4, or a folder <camera> of "
            "pictures, for two cameras or more"
        )
    detector, seen = Detector(board), []
    for c, clip in enumerate(clips):
        show(f"searching the board: {clip.camera}", _LOOKING_SHARE * c / len(clips))
        seen.append(_sightings(clip, folder, detector))
    check_prints(list(zip(clips, seen, strict=True)), board)
    check_same_pictures(seen)
    if not any(ORIGIN_FRAME in sightings.by_frame for sightings in seen):
        raise CalibrationError(_no_origin(folder, seen, board))

    def show_solving(what: str, share: float) -> None:
        show(what, _LOOKING_SHARE + (1 - _LOOKING_SHARE) * share)

    return solve_rig(seen, board, lens, show_solving), seen


def _sightings(clip: Clip, folder: Path, detector: Detector) -> Sightings:
    """All that a camera saw: of its clip, of its own clip for the lens, and of the origin."""

    def look(at: Clip, most: int) -> Sightings:
        return look_through(clip.camera, at.pictures(-(-at.n_frames() // most)), detector)

    seen = look(clip, _MOST_LOOKED_AT)
    by_frame = dict(seen.by_frame)
    for kind, most in ((INTRINSICS, _MOST_LOOKED_AT), (ORIGIN, _MOST_OF_ORIGIN)):
        for other in (other for other in find_clips(folder / kind) if other.camera == clip.camera):
            found = look(other, most)
            if found.n_looked_at and seen.n_looked_at and found.size_px != seen.size_px:
                (width, height), (first_width, first_height) = found.size_px, seen.size_px
                raise CalibrationError(
                    f"{other.path}: is {width}x{height} pixels, but the camera's other clip is "
                    f"{first_width}x{first_height}: record all clips of a camera with the same settings"
                )
            if kind == INTRINSICS:
                by_frame.update({-1 - frame: sighting for frame, sighting in found.by_frame.items()})
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


def _no_origin(folder: Path, seen: list[Sightings], board: Board) -> str:
    there = find_clips(folder / ORIGIN)
    if not there:
        return (
            f"{folder / ORIGIN}: has no clip: expected a clip or a picture <camera>.png, by one camera or "
            "more, of the board lying on the floor where the world's origin shall be"
        )
    known = {sightings.camera for sightings in seen}
    if not any(clip.camera in known for clip in there):
        return (
            f"{folder / ORIGIN}: {there[0].path.name} belongs to no camera: expected one of "
            f"{', '.join(sorted(known))}"
        )
    return f"{folder / ORIGIN}: {board.in_words()} was not found in it: show it larger, evenly lit and whole"
