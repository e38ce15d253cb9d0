"""What the synthetic actor wears: a colour for every vertex of the body."""

import numpy as np

from services.mocap.body.actor import Body
from services.mocap.body.skeleton import SEGMENTS
from services.mocap.types import Floats

_SKIN = (138.0, 168.0, 214.0)
_SHIRT = (52.0, 96.0, 206.0)
_TROUSERS = (122.0, 74.0, 46.0)
_SHOES = (44.0, 46.0, 52.0)
_HAIR = (34.0, 48.0, 66.0)
_BELT = (30.0, 34.0, 40.0)

_PLAIN = {"shirt": _SHIRT, "skin": _SKIN, "trousers": _TROUSERS, "shoes": _SHOES}


def dress(body: Body) -> Floats:
    """BGR (V, 3) in grey levels under full light, for the vertices of all segments one after the other."""
    rng = np.random.default_rng(7)  # the weave of the cloth; the same in every take
    colours = []
    for segment, vertices_m in zip(SEGMENTS, body.vertices_m, strict=True):
        kind = segment.row.name
        bgr = np.tile(_PLAIN[segment.row.garment], (len(vertices_m), 1))
        x, y, z = vertices_m.T / body.height_m
        if kind == "upper_arm":
            bgr[np.abs(y) > 0.095] = _SKIN  # short sleeves
        elif kind == "pelvis":
            bgr[z > 0.042] = _BELT
            bgr[z > 0.058] = _SHIRT
        elif kind == "head":
            bgr[(z > 0.072) | (z - 0.9 * x > 0.052)] = _HAIR
        colours.append(bgr * rng.normal(1.0, 0.025, (len(bgr), 1)))
    return np.concatenate(colours)
