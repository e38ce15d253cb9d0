"""Turns recordings of live cameras into a take folder."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from services.mocap.camera.calibration import write_calibration
from services.mocap.errors import TakeError, UserError
from services.mocap.take import layout
from services.mocap.take.actor_file import copy_actor
from services.mocap.take.live import LiveTake
from services.mocap.take.settings import TakeSettings, write_settings
from services.mocap.take.video_index import index_video


def part_of(folder: Path) -> Path:
    """The folder of a recording until it is complete."""
    folder = folder.resolve()
    return folder.with_name(f"{folder.name}.part")


@contextmanager
def recording_to(folder: Path | None) -> Iterator[None]:
    """While this runs, part_of(folder) is there to record in; afterwards only if something was recorded.

    None: nothing is to be recorded. Raises UserError if something exists there.
    """
    if folder is None:
        yield
        return
    folder, part = folder.resolve(), part_of(folder)
    for path in (folder, part):
        if path.exists():
            raise UserError(f"--record {folder}: {path} already exists: remove it or choose another folder")
    try:
        part.mkdir(parents=True)
    except OSError as problem:
        raise UserError(f"--record {folder}: cannot be written ({problem.strerror})") from None
    try:
        yield
    finally:
        if not any(path.is_file() for path in part.rglob("*")):
            shutil.rmtree(part, ignore_errors=True)


def finish_recording(take: LiveTake, folder: Path) -> list[str]:
    """Make a take from part_of(folder), and return the cameras that other hosts have recorded.

    Raises TakeError if a video is missing or shorter than the others; the recordings stay.
    """
    folder, part, lengths = folder.resolve(), part_of(folder), dict[str, int]()
    for camera in (take.cameras[c] for c in take.cameras_of(take.groups_here)):
        lengths[camera.name] = index_video(layout.video_path(part, camera.name)).n_frames
    frames = min(lengths.values())
    if frames < max(lengths.values()):
        short = min(lengths, key=lambda name: lengths[name])
        raise TakeError(
            f"{part}: {short} was recorded for {frames} frames, others for {max(lengths.values())}: cut the "
            "videos to the same moments"
        )
    settings = take.settings.model_copy(update={"name": folder.name, "frames": frames, "facing": None})
    write_settings(part / layout.SETTINGS, TakeSettings.model_validate(settings.model_dump()))
    write_calibration(part / layout.CALIBRATION, take.calibrated, take.settings.up)
    if take.background_folder is not None:
        plates = part / layout.BACKGROUND
        plates.mkdir(exist_ok=True)
        for plate in filter(None, map(take.plate, take.cameras)):
            shutil.copy(plate, plates)
    if take.colour_path is not None:
        shutil.copy(take.colour_path, part / layout.COLOURS)  # its videos have no colour correction
    if take.actor_path is not None:
        copy_actor(take.actor_path, part)
    part.rename(folder)
    return [camera.name for camera in take.cameras if camera.name not in lengths]
