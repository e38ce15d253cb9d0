"""Text in pictures."""

from bisect import bisect_right

import cv2

from services.mocap.types import Bytes

WHITE_BGR = (255, 255, 255)
_DOTS, _MARGIN_PX = "...", 4
"""The end of text that is cut off, and the room beside it. OpenCV before 5 draws ASCII letters only."""


def write_text(
    picture: Bytes, text: str, origin_px: tuple[int, int], colour_bgr: tuple[int, int, int], scale: float
) -> int:
    """Write with a shadow, from the left end of the base line on; returns the x where the text ends.

    Text that is too long for the picture ends in three dots.
    """
    (x, y), font = origin_px, cv2.FONT_HERSHEY_SIMPLEX

    def end(words: str) -> int:
        return x + int(cv2.getTextSize(words, font, scale, 1)[0][0])

    room = picture.shape[1] - _MARGIN_PX
    if end(text) > room:
        fitting = bisect_right(range(1, len(text)), room, key=lambda n: end(text[:n].rstrip() + _DOTS))
        text = text[:fitting].rstrip() + _DOTS if fitting else ""
    cv2.putText(picture, text, (x + 1, y + 1), font, scale, (0, 0, 0), 1, cv2.LINE_AA)
    cv2.putText(picture, text, origin_px, font, scale, colour_bgr, 1, cv2.LINE_AA)
    return end(text)
