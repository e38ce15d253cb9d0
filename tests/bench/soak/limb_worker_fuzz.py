"""A limb worker under fire from a coordinator that has lost its mind."""

import time
from pathlib import Path

import msgpack
import zmq

from bench.soak.fire import BREATH_S, BURST, LOOK_S, PATIENCE_S, BrokenServiceError, Memory, sent
from bench.soak.hostile import Frames, Hostile
from bench.soak.sample_messages import sample_messages
from proto.messages import BlobRequest, Hello, Message
from proto.sockets import bind, make_socket, take, wait
from proto.streams import stream_endpoint
from router import receive_from
from services.runs.launcher import Launcher, free_endpoint


def fuzz_limb_worker(folder: Path, hostile: Hostile, seed: int, messages: int) -> float:
    """Play a coordinator that has lost its mind; afterwards the worker must still listen to reason.

    Returns by how much its memory grew, in MiB. Raises BrokenServiceError.
    """
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    router = make_socket(context, zmq.ROUTER)
    endpoint = free_endpoint()
    bind(router, stream_endpoint(endpoint, "tasks"))
    with Launcher(folder) as launcher:
        launcher.start("limb_worker", "--connect", endpoint)
        identity = _await(router, launcher, Hello)
        memory = Memory(launcher, "limb_worker")
        for shot in range(messages):
            frames = [identity, *hostile.next()[1]]
            while not sent(router, frames):
                launcher.watch()
                time.sleep(BREATH_S)
            while take(router) is not None:
                pass
            if shot % BURST == 0:
                launcher.watch()
                memory.look()
        asked = _await(router, launcher, BlobRequest, _task_without_content(identity))
        if asked != identity:
            raise BrokenServiceError(f"--seed {seed}: the worker had to register again")
        growth_mib = memory.growth_mib
    context.destroy(linger=0)
    return growth_mib


def _task_without_content(identity: bytes) -> Frames:
    """A task that names content which the worker cannot have, so that it asks for it."""
    header = msgpack.unpackb(sample_messages("fuzz", 0)["limb_task"][0]) | {"actor": "a" * 64}
    return [identity, msgpack.packb(header), *sample_messages("fuzz", 0)["limb_task"][1:]]


def _await(
    router: "zmq.Socket[bytes]", launcher: Launcher, wanted: type[Message], ask: Frames | None = None
) -> bytes:
    """Who sends a message of a type at last, having been asked for it again and again."""
    deadline_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline_s:
        launcher.watch()
        if ask is not None:
            sent(router, ask)
        wait([router], LOOK_S)
        while (arrived := receive_from(router)) is not None:
            message = arrived[1]
            if isinstance(message, wanted) and getattr(message, "hash", "a" * 64) == "a" * 64:
                return arrived[0]
    raise BrokenServiceError(f"the worker did not send {wanted.type}")
