"""Prints a verdict, and ends the command where it is asked to be strict."""

from typing import Annotated, TypeAlias

import typer

from services.commands.consoles import say, stdout
from services.mocap.verdict.verdict import IOU_IN_WORDS, Level, Verdict

EXIT_NOT_USABLE = 3
StrictOption: TypeAlias = Annotated[
    bool, typer.Option("--strict", help=f"Exit with code {EXIT_NOT_USABLE} if the results are not usable.")
]
_STYLES: dict[Level, str] = {"good": "green", "usable with gaps": "yellow", "not usable": "bold red"}


def tell_verdict(verdict: Verdict) -> None:
    """Print a verdict: the level, the doubtful parts, the overlap with the silhouettes, and the causes."""
    stdout.print(f"verdict: {verdict.headline}", style=_STYLES[verdict.level], markup=False, soft_wrap=True)
    if verdict.doubts:
        say(f"  doubtful: {verdict.doubts_in_words}")
    if verdict.iou:
        lowest = min(verdict.iou, key=lambda camera: verdict.iou[camera])
        say(f"  overlap of body and silhouettes: {verdict.typical_iou:.2f}, lowest in {lowest}: "
            f"{verdict.iou[lowest]:.2f} ({IOU_IN_WORDS})")  # fmt: skip
    for cause in verdict.causes:
        say(f"  {'remark' if cause.level == 'good' else 'cause'}: {cause}")


def exit_if_not_usable(verdict: Verdict, *, strict: bool) -> None:
    """Exit with EXIT_NOT_USABLE if the results cannot be used and strict is asked for."""
    if strict and verdict.level == "not usable":
        raise typer.Exit(EXIT_NOT_USABLE)
