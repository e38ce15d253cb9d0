"""Shows finished results: `xormocap view` on the page; commands that track end with the verdict."""

import socket
import time
from collections.abc import Iterator, Sequence
from contextlib import closing
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import typer

from services.address import LOOPBACK, Address
from services.commands.consoles import ResultFolder, say, stderr, warn
from services.mocap.camera.rig import Rig
from services.mocap.errors import UserError
from services.mocap.result.layout import RUN_JSON
from services.mocap.result.result import Result, load_result, open_take_of
from services.mocap.result.words import IOU_IN_WORDS
from services.mocap.take.fit_record import FIT_FOLDER, read_learnt, record_of
from services.mocap.take.folder import Take
from services.mocap.types import Bytes, Mask
from services.mocap.verdict.judging import verdict_of
from services.mocap.verdict.verdict import Level
from services.process import STOP_CHECK_S, StopRequest
from services.segmentation.segmenters import AUTO, chosen_segmenter, make_segmenter
from services.segmentation.silhouettes import Segmenter
from services.viewer.finished import history_of
from services.viewer.picture_sources import Segmented, TakePictures
from services.viewer.show import Show
from services.viewer.tiles import TileArtist

DEFAULT_PORT = 8080
EXIT_NOT_USABLE = 3
_STYLES: dict[Level, str] = {"good": "green", "usable with gaps": "yellow", "not usable": "bold red"}
PortOption = Annotated[
    int, typer.Option(min=0, max=65535, help="Port of the page on this machine; 0 chooses a free port.")
]
ViewOption = Annotated[
    bool, typer.Option("--view", help="Serve a page to watch the run in a browser, until Ctrl-C.")
]
StrictOption = Annotated[
    bool, typer.Option("--strict", help=f"Exit with code {EXIT_NOT_USABLE} if the results are not usable.")
]


def check_page() -> None:
    """Raise UserError if the packages for the page are not installed."""
    if find_spec("viser") is None:
        raise UserError("the page needs viser, which is not installed: pip install 'xormocap[page]'")


def tell_page(port: int) -> int:
    """Print the page's address; returns its port. Raises as check_page, and if the port is in use."""
    check_page()
    with socket.socket() as trial:
        trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            trial.bind((LOOPBACK, port))
            port = int(trial.getsockname()[1])  # if it was 0, a free one
        except OSError as problem:
            reason = (problem.strerror or "is in use").lower()
            raise UserError(f"--port {port}: {reason}: choose another") from None
    say(f"open http://{LOOPBACK}:{port}", stderr)
    return port


def view(
    result: ResultFolder,
    take: Annotated[
        Path | None, typer.Option(help="The take folder, if it has moved since tracking.")
    ] = None,
    port: PortOption = DEFAULT_PORT,
) -> None:
    """Show results in a browser until Ctrl-C: the body, all cameras, curves."""
    check_page()
    from services.viewer.server import PageServer  # viser is needed only for the page

    show = finished_show(result, take)
    warn([show.remark] if show.remark else [])
    with closing(PageServer(Address(LOOPBACK, port))) as server, StopRequest() as stop:
        server.show(show)
        say(f"open http://{LOOPBACK}:{server.port} (Ctrl-C stops the server)")
        while not stop.count:
            time.sleep(STOP_CHECK_S)


def conclude(folder: Path, take: Path | None, port: int | None, *, strict: bool) -> None:
    """Print the verdict on a result, and show it on the page until Ctrl-C.

    take: see view; port: that of the page; None: no page. strict: afterwards exit with EXIT_NOT_USABLE if the
    result cannot be used.
    """
    verdict = verdict_of(load_result(folder))
    say(f"verdict: {verdict.headline}", style=_STYLES[verdict.level])
    if verdict.doubts:
        say(f"  doubtful: {verdict.doubts_in_words}")
    if verdict.iou:
        lowest = min(verdict.iou, key=lambda camera: verdict.iou[camera])
        say(f"  overlap of body and silhouettes: {verdict.typical_iou:.2f}, lowest in {lowest}: "
            f"{verdict.iou[lowest]:.2f} ({IOU_IN_WORDS})")  # fmt: skip
    for cause in verdict.causes:
        say(f"  {cause.kind}: {cause}")
    if port is not None:
        view(folder, take, port)
    if strict and verdict.level == "not usable":
        raise typer.Exit(EXIT_NOT_USABLE)


def finished_show(folder: Path, take: Path | None) -> Show:
    """The content of a results folder for the page, and its take if it still exists.

    take: the take folder; None: that of run.json. Raises UserError if the results cannot be used.
    """
    result = load_result(folder)
    opened, remark = _take_of(result, take)
    name, fps, body, history = result.motion.name, result.fps, result.motion.body, history_of(result)
    verdict = verdict_of(result)
    if opened is None:
        return Show(name, fps, history, body, None, (), None, is_live=False, remark=remark, verdict=verdict)
    rig = Rig.of(opened.cameras)
    try:
        name_of_segmenter = chosen_segmenter(opened, result.segmenter)
    except UserError:  # such as a plug-in that this machine lacks
        name_of_segmenter = AUTO

    known = _fit_of(result, opened)

    @cache  # clean plates are learnt when silhouettes, as the tracker had them, are first asked for
    def segmenter() -> Segmenter:
        segmenter = make_segmenter(opened, opened.cameras, name_of_segmenter)
        return segmenter if known is None else segmenter.knowing(*known)

    shown = dict(zip(result.frames.tolist(), result.tracked.frames_shown.tolist(), strict=True))

    def segment(start: int, stop: int) -> Iterator[list[Segmented]]:
        for moment in segmenter().moments(start, stop):
            classes: Sequence[Bytes | None] = moment.classes or [None] * len(moment.trimaps)
            yield [Segmented(*seen) for seen in zip(moment.trimaps, classes, strict=True)]

    pictures = TakePictures(opened, segment, shown)
    artist = TileArtist(body, rig, pictures)
    names, has_pictures = tuple(opened.camera_names), any(map(opened.has_video, opened.cameras))
    return Show(name, fps, history, body, rig, names, artist, False, has_pictures, verdict=verdict)


def _fit_of(result: Result, take: Take) -> tuple[dict[str, Mask], dict[str, Bytes]] | None:
    """What hides the actor and what colours are, by camera, from the fit of the result's actor; None if it is
    gone."""
    for fit in (result.folder / FIT_FOLDER, take.folder / FIT_FOLDER):
        if record_of(fit, result.actor) is not None:
            return read_learnt(fit, take.cameras)
    return None


def _take_of(result: Result, take: Path | None) -> tuple[Take | None, str]:
    """The take of the results, or why it is not available."""
    folder = take or result.take_folder
    if folder is None:
        where = result.folder / RUN_JSON
        return None, f"{where} does not name the take: give --take to see its cameras."
    if take is None and "live" in result.run:
        return None, "These are results of live cameras: give --take, their recording, to see what they saw."
    if take is None and not folder.is_dir():
        return None, f"The take is not at {folder} any more: give --take to see its cameras."
    return open_take_of(result, folder), ""
