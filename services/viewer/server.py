"""The page's server, on this machine's loopback only: a page and a thread for every browser.

Never more than one update is on its way to a browser: the next one waits until it has answered the last. So a
slow browser gets fewer updates, but never old ones, and nothing piles up anywhere.
"""

import contextlib
import io
import logging
import threading
import time
from collections.abc import Callable

import viser

from services.mocap.errors import UserError
from services.viewer.address import LOOPBACK
from services.viewer.markup import notice
from services.viewer.metrics import ANSWER
from services.viewer.page_session import PageSession
from services.viewer.show import Show

log = logging.getLogger(__name__)

_TICK_S = 0.04
_ANSWER_S = 5.0
_PANEL_WIDTH_PX = 400


class Page:
    """One browser's page of the current show."""

    def __init__(self, client: viser.ClientHandle, current: Callable[[], Show | None]) -> None:
        self._client, self._current = client, current
        self._session: PageSession | None = None
        self.is_open = True

    @property
    def has_shown(self) -> bool:
        """Whether the browser has received the body, the pictures (if there are any) and the curves."""
        return self._session is not None and self._session.has_shown

    def run(self) -> None:
        """Send updates until the browser is gone or the page is closed."""
        shown: Show | None = None
        try:
            self._wait_for_show()
            while self.is_open:
                show = self._current()
                if show is not None and show is not shown:
                    shown = show
                    self._session = PageSession(self._client, show)
                if self._session is not None and self._session.update():
                    with ANSWER.time():
                        self._await_answer()
                    self._session.note_answer()
        except _GoneError:
            log.info("browser %d is gone", self._client.client_id)
        except UserError as error:
            self._client.gui.add_html(notice(str(error)))
            log.warning("%s", error)
        except Exception:  # ends only this page
            log.exception("the page of browser %d has ended", self._client.client_id)

    def _wait_for_show(self) -> None:
        self._client.gui.set_panel_label("xormocap")
        self._client.gui.main_panel.dock_right()
        self._client.gui.main_panel.set_width(_PANEL_WIDTH_PX)
        if self._current() is None:
            self._client.gui.add_html(notice("Waiting for a take: none is being tracked at the moment."))
        while self.is_open and self._current() is None:
            self._await_answer()
            time.sleep(_TICK_S)

    def _await_answer(self) -> None:
        """Wait until the browser has taken in all that was sent; raises _GoneError where it has left."""
        while self.is_open:
            try:
                self._client.local_storage.get_item("seen", timeout=_ANSWER_S)
            except TimeoutError:
                continue
            except RuntimeError as error:
                if "disconnected" in str(error):
                    raise _GoneError from None
            return


class _GoneError(Exception):
    """The browser has left."""


_END_S = 2.0


class _LocalServer(viser.ViserServer):
    """Never shares the page through an outside server, even if a browser requests it."""

    def request_share_url(self, verbose: bool = True) -> str | None:  # noqa: ARG002  (viser's signature)
        return None


class PageServer:
    """Serves the current show; a context manager."""

    def __init__(self, port: int) -> None:
        """port: 0 for a free one. Raises UserError if it is in use."""
        self._pages: dict[int, tuple[Page, threading.Thread]] = {}
        self._lock = threading.Lock()
        self._show: Show | None = None
        with contextlib.redirect_stdout(io.StringIO()):  # its banner
            self._server = _LocalServer(LOOPBACK, port, "xormocap", verbose=False)
        self.port = self._server.get_port()
        if port not in (0, self.port):
            self.close()
            raise UserError(f"{LOOPBACK}:{port}: the port is in use: choose another port")
        self._server.scene.set_up_direction("+z")
        self._server.gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(30, 110, 190))
        self._server.on_client_connect(self._open)
        self._server.on_client_disconnect(self._leave)

    @property
    def n_browsers(self) -> int:
        """Browsers that show the page."""
        return len(self._pages)

    @property
    def has_shown(self) -> bool:
        """Whether a browser has received all kinds of content."""
        with self._lock:
            return any(page.has_shown for page, _ in self._pages.values())

    def show(self, show: Show) -> None:
        """Set the show for all browsers."""
        self._show = show

    def _open(self, client: viser.ClientHandle) -> None:
        page = Page(client, lambda: self._show)
        thread = threading.Thread(target=page.run, name=f"page-{client.client_id}", daemon=True)
        with self._lock:
            self._pages[client.client_id] = page, thread
        log.info("browser %d opened the page", client.client_id)
        thread.start()

    def _leave(self, client: viser.ClientHandle) -> None:
        with self._lock:
            page, _ = self._pages.pop(client.client_id)
        page.is_open = False

    def close(self) -> None:
        """Close all pages and stop listening."""
        with self._lock:
            pages = list(self._pages.values())
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
