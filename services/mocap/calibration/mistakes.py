"""Finds from calibration and silhouettes what is wrong with a take.

Each mistake is undone on trial; it is certain where all cameras then agree that did not before.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path

import numpy as np

from services.mocap.calibration.epipolar_tangents import (
    Outline,
    TangentAgreement,
    agreement_limit_px,
    agreement_of,
    likely_mistake,
    touches_of,
)
from services.mocap.calibration.lost_frames import find_lost_frames
from services.mocap.calibration.time_offsets import find_offsets
from services.mocap.camera.calibration import Up
from services.mocap.camera.camera import R_ZUP_YUP, Camera
from services.mocap.types import Floats

Outlines = list[list[Outline | None]]
"""Per camera, of each frame."""
_UPRIGHT, _NOT_UPRIGHT = 0.75, 0.35
"""Cosine between the pictures' upward direction and the world's, of the median of cameras that stand upright,
and of others."""
_FROM_ABOVE = -0.7
"""Of the cosine between viewing direction and up: cameras that look down have no upright picture."""
_TRIAL_FRAMES = 10
_MOST_SWAPPED = 5
"""Cameras that disagree, the worst first, among which a swap is tried."""
_REACH, _LEAST_LATE, _LEAST_SURE, _BETTER = 15, 2.0, 0.2, 1.5
"""Offsets are searched up to so many frames; one is told from so many frames on, if the confidence is as high
and the error falls by this factor."""
_MOSTLY, _FEWEST_ALIKE = 0.8, 5
"""Share of the frames after a change that disagree and of those before that agree; least number of both."""


@dataclass(frozen=True)
class Mistake:
    """Something that is wrong with a take."""

    file: str
    """Of the take folder, and the field or camera in it."""
    what: str
    remedy: str
    is_certain: bool = False
    """Whether tracking is bound to fail."""
    is_out_of_step: bool = False
    """Whether a camera shows other moments than the others."""
    is_change: bool = False
    """Whether the cameras agree up to some frame, and not afterwards."""

    def __str__(self) -> str:
        return f"{self.file}: {self.what}: {self.remedy}"


def _upward(cameras: Sequence[Camera]) -> float:
    """Median cosine between the cameras' upward directions and the world's."""
    return float(np.median([-camera.R_camera_world[1, 2] for camera in cameras]))


def wrong_up(cameras: Sequence[Camera], up: Up) -> Mistake | None:
    """The mistake of a take.toml whose `up` is not the world's: cameras (z-up) that lie on their sides."""
    other: Up = "y" if up == "z" else "z"
    turn = R_ZUP_YUP if up == "z" else R_ZUP_YUP.T
    looks_down = np.median([camera.R_camera_world[2, 2] for camera in cameras]) < _FROM_ABOVE
    if looks_down or _upward(cameras) > _NOT_UPRIGHT:
        return None
    if _upward([camera.with_world_turned(turn) for camera in cameras]) < _UPRIGHT:
        return None
    return Mistake(
        "take.toml: up",
        f'the cameras stand upright if "{other}" is up, and lie on their sides with "{up}"',
        f'write up = "{other}"',
        is_certain=True,
    )


def _inverted(camera: Camera, up: Up) -> Camera:
    """The camera whose extrinsics, as its file has them, lead from the camera to the world."""
    R_file_internal = R_ZUP_YUP.T if up == "y" else np.eye(3)
    R = camera.R_camera_world @ R_file_internal.T
    inverse = replace(camera, R_camera_world=R.T, t_camera_world_m=-R.T @ camera.t_camera_world_m)
    return inverse.with_world_turned(R_file_internal.T)


def _with_axes(camera: Camera, turn: Floats) -> Camera:
    """A camera at the same place with other axes of its own: turn @ x_camera."""
    R, t_m = turn @ camera.R_camera_world, turn @ camera.t_camera_world_m
    return replace(camera, R_camera_world=R, t_camera_world_m=t_m)


_BEHIND = np.diag([-1.0, 1.0, -1.0])
_OPENGL_AXES = np.diag([1.0, -1.0, -1.0])
_CONVENTIONS: dict[str, Callable[[Camera, Up], Camera]] = {
    "the way from the camera to the world": _inverted,
    "OpenGL's axes, y up and z backward": lambda camera, _: _with_axes(camera, _OPENGL_AXES),
    "Blender's matrix_world, from the camera to the world with y up and z backward": lambda camera, up: (
        _with_axes(_inverted(camera, up), _OPENGL_AXES)
    ),
}
"""How extrinsics may be meant instead."""


def mistakes_in(
    cameras: tuple[Camera, ...], outlines: Outlines, up: Up, take: Path, frames: range
) -> list[Mistake]:
    """The mistakes that the outlines of consecutive frames show; the first certain one alone if there is one.

    up: the axis of the calibration's own world that points up. take: the folder, for commands that help.
    frames: those of the outlines.
    """
    every = -(-max(map(len, outlines)) // _TRIAL_FRAMES)
    few = [of_camera[::every] for of_camera in outlines]
    found = agreement_of(cameras, few)
    if found.odd or not np.isfinite(found.off_px).any():
        certain = next(_undone(cameras, few, found, up), None)
        if certain is not None:
            return [certain]
    late = list(_out_of_step(cameras, outlines, take, frames))
    # A late camera alone disagrees from the first movement on; a change makes the others disagree as well.
    in_step = [c for c, camera in enumerate(cameras) if camera.name not in {mistake.file for mistake in late}]
    others = tuple(cameras[c] for c in in_step)
    change = _change_in(others, [outlines[c] for c in in_step])
    if change is None:
        return late or list(_disagreeing(cameras, found, take))
    before = [of_camera[:change] for of_camera in outlines]  # what changed is no sign of a late camera
    return [_of_change(frames, frames[change]), *_out_of_step(cameras, before, take, frames)]


def _undone(
    cameras: tuple[Camera, ...], outlines: Outlines, found: TangentAgreement, up: Up
) -> Iterator[Mistake]:
    """Mistakes that, undone, make all cameras agree."""
    names = [camera.name for camera in cameras]
    for what, convention in _CONVENTIONS.items():
        meant = tuple(convention(camera, up) for camera in cameras)
        seen = [_in_camera(*them) for them in zip(outlines, cameras, meant, strict=True)]
        if _all_agree(meant, seen):
            yield Mistake(
                "calibration.toml: rotation, translation",
                f"the cameras agree only if these are read as {what}",
                "convert them to OpenCV's, from the world to the camera, which looks along z with y down",
                is_certain=True,
            )
    worst = found.odd[:_MOST_SWAPPED] if len(cameras) > _MOST_SWAPPED else range(len(cameras))
    for a, b in combinations(sorted(worst), 2):
        swapped = list(outlines)
        swapped[a] = _in_camera(outlines[b], cameras[b], cameras[a])
        swapped[b] = _in_camera(outlines[a], cameras[a], cameras[b])
        if cameras[a].size_px == cameras[b].size_px and _all_agree(cameras, swapped):
            yield Mistake(
                "calibration.toml",
                f"{names[a]} and {names[b]} are swapped: each agrees with the pictures of the other",
                "swap their names there, or rename their files",
                is_certain=True,
            )
    for c in found.odd if len(found.good) > 1 else ():
        yield from _turned(c, cameras, outlines, found.good, float(found.off_px[c]))


def _turned(
    odd: int, cameras: tuple[Camera, ...], outlines: Outlines, good: list[int], off_px: float
) -> Iterator[Mistake]:
    """The mistake of one camera that looks the other way, or whose pictures are flipped."""
    camera, others = cameras[odd], [cameras[c] for c in good]
    for turn in (_OPENGL_AXES, _BEHIND):
        meant = _with_axes(camera, turn)
        seen = [*(outlines[c] for c in good), _in_camera(outlines[odd], camera, meant)]
        if _all_agree((*others, meant), seen):
            yield Mistake(
                f"calibration.toml: [{camera.name}] rotation",
                "faces away from the actor, whom the other cameras see behind it",
                "expected OpenCV's axes, z forward and y down",
                is_certain=True,
            )
    what = likely_mistake(odd, cameras, good, outlines, off_px)
    if what:
        yield Mistake(
            f"calibration.toml: [{camera.name}]",
            f"its pictures are {what} against its calibration",
            "turn the video, or calibrate with pictures as they are in it",
            is_certain=True,
        )


def _in_camera(of_camera: Sequence[Outline | None], camera: Camera, other: Camera) -> list[Outline | None]:
    return [outline and outline.in_camera(camera, other) for outline in of_camera]


def _all_agree(cameras: tuple[Camera, ...], outlines: Outlines) -> bool:
    found = agreement_of(cameras, outlines)
    return not found.odd and bool(np.isfinite(found.off_px).all())


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
