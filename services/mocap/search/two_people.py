"""Who of two people in a frame is the actor: the one clearly nearer to where the actor should be."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.distance import pdist

from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes, pack, unpack
from services.mocap.search.agreement import Agreement
from services.mocap.search.other_people import told_apart
from services.mocap.types import Floats, Mask

_SECOND_SHARE = 0.12
"""Share of the silhouettes that only a second person covers; phantom and small pieces of the hull cover
almost nothing."""
_LEAST_PERSON_M, _PIECES_WITHIN_M = 0.8, 0.6
"""Of two people, each is at least so high; the pieces of one whom something hides in part are low, or so near
to each other."""
_CLEARLY_NEARER_M = 0.4
"""Of two people, the actor is nearer to the middle by more than this."""
_LOW = 0.7
"""Lower than this share of the other one, the one nearer to the middle may be furniture."""
_LEAST_OTHERS = 0.05
"""Share of the silhouettes that others have at least."""


@dataclass(frozen=True, eq=False)
class Places:
    """Where people are on the floor, as far as it is known: x and y in the world."""

    actor_m: Floats | None = None
    """(2,) by default in the middle of what the cameras look at."""
    others_m: Floats | None = None
    """(2,)"""
    are_recent: bool = True
    """Whether who is seen there now can only be the same one."""

    def is_nearer_to_others(self, place_m: Floats) -> bool:
        """Whether a place (2,) is nearer to where others just were than to where the actor was."""
        if self.actor_m is None or self.others_m is None or not self.are_recent:
            return False
        away_m, from_others_m = (np.linalg.norm(place_m - one) for one in (self.actor_m, self.others_m))
        return bool(from_others_m < away_m)


NOWHERE = Places()


@dataclass(frozen=True, eq=False)
class TwoPeople:
    """The first frame of an actor who is not alone."""

    others: Mask
    """(C, H, W) what shows other people, or may show either."""
    actor_world_m: Floats
    """(N, 3) points of the actor's hull."""
    others_world_m: Floats
    """(M, 3) points of the others' hull."""


def shows_two(agreement: Agreement) -> bool:
    """Whether more than one piece of the hull explains a large part of the silhouettes."""
    return len(agreement.people) > 1 and agreement.people[1][0] > _SECOND_SHARE


def people_of(agreement: Agreement) -> list[Floats]:
    """Points (N, 3) of the hull of each of two or more people; empty if it may be one, hidden in part."""
    people_m = [points_m for share, points_m in agreement.people if share > _SECOND_SHARE]
    people_m = [points_m for points_m in people_m if np.ptp(points_m[:, 2]) >= _LEAST_PERSON_M]
    if len(people_m) < 2 or not agreement.agree:
        return []
    middles_m = [np.median(points_m[:, :2], axis=0) for points_m in people_m]
    return people_m if pdist(middles_m).min() > _PIECES_WITHIN_M else []


def actor_of(
    people_m: list[Floats],
    rig: Rig,
    silhouettes: Mask,
    possible: Mask,
    left_out: tuple[int, ...],
    places: Places,
) -> TwoPeople | None:
    """Who of some people, by points (N, 3) of the hull of each, is clearly nearest to where the actor should
    be; None if nobody is, or if the actor's place is not known and that one is much lower than another."""
    middles_m = np.array([np.median(points_m[:, :2], axis=0) for points_m in people_m])
    near_m = rig.middle_world_m[:2] if places.actor_m is None else places.actor_m
    cost_m = np.linalg.norm(middles_m - near_m, axis=1)
    if places.others_m is not None:  # who is where others were is one of them
        cost_m -= np.linalg.norm(middles_m - places.others_m, axis=1)
    actor, second = np.argsort(cost_m)[:2]
    heights_m = [np.ptp(points_m[:, 2]) for points_m in people_m]
    may_be_furniture = places.actor_m is None and heights_m[actor] < _LOW * max(heights_m)
    if cost_m[second] < cost_m[actor] + _CLEARLY_NEARER_M or may_be_furniture:
        return None
    others_m = np.concatenate(people_m[:actor] + people_m[actor + 1 :])
    seen = TriPlanes(pack(silhouettes), pack(possible & ~silhouettes))
    alone, actor_m, others_m = told_apart(rig, seen, people_m[actor], others_m, left_out)
    others = silhouettes & ~unpack(alone.silhouettes, rig.n_cameras)
    others[list(left_out)] = False  # they are judged as they are
    enough = others.sum() > _LEAST_OTHERS * silhouettes.sum()
    return TwoPeople(others, actor_m, others_m) if enough else None
