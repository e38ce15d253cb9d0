"""`xormocap view`: finished results on the page."""

import signal
import threading
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from services.commands.consoles import say
from services.commands.view_show import finished_show
from services.mocap.errors import UserError
from services.viewer.address import LOOPBACK

DEFAULT_PORT = 8080
PortOption = Annotated[
    int, typer.Option(min=0, max=65535, help="The page's port on this machine; 0 takes any that is free.")
]
ViewOption = Annotated[
    bool,
    typer.Option("--view", help="Watch in a browser while it is tracked, and afterwards until Ctrl-C."),
]


def check_page() -> None:
    """Raise UserError where what serves the page is not installed."""
    if find_spec("viser") is None:
        raise UserError("the page needs viser, which is not here: pip install 'xormocap[page]'")


def tell_page(port: int, console: Console) -> str:
    """Say where to look while a take is tracked; returns that as HOST:PORT. Raises as check_page."""
    check_page()
    console.print(f"look at http://{LOOPBACK}:{port}", markup=False, highlight=False, soft_wrap=True)
    return f"{LOOPBACK}:{port}"


def view(
    result: Annotated[Path, typer.Argument(help="What xormocap track --out wrote.", metavar="RESULT")],
    take: Annotated[
        Path | None, typer.Option(help="The take's folder, if it is not where it was tracked.")
    ] = None,
    port: PortOption = DEFAULT_PORT,
) -> None:
    """Show results in a browser: the body, all cameras, curves; until Ctrl-C."""
    check_page()
    from services.viewer.server import PageServer  # what runs without a page has no viser

    show = finished_show(result, take)
    with PageServer(port) as server:
        server.show(show)
        words = f"look at http://{LOOPBACK}:{server.port} (Ctrl-C ends this)"
        say(words)
        wait_for_stop()


def wait_for_stop() -> None:
    """Return after SIGINT or SIGTERM."""
    ended = threading.Event()
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = {number: signal.signal(number, lambda *_: ended.set()) for number in numbers}
    while not ended.wait(0.5):
        pass
    for number, handler in before.items():
        signal.signal(number, handler)
