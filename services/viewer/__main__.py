"""Viewer process: `python -m services.viewer --connect tcp://HOST:5550`, then look at http://127.0.0.1:8080."""

import logging
import threading
import time
from pathlib import Path
from typing import Annotated

import typer

from proto.keys import ClientKeys
from proto.streams import DEFAULT_ENDPOINT
from services.health import beat
from services.mocap.take.live import open_source
from services.options import KeysOption, MetricsOption, keys_of_client
from services.process import StopRequest, give_way, run_service
from services.viewer.address import DEFAULT_ADDRESS, Address, TokenOption, token_of
from services.viewer.listener import Listener
from services.viewer.metrics import watch_browsers
from services.viewer.page_access import open_page

_LOOK_S = 0.1
_REST_S = 0.25
"""How often what comes is looked at while nobody looks at the page."""

log = logging.getLogger(__name__)


def serve(
    take: Path | None,
    results: Path | None,
    endpoint: str,
    address: Address,
    token: str | None,
    keys: ClientKeys | None,
    stop: StopRequest,
    niceness: int,
) -> None:
    """Show what a coordinator tracks until a stop is asked for; give way to tracking once it was seen."""
    folder = None if take is None else open_source(take)
    with open_page(address, token) as (server, url):
        watch_browsers(lambda: server.n_browsers)
        listener = Listener(endpoint, keys, folder, server.show, results)
        preparing: threading.Thread | None = None
        log.info("coordinator at %s; look at %s", endpoint, url)
        try:
            while not stop:
                beat()
                listener.listen(_LOOK_S)
                if server.n_browsers and preparing is None:
                    preparing = threading.Thread(target=listener.prepare, daemon=True)
                    preparing.start()
                if server.has_shown and niceness:  # not before, so that a first view does not take long
                    give_way(niceness)
                    niceness = 0
                if not server.n_browsers:  # what comes waits, and is taken in at once
                    time.sleep(_REST_S)
        finally:
            listener.close()


def main(
    connect: Annotated[str, typer.Option(help="The coordinator's endpoint.")] = DEFAULT_ENDPOINT,
    take: Annotated[
        Path | None,
        typer.Option(help="The take folder, for its pictures; without it there are silhouettes."),
    ] = None,
    results: Annotated[
        Path | None,
        typer.Option(
            help="The results' folder, beside which is the journal: for frames that have left memory."
        ),
    ] = None,
    bind: Annotated[
        str, typer.Option(help="Where browsers find the page, HOST:PORT; beyond this machine with a token.")
    ] = DEFAULT_ADDRESS,
    token_file: TokenOption = None,
    niceness: Annotated[
        int,
        typer.Option(
            "--nice",
            min=0,
            max=19,
            help="How far tracking goes first where both want a core, once a browser has seen all.",
        ),
    ] = 10,
    keys: KeysOption = None,
    metrics: MetricsOption = None,
) -> None:
    """Show a take in browsers while it is tracked."""

    def work(stop: StopRequest) -> None:
        address = Address.of(bind)
        serve(
            take,
            results,
            connect,
            address,
            token_of(token_file, address),
            keys_of_client(keys, "viewer"),
            stop,
            niceness,
        )

    run_service("viewer", work, metrics)


if __name__ == "__main__":
    typer.run(main)
