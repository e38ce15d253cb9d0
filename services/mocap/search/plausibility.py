"""Checks whether the first frame's silhouettes can be tracked, before any search.

What hides the actor, and who else is there, are told apart in this order:

- A camera that is empty or nearly white, or that disagrees with the others, is left out; so is one alone that
  sees the actor cut in two, and up to three from which the same furniture hides the actor (agreement.py).
- Pieces of the hull one above the other are one person, whom something hides in part (hull.stacked).
- Of two people the one nearer to the actor's place is the actor; what shows the other is unsure
  (two_people.py).
- Else, where most cameras see one piece, what is between the pieces in the others may be actor (_bridged).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import FULL_SHARE, TriPlanes, pack
from services.mocap.errors import CertainError, NotInViewError, TakeError
from services.mocap.search.agreement import WELL_FILLED, Agreement, find_agreement
from services.mocap.search.hull import MIN_CAMERAS
from services.mocap.search.two_people import NOWHERE, Places, TwoPeople, actor_of, people_of, shows_two
from services.mocap.search.unsure_shares import REMEDY, UnsureShares, names_or_numbers
from services.mocap.types import Floats, Ints, Mask

_EMPTY_SHARE = 0.0005
"""Share of a picture; less is noise: 38 pixels of 320x240."""
_CUT_SHARE = 0.12
"""Allowed length of a silhouette's contact with the picture's edge, relative to the square root of its area.

A hand at the edge is below this limit; two legs, a trunk or a head are above.
"""
_SPECK_SHARE = 0.05
"""Share of the largest piece of a silhouette: a smaller piece is not part of the actor."""
_TWO = (
    "silhouettes: two people, or the actor and something large, are visible in the first frame: the one at "
    "x {:.1f} m, y {:.1f} m, nearer to the middle of what the cameras look at, is taken for the actor; the "
    "other counts for nothing: if that is wrong, choose a first frame without the other one, or mask it out"
)
"""The message, with the actor's place on the floor."""
_ALONG = 0.9
"""Cosine of the angle between the axes of cameras that look along one line, as far as is known."""
_LEFT_OUT = ": it is left out of the search for the first pose"


@dataclass(frozen=True)
class FirstLook:
    """The results of checking a take's first frame."""

    left_out: tuple[int, ...]
    """Cameras with unusable silhouettes."""
    remarks: tuple[str, ...]
    """A sentence for each of them, and for problems that do not prevent tracking."""
    possible: Mask = field(compare=False)
    """(C, H, W) what may be actor: besides what was told as such, what something before the actor hides."""
    two: TwoPeople | None = field(default=None, compare=False)
    """None where nobody else is in view."""
    hidden_by_others: tuple[int, ...] = ()
    """Of the cameras left out, those from which somebody else hides the actor, for a while."""

    def believed(self, silhouettes: Mask) -> Mask:
        """A copy of silhouettes (C, H, W) with those left out empty, so that they do not carve the hull."""
        believed = silhouettes.copy() if self.two is None else silhouettes & ~self.two.others
        believed[list(self.left_out)] = False
        return believed

    def alone(self, seen: TriPlanes) -> TriPlanes:
        """The frame (P, H, W), in which what shows other people is unsure."""
        return seen if self.two is None else seen.doubting(pack(self.two.others))


def look_first(
    rig: Rig,
    silhouettes: Mask,
    names: Sequence[str] = (),
    possible: Mask | None = None,
    places: Places = NOWHERE,
    others: Mask | None = None,
) -> FirstLook:
    """Check the silhouettes (C, H, W) of the first frame, before searching a pose.

    names: of the cameras, for the sentences. possible (C, H, W): what may be actor, by default the
    silhouettes; unsure pixels never cause an error, and are mentioned first if there are many. Of two people
    the one clearly nearer to the actor's place is the actor. others (C, H, W): what shows other people,
    besides the silhouettes. Raises NotInViewError if nobody is visible or most cameras cut the actor off, and
    TakeError if it is not clear which of two people is the actor, or the silhouettes do not meet in space. A
    camera that is empty, full or disagrees with the others is left out, as long as at least two cameras
    remain, or three to decide that one disagrees.
    """
    names = names_or_numbers(names, rig.n_cameras)
    possible = silhouettes if possible is None else possible
    others = np.zeros_like(silhouettes) if others is None else others
    shares = _foreground_shares(rig, silhouettes)
    empty = tuple(c for c, share in enumerate(shares) if share < _EMPTY_SHARE)
    full = tuple(c for c, share in enumerate(shares) if share > FULL_SHARE)
    usable = tuple(c for c in range(rig.n_cameras) if c not in empty and c not in full)
    possible_shares = _foreground_shares(rig, possible)
    unsure = tuple(c for c in empty if possible_shares[c] >= _EMPTY_SHARE)
    _check_counts(empty, full, usable, unsure, names)
    unsure_shares = UnsureShares(silhouettes, possible & ~others, names)
    with unsure_shares.blamed_first():
        if all(len(_pieces(silhouettes[c])) == 1 for c in usable):  # nobody else is cut off
            _check_cut_off(rig, silhouettes, possible, usable, names)
        agreement, cut = find_agreement(rig, silhouettes, usable, possible), tuple[int, ...]()
        people_m, found = people_of(agreement), None
        if people_m:
            left_out = (*empty, *full, *agreement.odd)
            found = actor_of(people_m, rig, silhouettes, possible, left_out, places)
        if found is None:
            _check_cut_off(rig, silhouettes, possible, usable, names)
            if not people_m and shows_two(agreement) and (parted := _parted(rig, silhouettes, usable)):
                bridged = _bridged(silhouettes, possible, parted)
                again = find_agreement(rig, silhouettes, usable, bridged)
                if again.agree and not shows_two(again):
                    agreement, possible, cut = again, bridged, parted
            _check_agreement(agreement, names)
    if found is not None:
        all_others = others | found.others
        look = look_first(rig, silhouettes & ~found.others, names, possible, places, all_others)
        if look.two is not None:  # of more people than were told apart at once
            return look
        remark = _TWO.format(*np.median(found.actor_world_m[:, :2], axis=0))
        return replace(look, remarks=(remark, *look.remarks), two=replace(found, others=all_others))
    others_shares = _foreground_shares(rig, others)
    covered = [c for c in empty if others_shares[c] >= _EMPTY_SHARE]
    remarks = _remarks(tuple(c for c in empty if c not in covered), full, agreement, names, unsure_shares)
    remarks += [
        f"silhouettes: somebody else hides the actor from {names[c]} in the first frame" for c in covered
    ]
    remarks += [
        f"silhouettes: something hides part of the actor from {names[c]} in the first frame, which shows its "
        "rest in pieces"
        for c in cut
    ]
    left_out = (*empty, *full, *agreement.odd)
    return FirstLook(left_out, tuple(remarks), possible, hidden_by_others=tuple(covered))


def _remarks(
    empty: tuple[int, ...],
    full: tuple[int, ...],
    agreement: Agreement,
    names: Sequence[str],
    unsure: UnsureShares,
) -> list[str]:
    remarks = [
        unsure.before(f"silhouettes: {names[c]} shows no person in the first frame{_LEFT_OUT}", [c])
        for c in empty
    ]
    remarks += [
        f"silhouettes: {names[c]} is almost completely white in the first frame{_LEFT_OUT}; check its "
        "background or threshold"
        for c in full
    ]
    remarks += [
        unsure.before(
            f"calibration.toml: the silhouette of {names[c]} does not meet in space with those of the "
            f"others{_LEFT_OUT}; check its calibration, its synchronisation and its silhouette",
            [c],
        )
        for c in agreement.odd
    ]
    if agreement.filled < WELL_FILLED:
        only_in_part = (
            f"calibration.toml: the cameras' silhouettes meet in space only in part; their hull covers "
            f"{100 * agreement.filled:.0f}% of them{_suspicion(agreement, names)}: check calibration and "
            "synchronisation"
        )
        remarks.append(unsure.before(only_in_part))
    return remarks


def _foreground_shares(rig: Rig, silhouettes: Mask) -> Floats:
    """The share (C,) of each picture that is foreground."""
    return np.array(
        [
            mask[:height, :width].mean()
            for mask, (width, height) in zip(silhouettes, rig.sizes_px, strict=True)
        ]
    )


def _check_counts(
    empty: tuple[int, ...],
    full: tuple[int, ...],
    usable: tuple[int, ...],
    unsure: tuple[int, ...],
    names: Sequence[str],
) -> None:
    """unsure: those of the empty cameras that may show somebody all the same."""
    n_cameras = len(names)
    if len(usable) >= MIN_CAMERAS:
        return
    if len(usable) + len(unsure) >= MIN_CAMERAS:
        raise NotInViewError(
            f"silhouettes: what {len(unsure)} of {n_cameras} cameras show of the actor in the first frame is "
            f"all unsure: choose a first frame in which the actor is surely to be seen, or {REMEDY}"
        )
    if full and len(full) >= len(empty):
        raise white_all_over(len(full), n_cameras, "the first frame")
    if len(empty) == n_cameras:
        raise NotInViewError(
            f"silhouettes: nobody is visible in the first frame of all {n_cameras} cameras: choose a "
            "first frame in which the actor is in view, or check the background"
        )
    raise NotInViewError(
        f"silhouettes: only {len(usable)} of {n_cameras} cameras show a person in the first frame: expected "
        f"{MIN_CAMERAS} or more: choose a first frame in which the actor is in view, or check the background"
    )


def white_all_over(n_white: int, n_cameras: int, where: str) -> CertainError:
    """Pictures are inverted, say."""
    return CertainError(
        f"silhouettes: {n_white} of {n_cameras} cameras are white nearly all over in {where}: expected the "
        "actor white on black: check the background, or invert the pictures"
    )


def _check_cut_off(
    rig: Rig, silhouettes: Mask, possible: Mask, usable: tuple[int, ...], names: Sequence[str]
) -> None:
    cut = [c for c in usable if _is_cut_off(silhouettes[c], possible[c], *rig.sizes_px[c])]
    if 2 * len(cut) > len(usable):
        raise NotInViewError(
            f"silhouettes: {len(cut)} of {len(usable)} cameras ({', '.join(names[c] for c in cut)}) cut the "
            "actor off at the edge of the first frame: choose a first frame that shows the whole actor"
        )


def _is_cut_off(silhouette: Mask, possible: Mask, width: int, height: int) -> bool:
    """Whether more than a hand reaches the edge of a picture; specks there do not count.

    possible (H, W): what may be actor, so that what of it is sure is not taken for all of the actor.
    """
    pixels = np.concatenate(_pieces(silhouette[:height, :width]))
    at_edge = [pixels.T == 0, np.array([[width - 1], [height - 1]]) == pixels.T]
    unsure_px = np.count_nonzero((possible & ~silhouette)[:height, :width])
    return bool(np.count_nonzero(at_edge, axis=-1).max() > _CUT_SHARE * np.sqrt(len(pixels) + unsure_px))


def _suspicion(agreement: Agreement, names: Sequence[str]) -> str:
    """The half sentence that names the cameras of which one disagrees; empty where none is more likely."""
    suspects = [names[c] for c in agreement.suspects]
    if len(suspects) < 2:
        return f"; most likely {suspects[0]} disagrees with the others" if suspects else ""
    either = f"{', '.join(suspects[:-1])} or {suspects[-1]}"
    return f"; {either} disagrees with the others, and these silhouettes do not tell which"


def _check_agreement(agreement: Agreement, names: Sequence[str]) -> None:
    if not agreement.agree:
        who = _suspicion(agreement, names) or ", and no one or two cameras are the cause"
        if not agreement.suspects and len(agreement.cameras) <= MIN_CAMERAS + 2:
            who = f", and of {len(agreement.cameras)} cameras none can be singled out"
        raise TakeError(
            "calibration.toml: the cameras' silhouettes do not meet in space; their hull covers "
            f"{100 * agreement.filled:.0f}% of them{who}: check that the calibration belongs to this "
            "take and that the videos are synchronised"
        )
    if shows_two(agreement):
        raise TakeError(
            "silhouettes: two people, or the actor and something large, are visible in the first frame, and "
            "which of them is the actor is not clear: choose a first frame without the other one, or mask it "
            "out"
        )


def _parted(rig: Rig, silhouettes: Mask, usable: tuple[int, ...]) -> tuple[int, ...]:
    """The cameras that see the actor in pieces, if what the others see is likely to be one person; else none.

    At least half of the cameras must see one piece, from different directions: two people who stand apart are
    in one piece for the cameras along the line from one to the other, and for few others.
    """
    whole = [c for c in usable if len(_pieces(silhouettes[c])) == 1]
    axes = rig.P_px_world[whole, 2, :3]
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    if 2 * len(whole) < len(usable) or np.abs(axes @ axes.T).min() > _ALONG:
        return ()
    return tuple(c for c in usable if c not in whole)


def _pieces(silhouette: Mask) -> list[Ints]:
    """The pixels (N, 2), as x and y, of each piece of a silhouette (H, W) that is no speck."""
    _, pieces, statistics, _ = cv2.connectedComponentsWithStats(silhouette.view(np.uint8))
    areas_px = statistics[1:, cv2.CC_STAT_AREA]
    large = 1 + np.flatnonzero(areas_px > _SPECK_SHARE * areas_px.max(initial=0))
    return [np.argwhere(pieces == piece)[:, ::-1].astype(np.int32) for piece in large]


def _bridged(silhouettes: Mask, possible: Mask, parted: tuple[int, ...]) -> Mask:
    """What may be actor (C, H, W) if something hides what is between the pieces that some cameras see."""
    bridged = possible.copy()
    for c in parted:
        around = cv2.convexHull(np.concatenate(_pieces(silhouettes[c])))
        bridged[c] |= cv2.fillConvexPoly(np.zeros(possible.shape[1:], np.uint8), around, 1) > 0
    return bridged
