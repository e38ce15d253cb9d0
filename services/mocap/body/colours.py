"""Which colour class each quarter of a segment shows: skin, hair, shirt, trousers, shoes, whatever they are.

A class is a number from 1 on; what it looks like in a camera is learnt from a take
(services.segmentation.colour_classes).
"""

import numpy as np

from services.mocap.body.kinematics import CLOTH_FRAMES
from services.mocap.body.skeleton import SEGMENT_NAMES
from services.mocap.types import Bytes

QUARTERS = 4
"""Pieces of a segment, from its near to its far end, each of one class: a sleeve may end at any of them."""
MOST_CLASSES = 7
"""Three bits hold them."""
SKIRT = "skirt"
"""The name of all cloth that hangs about the legs."""
COLOURED = (*SEGMENT_NAMES, *[SKIRT] * len(CLOTH_FRAMES))
"""(S + 5,) the name of each surface that is drawn."""


def parts_of_classes(classes: Bytes) -> dict[int, str]:
    """By class the segments that show it, in words; classes (S + 5, QUARTERS) as of class_table."""
    parts: dict[int, list[str]] = {}
    for name, of_quarters in zip(COLOURED, classes.tolist(), strict=True):
        words = name.removeprefix("left_").removeprefix("right_").replace("_", " ")
        for number in sorted({*of_quarters} - {0}):
            if words not in parts.setdefault(number, []):
                parts[number].append(words)
    return {number: ", ".join(words) for number, words in sorted(parts.items())}


def check_colours(colours: object) -> object:
    """The colours of a file; raises ValueError for the first error in them."""
    if not isinstance(colours, dict):
        raise ValueError("expected a table of segments")
    for name, classes in colours.items():
        if name not in COLOURED:
            raise ValueError(f"{name} is not a segment; known are {', '.join(dict.fromkeys(COLOURED))}")
        right = isinstance(classes, list | tuple) and len(classes) == QUARTERS
        if not right or not all(isinstance(k, int) and 0 <= k <= MOST_CLASSES for k in classes):
            raise ValueError(
                f"{name} = {classes}: expected {QUARTERS} classes from 1 to {MOST_CLASSES}, 0 where none is "
                "known"
            )
    return colours


def class_table(colours: dict[str, tuple[int, ...]]) -> Bytes:
    """(S + 5, QUARTERS) the class of each piece of each surface; 0 where none is known."""
    nothing = (0,) * QUARTERS
    return np.array([colours.get(name, nothing) for name in COLOURED], np.uint8)
