"""Messages to frames and back. Whatever comes in is checked before anything trusts it."""

from typing import Any

import msgpack
import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from proto.messages import MESSAGES, PROTOCOL_VERSION, Array, Message, arrays_of

MAX_HEADER_BYTES = 64 * 1024
MAX_FRAME_BYTES = 64 * 1024 * 1024
_MAX_DIMENSIONS = 4


class MalformedMessage(Exception):  # noqa: N818  (what arrived, not what went wrong here)
    """Frames that are no message of this protocol; the text says why."""


def encode(message: Message) -> list[bytes | memoryview]:
    """Turn a message into its frames: a msgpack header, then one raw frame per array."""
    arrays = arrays_of(type(message))
    header: dict[str, Any] = {"v": PROTOCOL_VERSION, "type": message.type}
    header |= {name: getattr(message, name) for name in type(message).model_fields if name not in arrays}
    frames = []
    shapes = []
    for name, spec in arrays.items():
        array: NDArray[Any] = np.ascontiguousarray(getattr(message, name), _wire_dtype(spec))
        shapes.append(list(array.shape))
        frames.append(array.data.cast("B") if array.size else b"")
    _bind_sizes(message.type, arrays, shapes)
    header["shapes"] = shapes
    return [msgpack.packb(header), *frames]


def decode(frames: list[bytes]) -> Message:
    """Turn frames into the message that they hold; raises MalformedMessage with the reason."""
    header = _decode_header(frames)
    if header.pop("v", None) != PROTOCOL_VERSION:
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
        header[field] = _decode_array(f"{name}.{field}", spec, shape, frame)
    try:
        return message_type.model_validate(header)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        where = ".".join(str(part) for part in first["loc"])
        raise MalformedMessage(f"{name}.{where}: {first['msg']}") from None


def _decode_header(frames: list[bytes]) -> dict[str, Any]:
    if not frames or len(frames[0]) > MAX_HEADER_BYTES:
        raise MalformedMessage("no header, or one that is too long")
    try:
        header = msgpack.unpackb(frames[0], strict_map_key=True)
    except (ValueError, msgpack.exceptions.UnpackException, RecursionError):
        raise MalformedMessage("header is not msgpack") from None
    if not isinstance(header, dict) or not all(isinstance(key, str) for key in header):
        raise MalformedMessage("header is not a map with names as keys")
    return header


def _bind_sizes(name: str, specs: dict[str, Array], shapes: list[Any]) -> None:
    """Check shapes against their specifications; a letter must stand for one size only."""
    sizes: dict[str, int] = {}
    for (field, spec), shape in zip(specs.items(), shapes, strict=True):
        if not isinstance(shape, list) or len(shape) != len(spec.shape) or len(shape) > _MAX_DIMENSIONS:
            raise MalformedMessage(f"{name}.{field}: expected {len(spec.shape)} dimensions")
        for wanted, size in zip(spec.shape, shape, strict=True):
            if type(size) is not int or not 0 <= size <= MAX_FRAME_BYTES:
                raise MalformedMessage(f"{name}.{field}: a size is not a whole number in range")
            expected = wanted if isinstance(wanted, int) else sizes.setdefault(wanted, size)
            if size != expected:
                raise MalformedMessage(f"{name}.{field}: size {size} where {wanted} is {expected}")


def _decode_array(name: str, spec: Array, shape: list[int], frame: bytes) -> NDArray[Any]:
    dtype = _wire_dtype(spec)
    expected = dtype.itemsize
    for size in shape:
        expected *= size
    if expected > MAX_FRAME_BYTES or len(frame) != expected:
        raise MalformedMessage(f"{name}: {len(frame)} bytes where the shape needs {expected}")
    array = np.frombuffer(frame, dtype).reshape(shape)
    if dtype.kind == "f" and not np.isfinite(array).all():
        raise MalformedMessage(f"{name}: holds a number that is not finite")
    return array


def _wire_dtype(spec: Array) -> np.dtype[Any]:
    return np.dtype(spec.dtype).newbyteorder("<")
