"""Sends VMC packets to a tool."""

import logging
from collections.abc import Callable
from urllib.parse import urlsplit

from pythonosc.osc_bundle import OscBundle
from pythonosc.udp_client import UDPClient

from services.mocap.errors import UserError

DEFAULT_LISTENER = "127.0.0.1:39539"
"""Where tools receive VMC by default, on this machine."""

log = logging.getLogger(__name__)


def address_of(text: str) -> tuple[str, int]:
    """Parse HOST:PORT; raises UserError if it is malformed."""
    try:
        parts = urlsplit(f"//{text}")
        host, port = parts.hostname, parts.port
    except ValueError:
        host = port = None
    if not host or not port or parts.path or parts.username is not None:
        raise UserError(f"--vmc {text}: expected HOST:PORT, such as {DEFAULT_LISTENER}")
    return host, port


def open_sender(host: str, port: int) -> Callable[[OscBundle], None]:
    """A function that sends packets there, whether or not a tool receives them; raises UserError for an
    unknown host."""
    try:
        client = UDPClient(host, port)
    except OSError as error:
        raise UserError(f"--vmc {host}:{port}: host not found ({error}): expected HOST:PORT") from None

    def send(bundle: OscBundle) -> None:
        try:
            client.send(bundle)
        except OSError as error:  # the network is down or busy: drop this pose, the next one is newer
            log.debug("a packet was dropped: %s", error)

    return send
