"""Finds from calibration and silhouettes what is wrong with a take."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from services.mocap.calibration.epipolar_tangents import (
    Outlines,
    TangentAgreement,
    agreement_limit_px,
    agreement_of,
    touches_of,
)
from services.mocap.calibration.lost_frames import find_lost_frames
from services.mocap.calibration.mistake import Mistake
from services.mocap.calibration.time_offsets import find_offsets
from services.mocap.calibration.trials import few_of, undone_mistake
from services.mocap.camera.calibration import Up
from services.mocap.camera.camera import R_ZUP_YUP, Camera

_UPRIGHT, _NOT_UPRIGHT = 0.75, 0.35
"""Cosine between the pictures' upward direction and the world's, of the median of cameras that stand upright,
and of others."""
_FROM_ABOVE = -0.7
"""Of the cosine between viewing direction and up: cameras that look down have no upright picture."""
_REACH, _LEAST_LATE, _LEAST_SURE, _BETTER = 15, 2.0, 0.2, 1.5
"""Offsets are searched up to so many frames; one is told from so many frames on, if the confidence is as high
and the error falls by this factor."""
_MOSTLY, _FEWEST_ALIKE = 0.8, 5
"""Share of the frames after a change that disagree and of those before that agree; least number of both."""


def _upward(cameras: Sequence[Camera]) -> float:
    """Median cosine between the cameras' upward directions and the world's."""
    return float(np.median([-camera.R_camera_world[1, 2] for camera in cameras]))


def _heights_m(cameras: Sequence[Camera]) -> float:
    """How much the heights of the cameras differ."""
    return float(np.ptp([camera.centre_world_m[2] for camera in cameras]))


def _steepness(cameras: Sequence[Camera]) -> float:
    """How much the cameras look up or down, as a root mean square of sines."""
    return float(np.sqrt(np.mean([camera.R_camera_world[2, 2] ** 2 for camera in cameras])))


def wrong_up(cameras: Sequence[Camera], up: Up) -> Mistake | None:
    """The mistake of a take.toml whose `up` is not the world's: cameras (z-up) that lie on their sides."""
    other: Up = "y" if up == "z" else "z"
    turn = R_ZUP_YUP if up == "z" else R_ZUP_YUP.T
    looks_down = np.median([camera.R_camera_world[2, 2] for camera in cameras]) < _FROM_ABOVE
    if looks_down or _upward(cameras) > _NOT_UPRIGHT:
        return None
    turned = [camera.with_world_turned(turn) for camera in cameras]
    if _upward(turned) < _UPRIGHT:
        return None
    # Cameras that lie on their sides on purpose are about level, at about one height.
    if _steepness(turned) > _steepness(cameras) and _heights_m(turned) > _heights_m(cameras):
        return None
    return Mistake(
        "take.toml: up",
        f'the cameras stand upright if "{other}" is up, and lie on their sides with "{up}"',
        f'write up = "{other}"',
        is_certain=True,
    )


def mistakes_in(
    cameras: tuple[Camera, ...], outlines: Outlines, up: Up, take: Path, frames: range
) -> list[Mistake]:
    """The mistakes that the outlines of consecutive frames show; the first certain one alone if there is one.

    up: the axis of the calibration's own world that points up. take: the folder, for commands that help.
    frames: those of the outlines.
    """
    certain = undone_mistake(cameras, outlines, up)
    if certain is not None:
        return [certain]
    late = list(_out_of_step(cameras, outlines, take, frames))
    # A late camera alone disagrees from the first movement on; a change makes the others disagree as well.
    in_step = [c for c, camera in enumerate(cameras) if camera.name not in {mistake.file for mistake in late}]
    others = tuple(cameras[c] for c in in_step)
    change = _change_in(others, [outlines[c] for c in in_step])
    if change is None:
        return late or list(_disagreeing(cameras, agreement_of(cameras, few_of(outlines)), take))
    before = [of_camera[:change] for of_camera in outlines]  # what changed is no sign of a late camera
    return [_of_change(frames, frames[change]), *_out_of_step(cameras, before, take, frames)]


def _out_of_step(
    cameras: tuple[Camera, ...], outlines: Outlines, take: Path, frames: range
) -> Iterator[Mistake]:
    """Cameras that agree better some frames later or earlier, from the first frame or from a later one on."""
    found = find_offsets(cameras, outlines, _REACH)
    lost = find_lost_frames(cameras, outlines, found.offsets)
    if lost is not None:
        yield Mistake(
            cameras[lost.camera].name,
            f"has {lost} at about frame {frames[lost.first_after]}, or was moved then",
            f"run xormocap sync {take}, which tells how to mend it",
            is_out_of_step=True,
        )
    usual = float(np.median(found.offsets))
    for c, camera in enumerate(cameras):
        ahead = float(found.offsets[c]) - usual
        is_better = found.off_px[c] * _BETTER < found.off_before_px[c]
        is_late = abs(ahead) >= _LEAST_LATE and found.confidence[c] >= _LEAST_SURE and is_better
        if is_late and (lost is None or c != lost.camera):
            yield Mistake(
                camera.name,
                f"is out of step by about {abs(ahead):.0f} frames: it agrees with the other cameras "
                f"({found.off_px[c]:.1f} px instead of {found.off_before_px[c]:.1f} px) if it is that much "
                f"{'earlier' if ahead > 0 else 'later'}",
                f"run xormocap sync {take}, which writes offsets to take.toml",
                is_out_of_step=True,
            )


def _change_in(cameras: tuple[Camera, ...], outlines: Outlines) -> int | None:
    """The first of the outlines from which cameras disagree that agreed before; None: there is none."""
    pairs = [touches.off_px(0.0) for touches in touches_of(cameras, outlines)]
    if not pairs:
        return None
    off_px = np.concatenate(pairs, axis=1)
    shows_anybody = np.isfinite(off_px).any(axis=1, keepdims=True)
    off_px = np.nanmedian(np.where(shows_anybody, off_px, 0.0), axis=1)
    disagrees = off_px > agreement_limit_px(cameras)
    n_later = np.arange(len(disagrees), 0, -1)
    wrong_later = np.cumsum(disagrees[::-1])[::-1] / n_later
    wrong_before = np.concatenate([[0], np.cumsum(disagrees)[:-1]]) / np.maximum(np.arange(len(disagrees)), 1)
    is_change = (wrong_later > _MOSTLY) & (wrong_before < 1 - _MOSTLY) & disagrees
    is_change[:_FEWEST_ALIKE] = is_change[max(len(is_change) - _FEWEST_ALIKE, 0) :] = False
    return int(is_change.argmax()) if is_change.any() else None


def _of_change(frames: range, change: int) -> Mistake:
    """The mistake of cameras that disagree from one of the frames on."""
    return Mistake(
        "silhouettes",
        f"the cameras agree up to frame {change - 1}, and not from frame {change} on; a second person or "
        "a thing that moves comes into view, or the light changes",
        f"track the part before with --frames {frames.start}:{change}, or mask it out",
        is_change=True,
    )


def _disagreeing(cameras: tuple[Camera, ...], found: TangentAgreement, take: Path) -> Iterator[Mistake]:
    """Cameras that disagree for a reason that is not known."""
    names = [cameras[c].name for c in found.odd]
    if 2 * len(names) > len(cameras):
        yield Mistake(
            "calibration.toml",
            "most cameras do not agree with each other",
            "check that it belongs to this take, that videos have their own cameras' names, and silhouettes",
        )
    elif names:
        yield Mistake(
            f"calibration.toml: {', '.join(names)}",
            f"not in agreement with the other cameras ({np.nanmax(found.off_px):.0f} px off); "
            "it was moved since the calibration, its silhouettes are wrong, or something hides the actor",
            f"run xormocap calibrate --check {take}",
        )
