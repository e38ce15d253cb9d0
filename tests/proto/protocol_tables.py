"""The tables of PROTOCOL.md as they must read, made from the code, so that the document cannot drift."""

import math
from typing import Any

import zmq
from wire_model import field_schema

from field_docstrings import docstrings_of
from proto import framing, sockets
from proto.messages import MESSAGES, Message, Pose, arrays_of
from proto.streams import (
    ASK_AGAIN_S,
    ASK_RECORDERS_AGAIN_S,
    FROM_CLIENTS,
    FROM_LIVE_CAMERAS,
    PUBLISHED,
    RESEND_S,
    STREAMS,
    TO_CLIENTS,
    Flow,
    Stream,
)
from services.coordinator import dispatch
from services.mocap.body.skeleton import DOFS, LOWER, UPPER
from services.mocap.search.chains import LIMBS
from services.mocap.take.quantities import QUANTITIES


def _row(*cells: object) -> str:
    return "| " + " | ".join(str(cell) for cell in cells) + " |"


def _table(head: tuple[str, ...], rows: list[str]) -> str:
    return "\n".join([_row(*head), _row(*["---"] * len(head)), *rows])


def _range(schema: dict[str, Any], low: str, high: str) -> str:
    least, most = schema.get(low, 0), schema.get(high)
    if least == most:
        return str(least)
    if least and most is not None:
        return f"{least} to {most}"
    return f"at most {most}" if most is not None else "any number"


def _number(schema: dict[str, Any]) -> str:
    if "minimum" in schema and "maximum" in schema:
        return f"float, {schema['minimum']:g} to {schema['maximum']:g}"
    parts = ["float"]
    parts += ["at least {}".format(schema["minimum"])] if "minimum" in schema else []
    parts += ["more than {}".format(schema["exclusiveMinimum"])] if "exclusiveMinimum" in schema else []
    parts += ["less than {}".format(schema["exclusiveMaximum"])] if "exclusiveMaximum" in schema else []
    return ", ".join(parts)


def _integer(schema: dict[str, Any]) -> str:
    last = schema["maximum"] if "maximum" in schema else schema["exclusiveMaximum"] - 1
    return f"integer, {schema['minimum']} to {last}"


def _string(schema: dict[str, Any]) -> str:
    if "pattern" in schema:
        return f"string, `{schema['pattern']}`"
    return f"string, {_range(schema, 'minLength', 'maxLength')} characters"


def in_words(schema: dict[str, Any]) -> str:
    """A field's JSON schema as PROTOCOL.md says it."""
    if "enum" in schema:
        return " or ".join(f'`"{choice}"`' for choice in schema["enum"])
    if "anyOf" in schema:
        return "; or ".join(in_words(choice) for choice in schema["anyOf"])
    if schema["type"] == "array":
        return f"array of {_range(schema, 'minItems', 'maxItems')}: {in_words(schema['items'])}"
    if schema["type"] == "object":
        keys, values = (
            in_words({"type": "string", **schema["propertyNames"]}),
            in_words(schema["additionalProperties"]),
        )
        return f"map of at most {schema['maxProperties']}: {keys} → {values}"
    if schema["type"] == "boolean":
        return "boolean"
    return {"integer": _integer, "number": _number, "string": _string}[schema["type"]](schema)


def _type(message: type[Message], name: str) -> str:
    arrays = arrays_of(message)
    if name not in arrays:
        return in_words(field_schema(message, name))
    spec, frame = arrays[name], 1 + list(arrays).index(name)
    return f"frame {frame}: {spec.dtype} ({', '.join(map(str, spec.shape))})"


def carried_by(stream: Stream) -> set[str]:
    """All message types of a stream."""
    return {name for flow in stream.incoming + stream.outgoing for name in flow.types}


def message_section(message: type[Message]) -> str:
    """A message's heading, sentence and table; raises KeyError for a field without a docstring."""
    meanings = docstrings_of(message)
    carriers = " and ".join(
        f"`{name}`" for name, stream in STREAMS.items() if message.type in carried_by(stream)
    )
    lines = [f"### `{message.type}`", "", f"{(message.__doc__ or '').strip()} Stream: {carriers}."]
    rows = [_row(f"`{name}`", _type(message, name), meanings[name]) for name in message.model_fields]
    if rows:
        lines += ["", _table(("field", "type", "meaning"), rows)]
    return "\n".join(lines)


def message_sections() -> dict[str, str]:
    """All messages' sections by type."""
    return {name: message_section(message) for name, message in MESSAGES.items()}


def _socket_name(kind: int) -> str:
    return str(zmq.SocketType(kind).name)


def _types(flows: tuple[Flow, ...]) -> str:
    return ", ".join(f"`{name}`" for flow in flows for name in flow.types) or "nothing"


def streams_table() -> str:
    """Ports, socket kinds and message types."""
    rows = [
        _row(
            f"`{name}`",
            f"first port + {stream.port_offset}",
            _socket_name(stream.coordinator),
            _socket_name(stream.client),
            _types(stream.incoming),
            _types(stream.outgoing),
        )
        for name, stream in STREAMS.items()
    ]
    head = (
        *("stream", "port", "coordinator binds", "client connects"),
        *("towards the coordinator", "from the coordinator"),
    )
    return _table(head, rows)


def _degrees(limit_rad: float) -> str:
    return "none" if math.isinf(limit_rad) else f"{math.degrees(limit_rad):.0f}°"


def pose_table() -> str:
    """The parameters in their order."""
    rows = [
        _row(
            k,
            f"`{dof.column}`",
            f"`{dof.joint}`",
            dof.role,
            "({})".format(", ".join(f"{x + 0.0:g}" for x in dof.axis)),
            _degrees(LOWER[k]),
            _degrees(UPPER[k]),
        )
        for k, dof in enumerate(DOFS)
    ]
    return _table(("index", "column of poses.csv", "joint", "role", "axis", "from", "to"), rows)


def quantities_table() -> str:
    """What `measured` of a pose message holds, from the table that the results' files are made from."""
    rows = [
        _row(
            f"`{row.name}`",
            {"frame": "one", "part": "one per part", "camera": "one per camera"}[row.per],
            "0 to 1" if row.most == 1.0 else row.unit.replace("1", "number"),
            row.meaning,
        )
        for row in QUANTITIES
        if row.name not in Pose.model_fields
    ]
    return _table(("name", "numbers", "range or unit", "meaning"), rows)


def limbs_table() -> str:
    """Which parameters a limb's result holds."""
    rows = [_row(f"`{name}`", len(limb.dofs), ", ".join(map(str, limb.dofs))) for name, limb in LIMBS.items()]
    return _table(("limb", "d", "indices in the pose"), rows)


def numbers_table() -> str:
    """Every limit and time that an integrator has to know."""
    rows = [
        _row("header, at most", f"{framing.MAX_HEADER_BYTES} bytes"),
        _row("entries of a list or map in a header, at most", framing.MAX_ENTRIES),
        _row("array frame, at most", f"{framing.MAX_FRAME_BYTES} bytes"),
        _row("any frame to the coordinator on `tasks`, at most", f"{sockets.MAX_REPLY_BYTES} bytes"),
        _row("messages queued for sending, per peer", sockets.QUEUE_MESSAGES),
        _row("silhouettes queued by the coordinator, per peer", sockets.QUEUE_MESSAGES),
        _row("ZMTP ping, every", f"{sockets.PING_INTERVAL_MS} ms"),
        _row("ZMTP ping unanswered, connection closed after", f"{sockets.PING_TIMEOUT_MS} ms"),
        _row("`beat` from a client that has nothing else to say, every", f"{FROM_CLIENTS.every_s:g} s"),
        _row("`beat` from the coordinator to every worker, every", f"{TO_CLIENTS.every_s:g} s"),
        _row("silence of the coordinator, a client registers anew after", f"{TO_CLIENTS.silence_s:g} s"),
        _row(
            "silence after which an idle worker gets no task until it is heard again",
            f"{FROM_CLIENTS.silence_s:g} s",
        ),
        _row("what `poses` repeats for those who join late, every", f"{PUBLISHED.every_s:g} s"),
        _row("`live_sources` from a segmentation, every", f"{FROM_LIVE_CAMERAS.every_s:g} s"),
        _row("missing content or frames, a client asks for them again after", f"{ASK_AGAIN_S:g} s"),
        _row(
            "missing poses, the coordinator asks recorders for them again after",
            f"{ASK_RECORDERS_AGAIN_S:g} s",
        ),
        _row("frames that `credit` still asks for, sent again after", f"{RESEND_S:g} s"),
        _row("silence after which a live segmentation counts as gone", f"{FROM_LIVE_CAMERAS.silence_s:g} s"),
        _row("deadline of the first task", f"{dispatch.FIRST_DEADLINE_S:g} s"),
        _row(
            "deadline of others",
            f"{dispatch.DEADLINE_FLOOR_S:g} s + the mean duration of tasks + {dispatch.DEADLINE_FACTOR:g} × "
            "its mean deviation (moving averages)",
        ),
    ]
    return _table(("limit", "value"), rows)
