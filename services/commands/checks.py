"""The checks of a take before it is fitted or tracked: their option, and what is printed."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Annotated, TypeAlias

import typer

from services.commands.consoles import progress_bar, warn
from services.mocap.errors import TakeError
from services.mocap.take.folder import Take
from services.mocap.verdict.verdict import Cause
from services.runs.in_view import frames_in_view
from services.runs.take_check import check_before

CheckOption: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--check/--no-check",
        help="Look for mistakes in calibration and silhouettes before the work, and where the actor comes "
        "into view.",
    ),
]

_NOT_IN_VIEW = (
    "silhouettes: frame {first} does not show the whole actor: the work begins at frame {start}{hints}"
)
_NO_HINTS = "; facing and initial_pose in take.toml describe frame 0 and are not used"


def look_before(take: Take, frames: range, segmenter: str) -> tuple[Cause, ...]:
    """Check a take, and print what is wrong; raises TakeError where it cannot be tracked."""
    with progress_bar() as show:
        found = check_before(take, frames, lambda share: show("checking the take", share), segmenter)
        show("take checked", 1.0)
    warn(map(str, found))
    return found


def in_view(take: Take, frames: range, segmenter: str) -> range:
    """These frames from the first one on that shows the whole actor; a warning says if it is a later one."""
    with progress_bar() as show:
        found = frames_in_view(take, frames, lambda share: show("looking for the actor", share), segmenter)
        show("actor in view", 1.0)
    if found.start > frames.start:
        hints = _NO_HINTS if take.settings.facing is not None or take.settings.initial_pose else ""
        warn([_NOT_IN_VIEW.format(first=frames.start, start=found.start, hints=hints)])
    return found


@contextmanager
def blamed_first(checks: Sequence[Cause]) -> Iterator[None]:
    """Make a TakeError of the block tell first what the checks have found, as the likelier cause."""
    try:
        yield
    except TakeError as problem:
        if not checks:
            raise
        raise TakeError(f"{checks[0]}; this led to: {problem}") from None


def not_told(warnings: Sequence[str], checks: Sequence[Cause]) -> list[str]:
    """The warnings that the checks have not printed."""
    told = {str(cause) for cause in checks}
    return [sentence for sentence in warnings if sentence not in told]
