"""`xormocap new`: makes a take folder from videos where they lie."""

import os
from pathlib import Path
from typing import Annotated

import tomli_w
import typer
from rich.markup import escape

from services.commands.consoles import say, stdout, table_of, warn
from services.mocap.atomic import write_file
from services.mocap.camera.calibration import Up, read_calibration, write_calibration
from services.mocap.camera.camera import Camera
from services.mocap.camera.formats import read_any
from services.mocap.errors import CalibrationError, TakeError, UserError
from services.mocap.take import layout
from services.mocap.take.recordings import VIDEO_SUFFIXES, files_of, match_by_name, unused, unused_remarks
from services.mocap.take.settings import TakeFile
from services.mocap.take.video_checks import check_video_size
from services.mocap.take.video_index import VideoIndex, index_video


def new(
    folder: Annotated[Path, typer.Argument(help="The take folder to make.", metavar="FOLDER")],
    videos: Annotated[
        list[Path], typer.Argument(help="One video per camera, or a folder of them.", metavar="VIDEOS...")
    ],
    calibration: Annotated[
        Path | None,
        typer.Option(help="The cameras: calibration.toml, or a file of another tool.", metavar="FILE"),
    ] = None,
    up: Annotated[Up, typer.Option(help="The axis that points up in the calibrated world.")] = "z",
) -> None:
    """Make a take folder: find out which video belongs to which camera, and write take.toml.

    Videos stay where they are. Without a calibration, cameras are named like the videos.
    """
    settings = folder / layout.SETTINGS
    if settings.exists():
        raise UserError(f"{settings}: exists already: edit it, or choose another folder")
    files = _videos(videos)
    cameras, remarks = _cameras(folder, calibration, up)
    if cameras:
        found = match_by_name([camera.name for camera in cameras], files)
    else:
        found = {path.stem: path for path in files}
        if len(found) < len(files):
            raise UserError(f"{folder}: two videos have one name: expected a different name for each camera")
    missing = [camera.name for camera in cameras if camera.name not in found]
    if missing:
        left = [str(path) for path in unused(files, found)]
        raise UserError(
            f"{folder}: no video could be told to be that of {', '.join(missing)}"
            f"{' among ' + ', '.join(left) if left else ''}: name the videos like the cameras"
        )
    indices = {name: index_video(path) for name, path in found.items()}
    for camera in cameras:
        check_video_size(indices[camera.name], camera)
    folder.mkdir(parents=True, exist_ok=True)
    if cameras and not (folder / layout.CALIBRATION).exists():
        write_calibration(folder / layout.CALIBRATION, cameras, up)
    relative = {name: os.path.relpath(path, folder) for name, path in found.items()}
    _write_settings(settings, folder.absolute().name, up, relative)
    warn([*remarks, *unused_remarks(files, found)])
    _tell(settings, indices, has_cameras=bool(cameras))


def _videos(given: list[Path]) -> list[Path]:
    """The videos themselves, and those in folders; raises TakeError if there are none."""
    for path in given:
        if not path.exists():
            raise TakeError(f"{path}: is missing: expected a video, or a folder of videos")
    files = [file for path in given for file in (files_of(path) if path.is_dir() else [path])]
    if not files:
        raise TakeError(f"{given[0]}: has no video: expected files such as {', '.join(VIDEO_SUFFIXES[:4])}")
    return files


def _cameras(folder: Path, file: Path | None, up: Up) -> tuple[tuple[Camera, ...], list[str]]:
    """The calibrated cameras, if there is a calibration, and remarks on it; raises CalibrationError."""
    inside = folder / layout.CALIBRATION
    if file is None:
        return (read_calibration(inside, up) if inside.exists() else ()), []
    if inside.exists():
        raise CalibrationError(f"{inside}: exists already: leave out --calibration, or remove it")
    return read_any(file, None, size_px=None, units="auto", scale=1.0, up=up)


def _write_settings(path: Path, name: str, up: Up, videos: dict[str, str]) -> None:
    """Write take.toml without frames and fps, which are left to the videos.

    Fields that may be added are comments above [videos]: at the end, they would be in that table.
    """
    fields, table = tomli_w.dumps({"name": name, "units": "m", "up": up}), tomli_w.dumps({"videos": videos})
    comments = "".join(
        f"# {field} = {info.examples[0]}  # {info.description}\n"
        for field, info in TakeFile.model_fields.items()
        if info.examples
    )
    write_file(path, f"{fields}\n# Other fields belong here, above [videos]:\n{comments}\n{table}")


def _tell(settings: Path, indices: dict[str, VideoIndex], *, has_cameras: bool) -> None:
    """What was found, and what to do next."""
    table = table_of("camera", "pixels", "frames", "seconds", "video")
    for name, index in indices.items():
        size, seconds = f"{index.width_px}x{index.height_px}", index.times_s[-1] - index.times_s[0]
        table.add_row(escape(name), size, str(index.n_frames), f"{seconds:.2f}", escape(str(index.path)))
    stdout.print(table)
    folder = settings.parent
    say(str(settings))
    if not has_cameras:
        say(f"next: xormocap calibrate CLIPS --out {folder / layout.CALIBRATION}, or --import a calibration")
    background = layout.background_video_path(folder, "<camera>")
    if not background.parent.is_dir():
        say(f"next: record the empty stage as {background}; without it, it is estimated")
    say(f"next: xormocap sync {folder}, if the cameras have no common trigger")
    say(f"next: xormocap track {folder}")
