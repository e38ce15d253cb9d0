"""Bridge process: `python -m services.bridge --connect tcp://HOST:5550 --vmc 127.0.0.1:39539`."""

import logging
from typing import Annotated

import typer

from proto.streams import DEFAULT_ENDPOINT
from services.bridge.puppeteer import Puppeteer
from services.bridge.sender import DEFAULT_LISTENER, address_of, open_sender
from services.health import beat
from services.mocap.motion.settings import ONE_EURO_HZ
from services.options import KeysOption, keys_of_client
from services.process import StopRequest, run_service

_LOOK_S = 0.1

log = logging.getLogger(__name__)


def bridge(
    connect: Annotated[str, typer.Option(help="The coordinator's endpoint.")] = DEFAULT_ENDPOINT,
    vmc: Annotated[
        str, typer.Option(metavar="HOST:PORT", help="Where a tool receives the VMC protocol (UDP).")
    ] = DEFAULT_LISTENER,
    take: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Follow only the take of this name; by default any take."),
    ] = None,
    cutoff_hz: Annotated[
        float,
        typer.Option(
            min=0,
            max=1000,
            metavar="HZ",
            help="Cutoff of the one-euro smoothing for a body at rest; 0: no smoothing.",
        ),
    ] = ONE_EURO_HZ,
    keys: KeysOption = None,
) -> None:
    """Send poses during tracking to animation tools that receive the VMC protocol."""

    def work(stop: StopRequest) -> None:
        own_keys, send = keys_of_client(keys, "viewer"), open_sender(*address_of(vmc))
        puppeteer = Puppeteer(connect, own_keys, send, take=take, cutoff_hz=cutoff_hz or None)
        log.info("coordinator at %s; sending VMC to %s", connect, vmc)
        try:
            while not stop:
                beat()
                puppeteer.listen(_LOOK_S)
        finally:
            puppeteer.close()

    run_service("bridge", work)


if __name__ == "__main__":
    typer.run(bridge)
