"""Silhouettes in front of a green or blue screen: all pixels without the screen's colour, bright or dark."""

from dataclasses import dataclass

import cv2
import numpy as np

from services.mocap.energy.bitplanes import trimap_of
from services.mocap.errors import UserError
from services.mocap.types import Bytes, Floats, Mask, Trimap
from services.segmentation.cleanup import cleanup
from services.segmentation.pixels import Levels

_TURN = np.tan(np.radians(25.0))
"""How far the screen's hue may vary, including folds and mixed light."""
_SATURATION = 0.5
"""Share of the screen's own saturation; paler colours are the actor's."""
_DARKEST = 0.06
"""Brightness, 0 to 1, below which a colour is meaningless."""
_LEAST_COLOUR = 0.25
"""A grey has 0, pure green 0.9: a paler colour is not a screen."""
_BORDER = 0.06
"""Share of the picture's width: how close to the edges the screen is looked for."""
_LEAST_SHARE = 0.4
"""Share of the border that must show the screen."""
_HUE_BINS = 72
_HUE_REACH = 4
"""Bins on each side of the most frequent hue that still belong to the screen: 20 degrees."""


@dataclass(frozen=True, eq=False)
class ChromaKey:
    """Tells a screen of one colour from the actor before it."""

    key: Floats
    """(2,) the screen's Cr and Cb about grey, over its brightness: shadows do not change it."""

    @staticmethod
    def of_colour(colour_bgr: tuple[int, int, int]) -> "ChromaKey":
        """For a screen of a known colour; raises UserError if it is almost grey."""
        chroma, luma = _chroma(np.array([[colour_bgr]], np.uint8))
        if np.linalg.norm(chroma[0, 0]) < _LEAST_COLOUR or luma[0, 0] < _DARKEST:
            blue, green, red = colour_bgr
            raise UserError(
                f"--segmenter chroma:{red:02x}{green:02x}{blue:02x}: is too grey or too dark for a screen: "
                "expected the colour of a green or blue one"
            )
        return ChromaKey(chroma[0, 0].astype(np.float64))

    @staticmethod
    def of_pictures(pictures: Bytes) -> "ChromaKey":
        """For the screen along the edges of pictures (N, H, W, 3); raises UserError if there is none."""
        width_px = max(2, round(_BORDER * pictures.shape[2]))
        edge = np.ones(pictures.shape[1:3], np.bool_)
        edge[width_px:-width_px, width_px:-width_px] = False
        chroma, luma = _chroma(pictures[:, edge])
        chroma, luma = chroma.reshape(-1, 2), luma.ravel()
        coloured = chroma[(np.linalg.norm(chroma, axis=1) >= _LEAST_COLOUR) & (luma >= _DARKEST)]
        hues = np.floor((np.arctan2(coloured[:, 1], coloured[:, 0]) / (2 * np.pi) % 1) * _HUE_BINS)
        counts = np.bincount(hues.astype(int), minlength=_HUE_BINS)
        off = np.abs(hues - int(np.argmax(counts)))
        screen = coloured[np.minimum(off, _HUE_BINS - off) <= _HUE_REACH]
        if len(screen) < _LEAST_SHARE * len(chroma):
            raise UserError(
                f"the edges of its pictures show no screen of one colour ({len(screen) / len(chroma):.0%} of "
                f"them at most, expected {_LEAST_SHARE:.0%}): say the screen's colour with --segmenter "
                "chroma:RRGGBB, or choose another segmenter"
            )
        return ChromaKey(np.median(screen, axis=0).astype(np.float64))

    def trimap(self, image_bgr: Bytes) -> Trimap:
        """See Matte.trimap; no pixel is unsure."""
        return trimap_of(cleanup(~self.screen(image_bgr)))

    def screen(self, image_bgr: Bytes) -> Mask:
        """Where an image (H, W, 3) shows the screen's colour, in light or shadow: a mask (H, W)."""
        chroma, _ = _chroma(image_bgr)
        length = float(np.linalg.norm(self.key))
        cr, cb = (np.float32(part / length) for part in self.key)
        along = chroma[..., 0] * cr + chroma[..., 1] * cb
        across = np.abs(chroma[..., 0] * cb - chroma[..., 1] * cr)
        return np.asarray((along >= np.float32(_SATURATION * length)) & (across <= np.float32(_TURN) * along))


def _chroma(pictures: Bytes) -> tuple[Levels, Levels]:
    """Cr and Cb about grey over the brightness (…, 2), and the brightness (…), 0 to 1, of pictures (…, 3)."""
    flat = np.ascontiguousarray(pictures).reshape(pictures.shape[0], -1, 3)
    converted = np.asarray(cv2.cvtColor(flat.astype(np.float32) / 255, cv2.COLOR_BGR2YCrCb), np.float32)
    converted = converted.reshape(pictures.shape)
    luma: Levels = converted[..., 0]
    brightness = np.maximum(luma, np.float32(_DARKEST))[..., None]
    chroma: Levels = np.asarray((converted[..., 1:] - np.float32(0.5)) / brightness, np.float32)
    return chroma, luma
