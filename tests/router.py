"""The coordinator's end of the tasks stream, as tests play it."""

import zmq

from proto.framing import decode
from proto.messages import Message
from proto.sockets import take


def receive_from(router: "zmq.Socket[bytes]") -> tuple[bytes, Message] | None:
    """Take one waiting message and its sender's identity, or None; raises MalformedMessage."""
    taken = take(router)
    return None if taken is None else (taken[0][0], decode(taken[0][1:]))
