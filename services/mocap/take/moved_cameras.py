"""Takes whose cameras stand elsewhere than their calibration says."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeAlias

from services.mocap.camera.calibration import read_calibration, write_calibration
from services.mocap.camera.camera import Camera, moved_by
from services.mocap.take.actor_file import take_actor
from services.mocap.take.fit_record import FIT_FOLDER, record_of, was_seen_by
from services.mocap.take.folder import Take
from services.mocap.take.layout import CALIBRATION
from services.mocap.take.live import LiveTake

Moves: TypeAlias = Mapping[str, tuple[float, float]]
"""By camera how far it was turned, in degrees, and moved, in millimetres."""
AS_THE_BODY_SHOWS = "tracked with their places as the body shows them"
"""What a run did about them, after moves_in_words."""
_SAME_DEG, _SAME_MM = 0.01, 0.5
"""Up to this a camera stands where it did: files are rounded."""
_FEWEST_TOLD = 4
"""Fewer cameras only tell that they disagree: with two or three, another one than the moved one may be placed
elsewhere, and then agree with the others as well."""


def moved_take(take: Take, cameras: Sequence[Camera]) -> Take:
    """The take with the extrinsics of these cameras; others stay."""
    found = {camera.name: camera for camera in cameras}

    def moved(camera: Camera) -> Camera:
        there = found.get(camera.name, camera)
        return replace(camera, R_camera_world=there.R_camera_world, t_camera_world_m=there.t_camera_world_m)

    stated = take.stated or take.calibrated
    return replace(take, calibrated=tuple(map(moved, take.calibrated)), stated=stated)


def moves_of(take: Take) -> Moves:
    """How far cameras of a take stand from where its calibration has them; without those that do not."""
    pairs = zip(take.stated or take.calibrated, take.calibrated, strict=True)
    moves = {new.name: moved_by(old, new) for old, new in pairs}
    return {name: (deg, mm) for name, (deg, mm) in moves.items() if deg > _SAME_DEG or mm > _SAME_MM}


def moves_in_words(moves: Moves, n_cameras: int) -> str:
    """Which of a take's cameras are not where calibration.toml says, and by how much; or, of few cameras,
    only how much they disagree."""
    if n_cameras < _FEWEST_TOLD:
        turned_deg, moved_mm = map(max, zip(*moves.values(), strict=True))
        return (
            f"the cameras do not stand to each other as calibration.toml says (by {turned_deg:.1f} degrees, "
            f"{moved_mm:.0f} mm); so few do not tell which of them was moved"
        )
    listed = ", ".join(f"{name} (by {deg:.1f} degrees, {mm:.0f} mm)" for name, (deg, mm) in moves.items())
    return f"not where calibration.toml says: {listed}"


def write_moved(folder: Path, take: Take) -> None:
    """Write calibration.toml into a folder of a fit or of results if cameras of their take were moved, else
    remove it."""
    (folder / CALIBRATION).unlink(missing_ok=True)
    if moves_of(take):
        write_calibration(folder / CALIBRATION, take.calibrated, take.settings.up)


def take_as_in(folder: Path, take: Take) -> Take:
    """The take with the cameras that write_moved wrote into a folder, if any."""
    path = folder / CALIBRATION
    return moved_take(take, read_calibration(path, take.settings.up)) if path.exists() else take


def take_of_fit(take: Take, fitted: Path | None = None) -> Take:
    """A recorded take with the cameras where the fit of its actor found them, if it moved some of this very
    calibration.

    fitted: the folder of the fit; the take's own by default. Raises TakeError if its files cannot be used.
    """
    folder = fitted or take.folder / FIT_FOLDER
    if isinstance(take, LiveTake) or not (folder / CALIBRATION).exists():
        return take
    record = record_of(folder, take_actor(take, fitted))
    return take_as_in(folder, take) if record is not None and was_seen_by(record, take.calibrated) else take
