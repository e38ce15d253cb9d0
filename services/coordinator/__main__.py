"""Coordinator process: `python -m services.coordinator --take TAKE --bind tcp://127.0.0.1:5550`."""

from pathlib import Path
from typing import Annotated

import typer

from proto.streams import DEFAULT_ENDPOINT
from services.coordinator.session import Plan, Session
from services.mocap.errors import UserError
from services.mocap.search.settings import SearchSettings
from services.mocap.take.actor_file import take_actor
from services.mocap.take.folder import Take, open_take
from services.process import StopRequest, run_service

_CLIENTS_S = 60.0
"""How long to wait for the expected workers and recorder before going on with those that are there."""


def frame_range(text: str, take: Take) -> tuple[int, int]:
    """A:B as a range of the take's frames; either may be left out. Raises UserError."""
    first, colon, end = text.partition(":")
    n_frames = take.settings.frames
    try:
        if not colon:
            raise ValueError
        bounds = int(first or 0), int(end or n_frames)
    except ValueError:
        raise UserError(f"--frames {text}: expected A:B, such as 0:50") from None
    if not 0 <= bounds[0] < bounds[1] <= n_frames:
        raise UserError(f"--frames {text}: expected a range within 0:{n_frames}, the frames of {take.folder}")
    return bounds


def main(
    take: Annotated[Path, typer.Option(help="The take folder.")],
    bind: Annotated[str, typer.Option(help="Where to listen.")] = DEFAULT_ENDPOINT,
    frames: Annotated[str, typer.Option(help="Which frames, A up to but not including B, as A:B.")] = ":",
    workers: Annotated[int, typer.Option(min=0, help="Limb workers to wait for before the first frame.")] = 0,
    recorders: Annotated[int, typer.Option(min=0, help="Recorders to wait for before the first frame.")] = 0,
) -> None:
    """Track a take with the limb workers that are there."""

    def serve(stop: StopRequest) -> None:
        opened = open_take(take)
        plan = Plan(opened, *frame_range(frames, opened), SearchSettings(), take_actor(opened))
        session = Session(plan, bind, stop)
        session.await_clients(workers, recorders, _CLIENTS_S)
        session.run()

    run_service("coordinator", serve)


if __name__ == "__main__":
    typer.run(main)
