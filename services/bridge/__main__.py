"""Bridge process: `python -m services.bridge --connect tcp://HOST:5550 --vmc 127.0.0.1:39539`."""

import logging
import math
import time
from collections.abc import Callable
from contextlib import closing
from typing import Annotated

import typer
from pythonosc.osc_bundle import OscBundle

from proto.keys import ClientKeys
from proto.messages import Message, Pose, TakeEnd, TakeInfo
from proto.streams import DEFAULT_ENDPOINT
from services.bridge.humanoid import bones_of
from services.bridge.vmc import DEFAULT_LISTENER, frame, nobody_tracked, open_sender
from services.follower import Follower
from services.health import beat
from services.mocap.body.actor import Actor, build_body
from services.mocap.camera.rig import Rig
from services.mocap.motion.settings import ONE_EURO_HZ
from services.mocap.motion.smoothing import OneEuro
from services.mocap.types import Floats
from services.options import KeysOption, keys_of_client
from services.process import StopRequest, run_service

_IDLE_CHECK_S = 0.1
_IDLE_S = 1.0
"""Interval of the messages that nobody is tracked; also the time without a pose before the first."""

log = logging.getLogger(__name__)


class PoseSender(Follower):
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

    def on_take(self, info: TakeInfo) -> None:
        """Start with a new filter."""
        self._offsets_m, self._last_s = None, -math.inf
        self._filter = None if self._cutoff_hz is None else OneEuro(self._cutoff_hz)
        if self._wanted not in (None, info.take):
            log.warning("ignoring take %s, which is not %s", info.take, self._wanted)

    def on_content(self, actor: Actor, rig: Rig) -> None:  # noqa: ARG002  (a follower's signature)
        """Take the actor's bones."""
        self._offsets_m = build_body(actor).offsets_m

    def on_message(self, message: Message) -> None:
        """Send a pose."""
        if self._wanted not in (None, getattr(message, "take", None)):
            return
        if isinstance(message, TakeEnd):
            self._send_nobody_tracked()
        elif isinstance(message, Pose) and self._offsets_m is not None and message.time_s > self._last_s:
            self._last_s, self._sent_s = message.time_s, time.monotonic()
            pose = message.pose if self._filter is None else self._filter(message.pose, message.time_s)
            bones = bones_of(pose, self._offsets_m)
            self._send(frame(message.time_s, bones, is_trusted=not message.distrusted))

    def listen(self, timeout_s: float) -> None:
        """See Follower.listen; also reports that nobody is tracked while no poses arrive."""
        super().listen(timeout_s)
        if time.monotonic() - self._sent_s > _IDLE_S:
            self._send_nobody_tracked()

    def _send_nobody_tracked(self) -> None:
        self._sent_s = time.monotonic()
        self._send(nobody_tracked())


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
        own_keys, send = keys_of_client(keys, "viewer"), open_sender(vmc)
        sender = PoseSender(connect, own_keys, send, take=take, cutoff_hz=cutoff_hz or None)
        log.info("coordinator at %s; sending VMC to %s", connect, vmc)
        with closing(sender):
            while not stop:
                beat()
                sender.listen(_IDLE_CHECK_S)

    run_service("bridge", work)


if __name__ == "__main__":
    typer.run(bridge)
