"""Makes and sends messages of the VMC protocol (Virtual Motion Capture, protocol.vmc.info): OSC over UDP."""

import logging
from collections.abc import Callable, Sequence

from pythonosc.osc_bundle import OscBundle
from pythonosc.osc_bundle_builder import IMMEDIATELY, OscBundleBuilder
from pythonosc.osc_message import OscMessage
from pythonosc.osc_message_builder import OscMessageBuilder
from pythonosc.udp_client import UDPClient

from services.address import Address
from services.bridge.humanoid import Bone
from services.mocap.errors import UserError

DEFAULT_LISTENER = "127.0.0.1:39539"
"""Where tools receive VMC by default, on this machine."""
_CALIBRATED, _NORMAL = 3, 0
"""States of a performer's calibration, and its mode."""
_NOWHERE = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)

log = logging.getLogger(__name__)


def nobody_tracked() -> OscBundle:
    """Nobody is tracked."""
    return _bundle([_message("/VMC/Ext/OK", 0, _CALIBRATED, _NORMAL, 0)])


def frame(time_s: float, bones: Sequence[Bone], *, is_trusted: bool) -> OscBundle:
    """A pose, as one packet.

    time_s: in the take. is_trusted: false is sent as tracking status 0 (bad), which came with version 2.7.
    """
    return _bundle(
        [
            _message("/VMC/Ext/OK", 1, _CALIBRATED, _NORMAL, int(is_trusted)),
            _message("/VMC/Ext/T", time_s),
            _message("/VMC/Ext/Root/Pos", "root", *_NOWHERE),
            *(
                _message("/VMC/Ext/Bone/Pos", bone.name, *bone.position_m, *bone.rotation_xyzw)
                for bone in bones
            ),
        ]
    )


def _message(address: str, *values: str | int | float) -> OscMessage:
    builder = OscMessageBuilder(address)
    for value in values:
        builder.add_arg(value)
    return builder.build()


def _bundle(messages: Sequence[OscMessage]) -> OscBundle:
    builder = OscBundleBuilder(IMMEDIATELY)
    for message in messages:
        builder.add_content(message)
    return builder.build()


def open_sender(listener: str) -> Callable[[OscBundle], None]:
    """A function that sends packets to HOST:PORT, whether or not a tool receives them there.

    Raises UserError if that is no address, and for an unknown host.
    """
    address = Address.of(listener, "--vmc", f"HOST:PORT, such as {DEFAULT_LISTENER}")
    try:
        client = UDPClient(address.host, address.port)
    except OSError as error:
        raise UserError(f"--vmc {listener}: host not found ({error}): expected HOST:PORT") from None

    def send(bundle: OscBundle) -> None:
        try:
            client.send(bundle)
        except OSError as error:  # the network is down or busy: drop this pose, the next one is newer
            log.debug("a packet was dropped: %s", error)

    return send
