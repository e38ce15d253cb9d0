"""Messages to frames and back. Everything that arrives is checked before it is used."""

import math
from collections.abc import Mapping
from functools import cache
from typing import Any

import msgpack
import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from proto.messages import MESSAGES, PROTOCOL_VERSION, Array, Message, arrays_of

MAX_HEADER_BYTES = 64 * 1024
MAX_FRAME_BYTES = 64 * 1024 * 1024
MAX_ENTRIES = 1000
"""Of any list or map in a header: checking tens of thousands would take too much of a receiver's time."""
_LONGEST_NAME = 60


class MalformedMessage(Exception):  # noqa: N818  (what arrived, not what went wrong here)
    """The frames are not a message of this protocol; the text says why."""


def encode(message: Message) -> list[bytes | memoryview]:
    """Turn a message into its frames: a msgpack header, then one raw frame per array.

    Raises MalformedMessage for content that every receiver would refuse, such as a wrong shape or a NaN.
    """
    arrays = arrays_of(type(message))
    header: dict[str, Any] = {"v": PROTOCOL_VERSION, "type": message.type}
    header |= {name: getattr(message, name) for name in type(message).model_fields if name not in arrays}
    header["shapes"] = [list(getattr(message, name).shape) for name in arrays]
    _bind_sizes(message.type, arrays, header["shapes"])
    frames: list[bytes | memoryview] = []
    for name, spec in arrays.items():
        where, array = f"{message.type}.{name}", getattr(message, name)
        if array.dtype != np.dtype(spec.dtype):
            raise MalformedMessage(f"{where}: expected an array of {spec.dtype}, got {array.dtype}")
        _check_content(where, array)
        array = np.ascontiguousarray(array, _wire_dtype(spec))
        frames.append(array.data.cast("B") if array.size else b"")
    packed = msgpack.packb(header)
    if len(packed) > MAX_HEADER_BYTES:
        raise MalformedMessage(f"{message.type}: a header of {len(packed)} bytes; at most {MAX_HEADER_BYTES}")
    return [packed, *frames]


def decode(frames: list[bytes]) -> Message:
    """Turn frames into the message that they hold; raises MalformedMessage with the reason."""
    header = _decode_header(frames)
    version = header.pop("v", None)
    if type(version) is not int or version != PROTOCOL_VERSION:
        raise MalformedMessage(f"protocol version is not {PROTOCOL_VERSION}")
    name = header.pop("type", None)
    message_type = MESSAGES.get(name) if isinstance(name, str) else None
    if message_type is None:
        raise MalformedMessage("unknown message type")
    specs, shapes = arrays_of(message_type), header.pop("shapes", None)
    if not isinstance(shapes, list) or len(shapes) != len(specs) or len(frames) != 1 + len(specs):
        raise MalformedMessage(f"{name}: expected {len(specs)} arrays")
    _bind_sizes(str(name), specs, shapes)
    for (field, spec), shape, frame in zip(specs.items(), shapes, frames[1:], strict=True):
        if field in header:
            raise MalformedMessage(f"{name}.{field}: belongs in its own frame, not in the header")
        header[field] = _decode_array(f"{name}.{field}", spec, shape, frame)
    for field in message_type.model_fields:  # defaults are for building a message
        if field not in header:
            raise MalformedMessage(f"{name}.{field}: Field required")
    try:
        return message_type.model_validate(header)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        where = ".".join(str(part) for part in first["loc"])
        # A sender's own words: for a log on one line, and not too long.
        where = repr(where)[1:-1][:_LONGEST_NAME]
        raise MalformedMessage(f"{name}.{where}: {first['msg']}") from None


def _decode_header(frames: list[bytes]) -> dict[str, Any]:
    if not frames or len(frames[0]) > MAX_HEADER_BYTES:
        raise MalformedMessage("the header is missing or too long")
    try:
        header = msgpack.unpackb(
            frames[0], strict_map_key=True, max_array_len=MAX_ENTRIES, max_map_len=MAX_ENTRIES
        )
    except (ValueError, msgpack.exceptions.UnpackException, RecursionError) as error:
        if "exceeds max_" in str(error):
            raise MalformedMessage(f"header holds a list or map of more than {MAX_ENTRIES} entries") from None
        raise MalformedMessage("header is not msgpack") from None
    if not isinstance(header, dict) or not all(isinstance(key, str) for key in header):
        raise MalformedMessage("header is not a map with string keys")
    return header


def _bind_sizes(name: str, specs: Mapping[str, Array], shapes: list[Any]) -> None:
    """Check shapes against their specifications; a letter must have one size throughout."""
    sizes: dict[str, int] = {}
    for (field, spec), shape in zip(specs.items(), shapes, strict=True):
        if not isinstance(shape, list) or len(shape) != len(spec.shape):
            raise MalformedMessage(f"{name}.{field}: expected {len(spec.shape)} dimensions")
        for wanted, size in zip(spec.shape, shape, strict=True):
            if type(size) is not int or not 0 <= size <= MAX_FRAME_BYTES:
                raise MalformedMessage(f"{name}.{field}: a size is not an integer in range")
            expected = wanted if isinstance(wanted, int) else sizes.setdefault(wanted, size)
            if size != expected:
                raise MalformedMessage(f"{name}.{field}: size {size} where {wanted} is {expected}")


def _decode_array(name: str, spec: Array, shape: list[int], frame: bytes) -> NDArray[Any]:
    dtype = _wire_dtype(spec)
    expected = math.prod(shape, start=dtype.itemsize)
    if expected > MAX_FRAME_BYTES or len(frame) != expected:
        raise MalformedMessage(f"{name}: {len(frame)} bytes where the shape needs {expected}")
    array = np.frombuffer(frame, dtype).reshape(shape)
    _check_content(name, array)
    return array


def _check_content(name: str, array: NDArray[Any]) -> None:
    if array.nbytes > MAX_FRAME_BYTES:
        raise MalformedMessage(f"{name}: {array.nbytes} bytes; at most {MAX_FRAME_BYTES}")
    if array.dtype.kind == "f" and not np.isfinite(array).all():
        raise MalformedMessage(f"{name}: holds a number that is not finite")


@cache
def _wire_dtype(spec: Array) -> np.dtype[Any]:
    return np.dtype(spec.dtype).newbyteorder("<")
