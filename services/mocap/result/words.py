"""The words for the numbers of a result, the same in every place that shows them."""

from typing import Any

ENERGY_IN_WORDS = (
    "Energy: the pixels, over all cameras, in which model and silhouettes differ. 0 is perfect; 5 to 14 % of "
    "the silhouettes' pixels is usual, 20 % in wide clothes."
)
IOU_IN_WORDS = (
    "IoU, intersection over union: the pixels that model and silhouette share, as a share of those that "
    "either covers. 1 is perfect; 0.87 to 0.95 is usual, 0.82 in wide clothes."
)


def rate_in_words(frames_per_s: float) -> str:
    """How many frames are tracked in a second."""
    return f"{frames_per_s:.1f} frames per second"


def accuracy_in_words(accuracy: dict[str, Any]) -> str:
    """The joint error of a run.json."""
    return f"mean {accuracy['mean_mm']:.1f} mm, 95 % below {accuracy['p95_mm']:.1f} mm"
