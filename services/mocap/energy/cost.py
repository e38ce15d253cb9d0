"""The cost of differing pixels: plain XOR, with a weight for each camera."""

from dataclasses import dataclass, field

import numba
import numpy as np

from services.mocap.energy.bitplanes import CAMERAS_PER_PLANE, n_planes
from services.mocap.energy.picture import Picture
from services.mocap.types import Bytes, Floats, Ints, Longs


@dataclass(frozen=True)
class Cost:
    """How differing pixels add up to an energy; the default is the paper's: every one counts 1."""

    camera_weights: tuple[float, ...] = ()
    """One factor per camera; empty: all 1."""
    colour: float = field(default=1.0, compare=False)
    """What a pixel with a wrong colour class costs beside that, in pictures that have classes
    (services.mocap.energy.colours). No backend has to know of it, so it is left out when costs are
    compared."""

    @property
    def is_plain(self) -> bool:
        """Whether it is plain XOR of some cameras: each counts as a whole, or not at all."""
        return set(self.camera_weights) <= {0.0, 1.0}

    def weights(self, n_cameras: int) -> Floats:
        """(C,) weight of each camera's pixels; raises ValueError where their number is not that of
        cameras."""
        if self.camera_weights and len(self.camera_weights) != n_cameras:
            raise ValueError(f"camera_weights: expected {n_cameras}, one per camera, or none")
        return np.array(self.camera_weights or (1.0,) * n_cameras, np.float64)

    def tally(self, picture: Picture) -> "Tally":
        """Convert a picture to the energy that each covered pixel adds.

        Raises ValueError as weights does, or where planes are not of one size.
        """
        n_cameras = len(picture.region.origin_px)
        weights = self.weights(n_cameras)
        # Compiled code tells arrays that may be written to from others: for these it would be compiled again.
        silhouettes = np.require(picture.silhouettes, requirements=("C", "W"))
        ignored = np.require(picture.ignored, requirements=("C", "W"))
        gain = np.empty((n_cameras, *silhouettes.shape[1:]), np.int32)
        if not silhouettes.shape == ignored.shape == (n_planes(n_cameras), *gain.shape[1:]):
            raise ValueError("picture: expected planes of one size")
        blank = np.empty(n_cameras, np.int64)
        _fill(silhouettes, ignored, gain, blank)
        return Tally(gain, blank, weights)


@dataclass(frozen=True, eq=False)
class Tally:
    """A picture as costs: of camera c, E_c pixels differ: blank_c plus the sum of gain_c over all pixels that
    the model covers. The energy is the sum of weights_c E_c."""

    gain: Ints
    """(C, h, w) -1 on the input, 1 off it, 0 where ignored."""
    blank: Longs
    """(C,) how many pixels differ from an empty model."""
    weights: Floats
    """(C,)"""

    def energies(self, per_camera: Longs) -> Floats:
        """Energies (N,), given how many pixels E_c (N, C) of each camera differ."""
        energies: Floats = per_camera @ self.weights
        return energies


@numba.njit(cache=True, nogil=True)
def _fill(silhouettes: Bytes, ignored: Bytes, gain: Ints, blank: Longs) -> None:
    """Write gain and blank of a Tally from planes (P, h, w)."""
    n_cameras, height, width = gain.shape
    for c in range(n_cameras):
        plane, bit, blank[c] = c // CAMERAS_PER_PLANE, c % CAMERAS_PER_PLANE, 0
        for y in range(height):
            on_input, left_out, to = silhouettes[plane, y], ignored[plane, y], gain[c, y]
            n_on = np.int32(0)
            for x in range(width):
                counts = np.int32(1 - (left_out[x] >> bit & 1))
                is_on = np.int32(on_input[x] >> bit & 1)
                to[x] = counts * (1 - 2 * is_on)
                n_on += counts * is_on
            blank[c] += n_on
