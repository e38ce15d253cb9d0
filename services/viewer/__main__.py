"""Viewer process: `python -m services.viewer --connect tcp://HOST:5550`, then open http://127.0.0.1:8080."""

import logging
import os
import re
import threading
import time
from contextlib import closing
from pathlib import Path
from typing import Annotated

import typer

from proto.streams import DEFAULT_ENDPOINT, is_loopback
from services.address import LOOPBACK, Address
from services.health import beat
from services.mocap.errors import UserError
from services.mocap.take.live import open_source
from services.mocap.take.moved_cameras import take_of_fit
from services.options import FittedOption, KeysOption, MetricsOption, keys_of_client
from services.process import StopRequest, give_way, run_service
from services.viewer.metrics import BROWSERS
from services.viewer.presenter import TakePresenter
from services.viewer.server import PageServer

DEFAULT_ADDRESS = f"{LOOPBACK}:8080"
TOKEN_VARIABLE = "XORMOCAP_VIEWER_TOKEN"  # noqa: S105  (the variable's name)
SHORTEST_TOKEN = 8
_TOKEN = re.compile(r"[A-Za-z0-9_.~-]+", re.ASCII)
_READ_S = 0.1
"""How long messages are waited for, and so how late requests of the page go out, at most."""
_REST_S = 0.25
"""How often messages are read while no browser shows the page."""

log = logging.getLogger(__name__)


def token_of(file: Path | None, address: Address) -> str | None:
    """The token that browsers must give, from a file or the environment; None: none is required.

    Raises UserError for a token that is too short or that a URL cannot contain, and if an address beyond this
    machine has none.
    """
    token, where = os.environ.get(TOKEN_VARIABLE) or None, TOKEN_VARIABLE
    if file is not None:
        where = str(file)
        try:
            token = file.read_text(encoding="utf-8").strip()
        except (OSError, UnicodeDecodeError):
            raise UserError(f"{file}: cannot be read: expected the token that browsers must give") from None
    if token is None:
        if is_loopback(address.host):
            return None
        raise UserError(
            f"--bind {address.host}:{address.port}: everybody could open the page there: give a token that "
            f"browsers must give, by --token-file FILE or {TOKEN_VARIABLE}, or bind to {DEFAULT_ADDRESS}"
        )
    if len(token) < SHORTEST_TOKEN or _TOKEN.fullmatch(token) is None:
        raise UserError(
            f"{where}: expected a token of at least {SHORTEST_TOKEN} letters, digits and -._~, such as "
            "python3 -c 'import secrets; print(secrets.token_urlsafe())' makes"
        )
    return token


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
        typer.Option(help="The results folder, next to the journal: for frames that the viewer missed."),
    ] = None,
    bind: Annotated[
        str, typer.Option(help="Address of the page, HOST:PORT; other machines need a token.")
    ] = DEFAULT_ADDRESS,
    token_file: Annotated[
        Path | None,
        typer.Option(
            help=f"A file with the token that browsers must give; {TOKEN_VARIABLE} may hold the token itself."
        ),
    ] = None,
    niceness: Annotated[
        int,
        typer.Option(
            "--nice",
            min=0,
            max=19,
            help="Niceness of the viewer once a browser has loaded the page, so that tracking has priority.",
        ),
    ] = 10,
    fitted: FittedOption = None,
    keys: KeysOption = None,
    metrics: MetricsOption = None,
) -> None:
    """Show a take in browsers during tracking."""

    def work(stop: StopRequest) -> None:
        expected = f"HOST:PORT, such as {DEFAULT_ADDRESS}"
        address, given_way = Address.of(bind, "--bind", expected, lowest_port=0), False
        token, own_keys = token_of(token_file, address), keys_of_client(keys, "viewer")
        folder = None if take is None else take_of_fit(open_source(take), fitted)
        with (
            closing(PageServer(address, token)) as server,
            closing(TakePresenter(connect, own_keys, folder, server.show, results)) as presenter,
        ):
            BROWSERS.set_function(lambda: server.n_browsers)
            preparing = threading.Thread(target=presenter.prepare, daemon=True)
            log.info("coordinator at %s; open %s", connect, _url(address, server.port, token))
            while not stop:
                beat()
                presenter.listen(_READ_S)
                if server.n_browsers and preparing.ident is None:
                    preparing.start()
                # Not before: on 2 busy cores the page would show everything after 58 instead of 44 s.
                if server.has_shown and not given_way:
                    give_way(niceness)
                    given_way = True
                if not server.n_browsers:  # messages wait, and are then read together
                    time.sleep(_REST_S)

    run_service("viewer", work, metrics)


if __name__ == "__main__":
    typer.run(main)
