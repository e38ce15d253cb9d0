"""`xormocap new`: makes a take folder from videos where they lie."""

import os
import shutil
from pathlib import Path
from shlex import quote
from typing import Annotated

import numpy as np
import tomli_w
import typer
from rich.markup import escape

from services.commands.consoles import say, stdout, table_of, warn
from services.mocap.atomic import make_folder, write_file
from services.mocap.camera.calibration import Up, read_calibration, write_calibration
from services.mocap.camera.camera import Camera, nfc
from services.mocap.camera.formats import read_any
from services.mocap.errors import CalibrationError, TakeError, UserError
from services.mocap.take import layout
from services.mocap.take.recordings import VIDEO_SUFFIXES, files_of, match_by_name, unused_remarks
from services.mocap.take.settings import TakeFile
from services.mocap.take.video_checks import check_plate, check_video_size
from services.mocap.take.video_index import VideoIndex, index_video

_OF_PLATES = (*VIDEO_SUFFIXES, ".png")


def new(
    folder: Annotated[Path, typer.Argument(help="The take folder to make.", metavar="FOLDER")],
    videos: Annotated[
        list[Path], typer.Argument(help="One video per camera, or a folder of them.", metavar="VIDEOS...")
    ],
    calibration: Annotated[
        Path | None,
        typer.Option(help="The cameras: calibration.toml, or a file of another tool.", metavar="FILE"),
    ] = None,
    background: Annotated[
        list[Path] | None,
        typer.Option(help="Videos or PNG pictures of the empty stage, or a folder of them.", metavar="FILE"),
    ] = None,
    up: Annotated[Up | None, typer.Option(help="The axis that points up; by default the format's.")] = None,
) -> None:
    """Make a take folder: find out which video belongs to which camera, and write take.toml.

    Videos stay where they are; those of the empty stage are copied into the take. Without a calibration,
    cameras are named like the videos.
    """
    settings = folder / layout.SETTINGS
    if settings.exists():
        raise UserError(f"{settings}: exists already: edit it, or choose another folder")
    files = _files(videos, VIDEO_SUFFIXES)
    cameras, remarks = _cameras(folder, calibration, up)
    if cameras:
        found = match_by_name([camera.name for camera in cameras], files)
    else:
        found = {nfc(path.stem): path for path in files}
        if len(found) < len(files):
            raise UserError(f"{folder}: two videos have one name: expected a different name for each camera")
    missing = [camera.name for camera in cameras if camera.name not in found]
    if missing:
        known, names = ", ".join(camera.name for camera in cameras), ", ".join(path.name for path in files)
        raise UserError(
            f"{folder}: no video could be told to be that of {', '.join(missing)}: {calibration or folder} "
            f"has the cameras {known}, the videos are {names}: name them like the cameras, if it is their "
            "calibration, and leave cameras out of it that did not record"
        )
    empty = _files(background, _OF_PLATES) if background else []
    plates = _plates(folder, empty, list(found))
    indices = {name: index_video(path) for name, path in found.items()}
    for camera in cameras:
        check_video_size(indices[camera.name], camera)
        if camera.name in plates:
            check_plate(plates[camera.name], camera, decoded=False)
    make_folder(folder)
    if cameras and not (folder / layout.CALIBRATION).exists():
        write_calibration(folder / layout.CALIBRATION, cameras, up or "z")
    for name, path in plates.items():
        inside = layout.background_video_path(folder, name).with_suffix(path.suffix)
        inside.parent.mkdir(exist_ok=True)
        if not (inside.exists() and inside.samefile(path)):
            shutil.copyfile(path, inside)
    relative = {name: os.path.relpath(path, folder) for name, path in found.items()}
    _write_settings(settings, folder.absolute().name, up or "z", relative)
    warn([*remarks, *unused_remarks(files, found), *unused_remarks(empty, plates)])
    _tell(settings, indices, plates, has_cameras=bool(cameras))


def _files(given: list[Path], suffixes: tuple[str, ...]) -> list[Path]:
    """The files themselves, and those in folders; raises TakeError if there are none, or of another kind."""
    kinds = f"{', '.join(suffixes[:4])}{' or .png' if '.png' in suffixes else ''}"
    for path in given:
        if not path.exists():
            raise TakeError(f"{path}: is missing: expected a file such as {kinds}, or a folder of them")
        if path.is_file() and path.suffix.lower() not in suffixes:
            raise TakeError(f"{path}: is of another kind: expected a file such as {kinds}")
    files = [file for path in given for file in (files_of(path, suffixes) if path.is_dir() else [path])]
    if not files:
        raise TakeError(f"{given[0]}: has none of the files that are needed: expected files such as {kinds}")
    return files


def _plates(folder: Path, files: list[Path], cameras: list[str]) -> dict[str, Path]:
    """The empty stage by camera, if there are files; raises UserError if a camera has none."""
    plates = match_by_name(cameras, files)
    if files and (lacking := [name for name in cameras if name not in plates]):
        raise UserError(
            f"{folder}: --background: nothing could be told to be the empty stage of {', '.join(lacking)} "
            f"among {', '.join(path.name for path in files)}: name the files like the cameras"
        )
    return plates


def _cameras(folder: Path, file: Path | None, up: Up | None) -> tuple[tuple[Camera, ...], list[str]]:
    """The calibrated cameras, if there is a calibration, and remarks on it; raises CalibrationError."""
    inside = folder / layout.CALIBRATION
    if file is None:
        return (read_calibration(inside, up or "z") if inside.exists() else ()), []
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


def _tell(
    settings: Path, indices: dict[str, VideoIndex], plates: dict[str, Path], *, has_cameras: bool
) -> None:
    """What was found, and what to do next."""
    table = table_of("camera", "pixels", "frames", "seconds", "video", "empty stage")
    for name, index in indices.items():
        size, seconds = f"{index.width_px}x{index.height_px}", np.ptp(index.times_s)
        # The last frame is shown as long as the others.
        seconds *= index.n_frames / max(index.n_frames - 1, 1)
        table.add_row(
            escape(name),
            size,
            str(index.n_frames),
            f"{seconds:.2f}",
            escape(str(index.path)),
            escape(str(plates.get(name, "-"))),
        )
    stdout.print(table)
    folder = settings.parent
    say(str(settings))
    if not has_cameras:
        calibration = quote(str(folder / layout.CALIBRATION))
        say(f"next: xormocap calibrate CLIPS --out {calibration}, or --import a calibration")
    background = layout.background_video_path(folder, "<camera>")
    if not background.parent.is_dir():
        say(f"next: record the empty stage as {background}; without it, it is estimated")
    say(f"next: xormocap sync {quote(str(folder))}, if the cameras have no common trigger")
    say(f"next: xormocap track {quote(str(folder))}")
