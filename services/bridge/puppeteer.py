"""Follows a coordinator and moves a character in another tool."""

import logging
import math
import time
from collections.abc import Callable

from pythonosc.osc_bundle import OscBundle

from proto.keys import ClientKeys
from proto.messages import Message, Pose, TakeEnd, TakeInfo
from services.bridge import vmc
from services.bridge.humanoid import bones_of
from services.follower import Follower
from services.mocap.body.actor import Actor, build_body
from services.mocap.camera.rig import Rig
from services.mocap.motion.smoothing import OneEuro
from services.mocap.types import Floats

_IDLE_S = 1.0
"""Interval of the messages that nobody is tracked; also the time without a pose before the first."""

log = logging.getLogger(__name__)


class Puppeteer(Follower):
    """Sends each pose, smoothed, when it arrives; skips frames that are missing or late."""

    def __init__(
        self,
        endpoint: str,
        keys: ClientKeys | None,
        send: Callable[[OscBundle], None],
        *,
        take: str | None = None,
        cutoff_hz: float | None = None,
    ) -> None:
        """take: the only one to follow, by its name; None: any. cutoff_hz: see OneEuro; None: as tracked."""
        super().__init__(endpoint, keys)
        self._send, self._wanted, self._cutoff_hz = send, take, cutoff_hz
        self._offsets_m: Floats | None = None
        self._sent_s = -math.inf
        """Time of the last sent message (time.monotonic)."""

    def begin(self, info: TakeInfo) -> None:
        """Start with a new filter."""
        self._offsets_m, self._last_s = None, -math.inf
        self._filter = None if self._cutoff_hz is None else OneEuro(self._cutoff_hz)
        if self._wanted not in (None, info.take):
            log.warning("ignoring take %s, which is not %s", info.take, self._wanted)

    def learn(self, actor: Actor, rig: Rig) -> None:  # noqa: ARG002  (a follower's signature)
        """Take the actor's bones."""
        self._offsets_m = build_body(actor).offsets_m

    def hear(self, message: Message) -> None:
        """Send a pose."""
        if self._wanted not in (None, getattr(message, "take", None)):
            return
        if isinstance(message, TakeEnd):
            self._let_go()
        elif isinstance(message, Pose) and self._offsets_m is not None and message.time_s > self._last_s:
            self._last_s, self._sent_s = message.time_s, time.monotonic()
            pose = message.pose if self._filter is None else self._filter(message.pose, message.time_s)
            bones = bones_of(pose, self._offsets_m)
            self._send(vmc.frame(message.time_s, bones, is_trusted=not message.distrusted))

    def listen(self, timeout_s: float) -> None:
        """See Follower.listen; also reports that nobody is tracked while no poses arrive."""
        super().listen(timeout_s)
        if time.monotonic() - self._sent_s > _IDLE_S:
            self._let_go()

    def _let_go(self) -> None:
        self._sent_s = time.monotonic()
        self._send(vmc.nothing())
