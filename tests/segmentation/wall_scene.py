"""A made-up scene for one camera: a textured grey wall, discs before it, exposure and noise."""

import cv2
import numpy as np

from services.mocap.types import Bytes, Floats, Mask

HEIGHT, WIDTH = 240, 320
COLOURS = {  # BGR; the wall is a warm to cool grey of about 100 to 170
    "red": (30, 25, 160),
    "navy": (95, 45, 35),
    "skin": (110, 140, 195),
    "black": (18, 18, 20),
    "white": (235, 235, 235),
    "blue-grey": (165, 120, 90),
    "light grey": (205, 205, 205),
    "olive": (60, 110, 105),
}


def wall(seed: int = 0) -> Floats:
    """A textured grey wall above a lighter floor, (H, W, 3)."""
    rng = np.random.default_rng(seed)
    coarse = cv2.GaussianBlur(rng.normal(0, 60, (HEIGHT, WIDTH)), (0, 0), 6)
    picture = (
        np.where(np.arange(HEIGHT)[:, None] < 160, 120.0, 150.0) + coarse + rng.normal(0, 3, coarse.shape)
    )
    picture[:, ::40] -= 15  # joints between slabs
    tinted: Floats = picture[..., None] * np.array([1.04, 1.0, 0.96])
    return tinted


def disc(radius_px: int = 40, centre_px: tuple[int, int] = (160, 100)) -> Mask:
    drawn = np.zeros((HEIGHT, WIDTH), np.uint8)
    cv2.circle(drawn, centre_px, radius_px, 1, thickness=-1)
    return drawn.astype(np.bool_)


def exposed(scene: Floats, rng: np.random.Generator, gain: float = 1.0, noise: float = 2.0) -> Bytes:
    """What a camera makes of a scene: exposure, noise mostly common to the channels, rounding."""
    grain = rng.normal(0, noise, (HEIGHT, WIDTH, 1)) + rng.normal(0, noise / 3, scene.shape)
    return np.clip(np.rint(scene * gain + grain), 0, 255).astype(np.uint8)


def plate_frames(n: int, flicker: float = 0.02, noise: float = 2.0) -> list[Bytes]:
    rng = np.random.default_rng(10)
    return [exposed(wall(), rng, 1 + rng.uniform(-flicker, flicker), noise) for _ in range(n)]


def iou(found: Mask, true: Mask) -> float:
    return float((found & true).sum() / max((found | true).sum(), 1))
