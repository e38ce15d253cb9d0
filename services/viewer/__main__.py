"""Viewer process: `python -m services.viewer --connect tcp://HOST:5550`, then open http://127.0.0.1:8080."""

import logging
import threading
import time
from contextlib import closing
from pathlib import Path
from typing import Annotated

import typer

from proto.streams import DEFAULT_ENDPOINT
from services.address import LOOPBACK, Address
from services.health import beat
from services.mocap.take.live import open_source
from services.options import KeysOption, MetricsOption, keys_of_client
from services.process import StopRequest, give_way, run_service
from services.viewer.listener import Listener
from services.viewer.metrics import BROWSERS
from services.viewer.page_token import DEFAULT_ADDRESS, TokenOption, token_of
from services.viewer.server import PageServer

_LOOK_S = 0.1
_REST_S = 0.25
"""How often messages are read while no browser shows the page."""

log = logging.getLogger(__name__)


def _url(address: Address, port: int, token: str | None) -> str:
    """What to type into a browser on this machine."""
    host = LOOPBACK if address.host in ("0.0.0.0", "::") else address.host  # noqa: S104  (read, not bound)
    query = "" if token is None else f"/?token={token}"
    return f"http://{f'[{host}]' if ':' in host else host}:{port}{query}"


def main(
    connect: Annotated[str, typer.Option(help="The coordinator's endpoint.")] = DEFAULT_ENDPOINT,
    take: Annotated[
        Path | None, typer.Option(help="The take folder, for its pictures; without it there are silhouettes.")
    ] = None,
    results: Annotated[
        Path | None,
        typer.Option(help="The results folder, next to the journal: for frames no longer in memory."),
    ] = None,
    bind: Annotated[
        str, typer.Option(help="Address of the page, HOST:PORT; other machines need a token.")
    ] = DEFAULT_ADDRESS,
    token_file: TokenOption = None,
    niceness: Annotated[
        int,
        typer.Option(
            "--nice",
            min=0,
            max=19,
            help="Niceness of the viewer once a browser has loaded the page, so that tracking has priority.",
        ),
    ] = 10,
    keys: KeysOption = None,
    metrics: MetricsOption = None,
) -> None:
    """Show a take in browsers during tracking."""

    def work(stop: StopRequest) -> None:
        expected = f"HOST:PORT, such as {DEFAULT_ADDRESS}"
        address, given_way = Address.of(bind, "--bind", expected, lowest_port=0), False
        token, own_keys = token_of(token_file, address), keys_of_client(keys, "viewer")
        folder = None if take is None else open_source(take)
        with (
            closing(PageServer(address, token)) as server,
            closing(Listener(connect, own_keys, folder, server.show, results)) as listener,
        ):
            BROWSERS.set_function(lambda: server.n_browsers)
            preparing = threading.Thread(target=listener.prepare, daemon=True)
            log.info("coordinator at %s; open %s", connect, _url(address, server.port, token))
            while not stop:
                beat()
                listener.listen(_LOOK_S)
                if server.n_browsers and preparing.ident is None:
                    preparing.start()
                if server.has_shown and not given_way:  # not before, so that the first view is fast
                    give_way(niceness)
                    given_way = True
                if not server.n_browsers:  # messages wait, and are then read together
                    time.sleep(_REST_S)

    run_service("viewer", work, metrics)


if __name__ == "__main__":
    typer.run(main)
