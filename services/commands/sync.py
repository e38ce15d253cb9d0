"""`xormocap sync TAKE`: finds from silhouettes by how many frames each camera is ahead, and writes that to
take.toml."""

import re
from shlex import quote
from typing import Annotated

import numpy as np
import typer
from rich.markup import escape
from rich.table import Table

from services.commands.consoles import TakeFolder, progress_bar, say, stdout, table_of, warn
from services.mocap.atomic import atomic_file
from services.mocap.calibration.lost_frames import LostFrames, find_lost_frames
from services.mocap.calibration.time_offsets import STEP, TimeOffsets, find_offsets
from services.mocap.errors import TakeError, UserError
from services.mocap.take import layout
from services.mocap.take.folder import Take, open_take
from services.mocap.take.settings import read_take_file
from services.mocap.take.video_index import index_video
from services.mocap.types import Mask
from services.runs.outlines import outlines_of

_MOST_FRAMES = 900
_LEAST_CONFIDENCE = 0.15
_OFFSETS_TABLE = re.compile(r"^\[offsets\].*\n(?:(?!\[).*\n?)*", re.MULTILINE)
_OFFSETS_INLINE = re.compile(r"^offsets\s*=.*\n?", re.MULTILINE)
_FRAMES = re.compile(r"^(\s*frames\s*=\s*)\d+", re.MULTILINE)
_INIT_FRAMES = re.compile(r"^(\s*init_frames\s*=\s*)\d+", re.MULTILINE)


def sync(
    take: TakeFolder,
    reach: Annotated[int, typer.Option(min=1, max=300, help="Largest offset to search, in frames.")] = 15,
    write: Annotated[bool, typer.Option(help="Write the offsets to take.toml.")] = True,
) -> None:
    """Find by how many frames each camera of a take is ahead, and write the offsets to take.toml.

    For takes whose cameras have no common trigger. The cameras must be calibrated and have the same frame
    rate.
    """
    stated = open_take(take, in_step=False)
    opened = stated.without_offsets()
    frames = range(min(opened.settings.frames, _MOST_FRAMES))
    with progress_bar() as show:
        cameras, outlines, _ = outlines_of(
            opened, frames, lambda share: show("looking at silhouettes", share)
        )
    found = find_offsets(cameras, outlines, reach)
    is_sure = found.confidence >= _LEAST_CONFIDENCE
    stdout.print(_table(opened, found, is_sure))
    lost = find_lost_frames(cameras, outlines, found.offsets)
    if lost is not None:
        raise TakeError(told_of(lost, opened))
    if not _in_step(stated, found, is_sure) and write:
        _write(opened, found)


def told_of(lost: LostFrames, take: Take) -> str:
    """What is wrong with a camera's recording, and what mends it."""
    name, first, last = take.cameras[lost.camera].name, lost.first_after, lost.first_after - lost.n_lost - 1
    if take.source == "videos":
        recording = take.videos[name]
        mend = (
            f"loop={lost.n_lost}:1:{first}" if lost.n_lost > 0 else f"select='not(between(n,{first},{last}))'"
        )
        filters = f'"{mend},setpts=N/FR/TB"'
        remedy = f"make another video by ffmpeg -i {quote(str(recording))} -vf {filters} -crf 12 NEW.mp4"
    else:
        recording = layout.silhouette_folder(take.folder, name)
        remedy = (
            f"add {lost.n_lost} to the numbers of its pictures from {first} on, and fill the gap with copies "
            "of the one before"
            if lost.n_lost > 0
            else f"remove its pictures {first} to {last}, and number those after them anew"
        )
    return (
        f"{recording}: {lost} at about frame {first}, or the camera was moved then; no offset mends this, "
        f"and nothing is written: {remedy}, then run sync again"
    )


def _in_step(take: Take, found: TimeOffsets, is_sure: Mask) -> bool:
    """Whether the cameras are in step with the take's present offsets; says so, and which are undetermined.

    is_sure: (C,) whether a camera's offset is determined. Raises UserError if some are not, and the others
    are not in step.
    """
    names = np.array(take.camera_names)
    lead_frames = (found.offsets - [take.settings.offset(name) for name in names])[is_sure]
    is_in_step = len(lead_frames) > 1 and bool(np.ptp(lead_frames) <= STEP)
    if not is_sure.all():
        undetermined = (
            f"{take.folder}: silhouettes do not determine the offsets of {', '.join(names[~is_sure])}: "
            "expected somebody who moves, whole in the pictures and hidden by nothing, cameras that agree "
            "(xormocap calibrate --check), and offsets within --reach: nothing is written"
        )
        if not is_in_step:
            raise UserError(undetermined)
        warn([undetermined])
    if is_in_step:
        say(
            f"{take.folder}: {len(lead_frames)} cameras are in step, to half a frame: nothing needs to be "
            "done for them"
        )
    return is_in_step


def _write(take: Take, found: TimeOffsets) -> None:
    """Write whole frames to take.toml, and the number of frames that all cameras then have."""
    whole = np.rint(found.offsets).astype(int)
    whole -= whole.min()
    names = take.camera_names
    offsets = {name: int(offset) for name, offset in zip(names, whole, strict=True)}
    if take.source == "videos":
        held = [index_video(take.videos[name]).n_frames for name in names]
    else:
        folders = [layout.silhouette_folder(take.folder, name) for name in names]
        held = [len(list(folder.glob("*.png"))) for folder in folders]
    frames = min(n - offsets[name] for name, n in zip(names, held, strict=True))
    path = take.folder / layout.SETTINGS
    text = path.read_text(encoding="utf-8")
    text = _FRAMES.sub(rf"\g<1>{frames}", _OFFSETS_INLINE.sub("", _OFFSETS_TABLE.sub("", text)))
    if (take.settings.init_frames or 0) > frames:
        text = _INIT_FRAMES.sub(rf"\g<1>{frames}", text)
    rows = "".join(f'"{name}" = {offset}\n' for name, offset in offsets.items())
    table = f"[offsets]  # frames by which cameras are ahead, found by xormocap sync\n{rows}"
    with atomic_file(path) as part:
        part.write_text(f"{text.rstrip()}\n\n{table}", encoding="utf-8")
        if read_take_file(part).offsets != offsets:
            raise TakeError(f"{path}: sync cannot edit this file: add {offsets} by hand")
    told = f", frames = {frames}" if _FRAMES.search(text) else ""
    say(f"{path}: offsets of {len(names)} cameras{told}")


def _table(take: Take, found: TimeOffsets, is_sure: Mask) -> Table:
    """A row for each camera; is_sure: (C,) whether its offset is determined."""
    table = table_of("camera", "ahead, frames", "confidence", "error now, px", "error after, px")
    ahead = found.offsets - min(found.offsets[is_sure], default=0.0)
    for c, camera in enumerate(take.cameras):
        table.add_row(
            escape(camera.name),
            f"{ahead[c]:g}" if is_sure[c] else "-",
            f"{found.confidence[c]:.2f}",
            f"{found.off_before_px[c]:.1f}",
            f"{found.off_px[c]:.1f}",
        )
    return table
