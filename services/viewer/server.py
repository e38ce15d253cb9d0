"""The page's server: on this machine's loopback only, with a page and a thread for every browser."""

import contextlib
import io
import logging
import threading

import viser

from services.mocap.errors import UserError
from services.viewer.address import LOOPBACK
from services.viewer.page import Page
from services.viewer.show import Show

log = logging.getLogger(__name__)

_END_S = 2.0


class _LocalServer(viser.ViserServer):
    """Never asks anybody outside to pass the page on, whatever a browser wants."""

    def request_share_url(self, verbose: bool = True) -> str | None:  # noqa: ARG002  (viser's signature)
        return None


class PageServer:
    """Serves whatever show it holds; a context manager."""

    def __init__(self, port: int) -> None:
        """Port: 0 for any that is free. Raises UserError where it is taken."""
        with contextlib.redirect_stdout(io.StringIO()):  # its banner
            self._server = _LocalServer(LOOPBACK, port, "xormocap", verbose=False)
        self.port = self._server.get_port()
        if port not in (0, self.port):
            self.close()
            raise UserError(f"{LOOPBACK}:{port}: something listens there already: choose another port")
        self._pages: dict[int, tuple[Page, threading.Thread]] = {}
        self._lock = threading.Lock()
        self._show: Show | None = None
        self._server.scene.set_up_direction("+z")
        self._server.gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(30, 110, 190))
        self._server.on_client_connect(self._open)
        self._server.on_client_disconnect(self._leave)

    @property
    def n_browsers(self) -> int:
        """Browsers that look at the page."""
        return len(self._pages)

    @property
    def has_shown(self) -> bool:
        """Whether a browser that looks at the page has got all kinds of things to see."""
        with self._lock:
            return any(page.has_shown for page, _ in self._pages.values())

    def show(self, show: Show) -> None:
        """What all browsers see from now on."""
        self._show = show

    def _open(self, client: viser.ClientHandle) -> None:
        page = Page(client, lambda: self._show)
        thread = threading.Thread(target=page.run, name=f"page-{client.client_id}", daemon=True)
        with self._lock:
            self._pages[client.client_id] = page, thread
        log.info("browser %d looks at the page", client.client_id)
        thread.start()

    def _leave(self, client: viser.ClientHandle) -> None:
        with self._lock:
            page, _ = self._pages.pop(client.client_id)
        page.is_open = False

    def close(self) -> None:
        """Close all pages and stop listening."""
        with getattr(self, "_lock", threading.Lock()):
            pages = list(getattr(self, "_pages", {}).values())
        for page, _ in pages:
            page.is_open = False
        for _, thread in pages:
            thread.join(_END_S)
        with contextlib.redirect_stdout(io.StringIO()):
            self._server.stop()

    def __enter__(self) -> "PageServer":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
