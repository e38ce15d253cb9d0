"""What a pose costs beside its pixels: limbs inside others, and limbs in poses that people seldom take.

Each price is here twice: in pixels for the search, as a quadratic for the alignment. A new one needs a
setting, a module that has both forms, a line in each function here, and its setting in test_pose_prices.py.
If it is to make limbs be searched as well, add it to what contour_search counts as differences.

The normal equations are those of a sum of squares without ½, so a cost adds half its slope and half its
curvature: k x² adds k x and k, and ½ k x² half of that.
"""

from typing import NamedTuple

import numba
import numpy as np

from services.mocap.camera.rig import Rig
from services.mocap.search.alignment.contacts import Contacts, add_contacts, depths_m
from services.mocap.search.pose_prior import PosePrior, add_pose_prior, pose_prior, surprises
from services.mocap.search.settings import SearchSettings
from services.mocap.types import Floats

_CONTACT_WEIGHT = 1e4
"""Of the square of a depth in metres, for each unit of the setting and each camera."""


class PosePrices(NamedTuple):
    """The prices in an alignment, each with its weight, for compiled code."""

    contacts: Contacts
    contact_weight: float
    pose_prior: PosePrior
    pose_prior_weight: float

    @classmethod
    def of(cls, contacts: Contacts, rig: Rig, settings: SearchSettings) -> "PosePrices":
        """Weights grow with the cameras and with the cube of the resolution, as the contours' pull does."""
        unit = _camera_weight(rig, settings) * rig.scale**3
        contact_weight = _CONTACT_WEIGHT * settings.contact * unit
        return cls(contacts, contact_weight, pose_prior(), settings.pose_prior * unit)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def add_prices(
    prices: PosePrices, pose: Floats, T_world_joint: Floats, twists: Floats, hessian: Floats, slope: Floats
) -> None:
    """Add the prices at a pose (D,) to the normal equations (D, D) and (D,) of its alignment."""
    add_contacts(prices.contacts, prices.contact_weight, T_world_joint, twists, hessian, slope)
    add_pose_prior(prices.pose_prior, prices.pose_prior_weight, pose, hessian, slope)


def contact_px(
    contacts: Contacts, offsets_m: Floats, poses: Floats, rig: Rig, settings: SearchSettings
) -> Floats:
    """(N, 4) what limbs (LIMB_NAMES) cost for being inside others in poses (N, D)."""
    depths_cm = 100.0 * depths_m(contacts, offsets_m, poses)
    return np.asarray(settings.contact * _camera_weight(rig, settings) * rig.scale**2 * depths_cm)


def prices_px(
    contacts: Contacts, offsets_m: Floats, poses: Floats, rig: Rig, settings: SearchSettings
) -> Floats:
    """(N,) all prices of poses (N, D) together."""
    unusual_px = settings.pose_prior * _camera_weight(rig, settings) * rig.scale**2 * surprises(poses)
    return np.asarray((contact_px(contacts, offsets_m, poses, rig, settings) + unusual_px).sum(axis=1))


def _camera_weight(rig: Rig, settings: SearchSettings) -> float:
    return float(settings.cost.weights(rig.n_cameras).sum())
