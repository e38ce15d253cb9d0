"""The page's server: a page and a thread for every browser.

Browsers see one address, the proxy's. Behind it are viser, which draws the 3D scene, and the page around it
with its channel; both listen on this machine's loopback only.

Never more than one update is on its way to a browser: the next one waits until it has answered the last. So a
slow browser gets fewer updates, but never old ones, and nothing piles up anywhere.
"""

import contextlib
import io
import logging
import threading
import time
from collections.abc import Callable
from urllib.parse import urlsplit

import viser

from services.address import LOOPBACK, Address
from services.mocap.errors import UserError
from services.viewer.auth_proxy import AuthProxy, Head
from services.viewer.channel import Channel
from services.viewer.metrics import ANSWER
from services.viewer.page_session import PageSession
from services.viewer.show import Show
from services.viewer.web import CHANNEL_PATH, Web

log = logging.getLogger(__name__)

_TICK_S = 0.04
_ANSWER_S = 5.0
_OPEN_S = 0.5
KEY_ELEMENT = "xormocap-key"
SCENE_PATH = "/index.html"
"""Of viser's own page, which the page has in a frame."""


class Page:
    """One browser's page of the current show."""

    def __init__(
        self, client: viser.ClientHandle, channel: Channel, current: Callable[[], Show | None]
    ) -> None:
        self._client, self.channel, self._current = client, channel, current
        self.session: PageSession | None = None
        """Of the current show; None before the first one."""
        self.is_open = True

    def run(self) -> None:
        """Send updates until the browser is gone or the page is closed."""
        try:
            while self.is_open:
                if self.channel.await_open(_OPEN_S):
                    self._work()
                else:
                    self._await_answer()
        except _GoneError:
            log.info("browser %d is gone", self._client.client_id)
        except UserError as error:
            self.channel.send("notice", words=str(error))
            log.warning("%s", error)
        except Exception:  # ends only this page
            log.exception("the page of browser %d has ended", self._client.client_id)

    def _work(self) -> None:
        """Send updates until the channel is opened again, by a browser that has seen nothing yet."""
        shown: Show | None = None
        opened = self.channel.opened
        if self._current() is None:
            self.channel.send("notice", words="Waiting for a take: none is being tracked at the moment.")
        while self.is_open and self.channel.opened == opened:
            show = self._current()
            if show is None:
                time.sleep(_TICK_S)
                self._await_answer()
                continue
            if show is not shown:
                shown = show
                self.session = PageSession(self._client, self.channel, show)
            if self.session is not None and self.session.update():
                with ANSWER.time():
                    self._await_answer()
                self.session.note_answer()

    def _await_answer(self) -> None:
        """Wait until the browser has taken in all that was sent; raises _GoneError where it has left."""
        while self.is_open and not self.channel.await_seen(_ANSWER_S):
            pass
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
    """Serves the current show until `close`."""

    def __init__(self, address: Address, token: str | None = None) -> None:
        """address: where browsers find it. token: what they must give, if anything.

        Raises UserError if the address cannot be used.
        """
        self._pages: dict[int, tuple[Page, threading.Thread]] = {}
        self._lock = threading.Lock()
        self._show: Show | None = None
        self._web = Web()
        with contextlib.redirect_stdout(io.StringIO()):  # its banner
            self._server = _LocalServer(LOOPBACK, 0, "xormocap", verbose=False)
        self._scene_port = self._server.get_port()
        self._server.scene.set_up_direction("+z")
        self._server.gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(30, 110, 190))
        self._server.on_client_connect(self._open)
        self._server.on_client_disconnect(self._leave)
        try:
            self._proxy = AuthProxy(address, token, self._port_for)
        except UserError:
            self._stop_servers()
            raise
        self.port = self._proxy.port

    def _port_for(self, head: Head) -> int:
        """The server that answers a request."""
        path = urlsplit(head.target).path
        is_scene = path == SCENE_PATH or (head.is_websocket and path != CHANNEL_PATH)
        return self._scene_port if is_scene else self._web.port

    @property
    def n_browsers(self) -> int:
        """Browsers that show the page."""
        return len(self._pages)

    @property
    def has_shown(self) -> bool:
        """Whether a browser has received the body, the pictures (if there are any) and a curve."""
        with self._lock:
            return any(
                page.session is not None and page.session.has_shown for page, _ in self._pages.values()
            )

    def show(self, show: Show) -> None:
        """Set the show for all browsers."""
        self._show = show

    def _open(self, client: viser.ClientHandle) -> None:
        page = Page(client, Channel(), lambda: self._show)
        self._web.add(page.channel)
        client.gui.add_html(f'<i id="{KEY_ELEMENT}" data-key="{page.channel.key}"></i>')
        thread = threading.Thread(target=page.run, name=f"page-{client.client_id}", daemon=True)
        with self._lock:
            self._pages[client.client_id] = page, thread
        log.info("browser %d opened the page", client.client_id)
        thread.start()

    def _leave(self, client: viser.ClientHandle) -> None:
        with self._lock:
            page, _ = self._pages.pop(client.client_id)
        page.is_open = False
        self._web.remove(page.channel)

    def close(self) -> None:
        """Close all pages and stop listening."""
        with self._lock:
            pages = list(self._pages.values())
        for page, _ in pages:
            page.is_open = False
            self._web.remove(page.channel)
        for _, thread in pages:
            thread.join(_END_S)
        self._proxy.close()
        self._stop_servers()

    def _stop_servers(self) -> None:
        self._web.close()
        with contextlib.redirect_stdout(io.StringIO()):
            self._server.stop()
