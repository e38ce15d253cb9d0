"""Hypothesis strategies for every message, built from the models themselves, so that none is left out."""

from functools import cache
from typing import Annotated, Any

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from pydantic import TypeAdapter

from proto.framing import MAX_HEADER_BYTES
from proto.messages import MESSAGES, Array, Message, arrays_of

_MOST_ITEMS = 6
"""Of a list or map that may be longer: enough to find mistakes, and headers stay short."""
_LONGEST_TEXT = 30


def field_schema(message: type[Message], name: str) -> dict[str, Any]:
    """What a header field may hold, as JSON schema."""
    field = message.model_fields[name]
    annotation: Any = Annotated[field.annotation, *field.metadata] if field.metadata else field.annotation
    return TypeAdapter(annotation).json_schema()


def header_fields(message: type[Message]) -> list[str]:
    """The fields that travel in the header, in their order."""
    return [name for name in message.model_fields if name not in arrays_of(message)]


def _integers(schema: dict[str, Any]) -> st.SearchStrategy[Any]:
    last = schema["exclusiveMaximum"] - 1 if "exclusiveMaximum" in schema else schema["maximum"]
    return st.integers(schema["minimum"], last)


def _numbers(schema: dict[str, Any]) -> st.SearchStrategy[Any]:
    low = schema.get("exclusiveMinimum", schema.get("minimum"))
    return st.floats(
        min_value=low,
        max_value=schema.get("exclusiveMaximum", schema.get("maximum")),
        exclude_min="exclusiveMinimum" in schema,
        exclude_max="exclusiveMaximum" in schema,
        allow_nan=False,
        allow_infinity=False,
    )


def _strings(schema: dict[str, Any]) -> st.SearchStrategy[Any]:
    if "pattern" in schema:
        return st.from_regex(schema["pattern"].replace("$", r"\Z"))
    longest = min(schema.get("maxLength", _LONGEST_TEXT), _LONGEST_TEXT)
    return st.text(min_size=schema.get("minLength", 0), max_size=longest)


def _objects(schema: dict[str, Any]) -> st.SearchStrategy[Any]:
    keys = values_of({"type": "string", **schema["propertyNames"]})
    values = values_of(schema["additionalProperties"])
    return st.dictionaries(keys, values, max_size=min(schema["maxProperties"], _MOST_ITEMS))


def _lists(schema: dict[str, Any]) -> st.SearchStrategy[Any]:
    longest = min(schema.get("maxItems", _MOST_ITEMS), _MOST_ITEMS)
    return st.lists(values_of(schema["items"]), min_size=schema.get("minItems", 0), max_size=longest)


def values_of(schema: dict[str, Any]) -> st.SearchStrategy[Any]:
    """Values that a header field with this schema may have."""
    if "enum" in schema:
        return st.sampled_from(schema["enum"])
    if "anyOf" in schema:
        return st.one_of([values_of(choice) for choice in schema["anyOf"]])
    makers = {
        "boolean": lambda _: st.booleans(),
        "integer": _integers,
        "number": _numbers,
        "string": _strings,
        "object": _objects,
        "array": _lists,
    }
    return makers[schema["type"]](schema)


@cache
def _elements(dtype: np.dtype[Any]) -> st.SearchStrategy[Any]:
    if dtype.kind == "f":
        return st.floats(allow_nan=False, allow_infinity=False)
    return npst.from_dtype(dtype)


@st.composite
def _arrays(draw: st.DrawFn, specs: dict[str, Array]) -> dict[str, Any]:
    """Array fields whose letters stand for one size each."""
    letters = {size for spec in specs.values() for size in spec.shape if isinstance(size, str)}
    sizes: dict[str | int, int] = {letter: draw(st.integers(0, 5)) for letter in sorted(letters)}
    arrays = {}
    for name, spec in specs.items():
        dtype, shape = np.dtype(spec.dtype), tuple(sizes.get(size, size) for size in spec.shape)
        arrays[name] = draw(npst.arrays(dtype, shape, elements=_elements(dtype)))  # type: ignore[arg-type]
    return arrays


@cache
def _header(message: type[Message]) -> st.SearchStrategy[dict[str, Any]]:
    fields = {name: values_of(field_schema(message, name)) for name in header_fields(message)}
    return st.fixed_dictionaries(fields)


@st.composite
def messages(draw: st.DrawFn, types: tuple[type[Message], ...] = tuple(MESSAGES.values())) -> Message:
    """Any message of the given types, arrays and all."""
    message = draw(st.sampled_from(types))
    return message(**draw(_header(message)), **draw(_arrays(arrays_of(message))))


assert _MOST_ITEMS * 10 * (4 * _LONGEST_TEXT + 9 * _MOST_ITEMS) < MAX_HEADER_BYTES
