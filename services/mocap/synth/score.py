"""A score: the body's movements as a few key values per channel over time, joined smoothly.

Between keys a channel never leaves their range, so that keys within the joint limits make a motion within
them.
"""

from collections import defaultdict

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import gaussian_filter1d

from services.mocap.types import Floats

_SOFTEN_S = 0.05
"""Standard deviation of the smoothing that takes the kinks of acceleration out of the joined keys."""


class Score:
    """Keys of named channels; a channel holds its first value before all its keys, its last after them."""

    def __init__(self, rest: dict[str, float]) -> None:
        """Begin at time 0 with a value for every channel there will be."""
        self._keys: dict[str, dict[float, float]] = defaultdict(dict)
        for channel, value in rest.items():
            self._keys[channel][0.0] = value

    def put(self, time_s: float, **values: float) -> None:
        """Set keys at one time, not before the channel's last one; a second key at that time replaces it."""
        for channel, value in values.items():
            keys = self._keys[channel]
            if time_s < max(keys):
                raise ValueError(f"{channel}: a key at {time_s:.3f} s after one at {max(keys):.3f} s")
            keys[time_s] = value

    def hold(self, time_s: float, *channels: str) -> None:
        """Keep channels at their last values until a time."""
        self.put(time_s, **{channel: self.last(channel) for channel in channels})

    def last(self, channel: str) -> float:
        """A channel's value at its last key."""
        return self._keys[channel][max(self._keys[channel])]

    def play(self, channel: str, time_s: Floats) -> Floats:
        """The channel's values at (N,) times in equal steps, smooth, within the range of its keys."""
        keys = self._keys[channel]
        first, *_, last = [0.0, *keys]
        # Held for a while on both sides, so that it leaves its first key and comes to its last one at rest.
        at_s = np.array([first - 1.0, *keys, last + 1.0])
        values = np.array([keys[first], *keys.values(), keys[last]])
        joined = PchipInterpolator(at_s, values)(np.clip(time_s, at_s[0], at_s[-1]))
        sigma = _SOFTEN_S / float(time_s[1] - time_s[0])
        smooth: Floats = gaussian_filter1d(joined, sigma, mode="nearest", truncate=3.0)
        return smooth
