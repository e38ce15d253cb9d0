"""The page of one browser: a thread that sends it what its user wants to see, as fast as it keeps up.

Never more than one update is on its way: the next one waits until the browser has answered the last. So a
slow browser gets fewer updates, but never old ones, and nothing piles up anywhere.
"""

import logging
import time
from collections.abc import Callable

import viser

from services.mocap.errors import UserError
from services.viewer.markup import notice
from services.viewer.metrics import ANSWER
from services.viewer.page_session import PageSession
from services.viewer.show import Show

log = logging.getLogger(__name__)

_TICK_S = 0.04
_ANSWER_S = 5.0
_PANEL_WIDTH_PX = 400


class Page:
    """One browser's page of whatever show there is."""

    def __init__(self, client: viser.ClientHandle, current: Callable[[], Show | None]) -> None:
        self._client, self._current = client, current
        self._session: PageSession | None = None
        self.is_open = True

    @property
    def has_shown(self) -> bool:
        """Whether the browser has had the body, pictures where there are any, and curves."""
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
        except _Gone:
            log.info("browser %d is gone", self._client.client_id)
        except UserError as error:
            self._client.gui.add_html(notice(str(error)))
            log.warning("%s", error)
        except Exception:  # of one page only
            log.exception("the page of browser %d has ended", self._client.client_id)

    def _wait_for_show(self) -> None:
        self._client.gui.set_panel_label("xormocap")
        self._client.gui.main_panel.dock_right()
        self._client.gui.main_panel.set_width(_PANEL_WIDTH_PX)
        if self._current() is None:
            self._client.gui.add_html(notice("Waiting for a take: nobody tracks one at the moment."))
        while self.is_open and self._current() is None:
            self._await_answer()
            time.sleep(_TICK_S)

    def _await_answer(self) -> None:
        """Wait until the browser has taken in all that was sent; raises _Gone where it has left."""
        while self.is_open:
            try:
                self._client.local_storage.get_item("seen", timeout=_ANSWER_S)
            except TimeoutError:
                continue
            except RuntimeError as error:
                if "disconnected" in str(error):
                    raise _Gone from None
            return


class _Gone(Exception):  # noqa: N818  (no error)
    """The browser has left."""
