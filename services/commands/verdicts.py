"""How commands that track end: they print the verdict, show the page, and may exit with a code."""

from pathlib import Path
from typing import Annotated, TypeAlias

import typer

from services.commands.consoles import say, stdout
from services.commands.view import view
from services.mocap.result.result import load_result
from services.mocap.verdict.judging import verdict_of
from services.mocap.verdict.verdict import IOU_IN_WORDS, Level

EXIT_NOT_USABLE = 3
StrictOption: TypeAlias = Annotated[
    bool, typer.Option("--strict", help=f"Exit with code {EXIT_NOT_USABLE} if the results are not usable.")
]
_STYLES: dict[Level, str] = {"good": "green", "usable with gaps": "yellow", "not usable": "bold red"}


def conclude(folder: Path, take: Path | None, port: int | None, *, strict: bool) -> None:
    """Print the verdict on a result, and show it on the page until Ctrl-C.

    take: see view; port: that of the page; None: no page. strict: afterwards exit with EXIT_NOT_USABLE if the
    result cannot be used.
    """
    verdict = verdict_of(load_result(folder))
    stdout.print(f"verdict: {verdict.headline}", style=_STYLES[verdict.level], markup=False, soft_wrap=True)
    if verdict.doubts:
        say(f"  doubtful: {verdict.doubts_in_words}")
    if verdict.iou:
        lowest = min(verdict.iou, key=lambda camera: verdict.iou[camera])
        say(f"  overlap of body and silhouettes: {verdict.typical_iou:.2f}, lowest in {lowest}: "
            f"{verdict.iou[lowest]:.2f} ({IOU_IN_WORDS})")  # fmt: skip
    for cause in verdict.causes:
        say(f"  {'remark' if cause.level == 'good' else 'cause'}: {cause}")
    if port is not None:
        view(folder, take, port)
    if strict and verdict.level == "not usable":
        raise typer.Exit(EXIT_NOT_USABLE)
