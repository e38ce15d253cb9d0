"""Undoes mistakes in calibration and pictures on trial: what makes the cameras agree was the mistake."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from services.mocap.calibration.epipolar_tangents import (
    Outline,
    Outlines,
    TangentAgreement,
    agreement_limit_px,
    agreement_of,
)
from services.mocap.calibration.mistake import Mistake
from services.mocap.camera.calibration import Up
from services.mocap.camera.camera import R_ZUP_YUP, Camera
from services.mocap.types import Floats

_TRIAL_FRAMES = 10
_FEWEST_GOOD = 3
"""So many cameras, and more than half of all, must agree once a mistake is undone: two often do by chance."""
_CLEARLY, _BETTER = 0.75, 3.0
"""The cameras that were wrong must then be off by less than this share of agreement_limit_px, and together by
this factor less than before. In none of 2,024 takes with a late, bumped or hidden camera, whose calibration
had none of these mistakes, one was found."""
_MOST_TRIED = 5
"""Cameras that disagree, the worst first, of which swaps and turns are tried; of fewer cameras, all."""
_BEHIND = np.diag([-1.0, 1.0, -1.0])
_OPENGL_AXES = np.diag([1.0, -1.0, -1.0])


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


_CONVENTIONS: dict[str, Callable[[Camera, Up], Camera]] = {
    "the way from the camera to the world": _inverted,
    "OpenGL's axes, y up and z backward": lambda camera, _: _with_axes(camera, _OPENGL_AXES),
    "Blender's matrix_world, from the camera to the world with y up and z backward": lambda camera, up: (
        _with_axes(_inverted(camera, up), _OPENGL_AXES)
    ),
}
"""How extrinsics may be meant instead."""
_UPSIDE_DOWN = "upside down"
_FLIPS = {_UPSIDE_DOWN: (-1.0, -1.0, "hflip,vflip"), "mirrored": (-1.0, 1.0, "hflip")}
"""How pictures may be flipped: the factors of x and y, and the filter of ffmpeg that undoes it."""


@dataclass(frozen=True, eq=False)
class _Trial:
    """A take in which a mistake is undone."""

    mistake: Mistake
    changed: frozenset[int]
    """The cameras that alone were wrong; none if all were."""
    cameras: tuple[Camera, ...]
    outlines: Outlines


def few_of(outlines: Outlines) -> Outlines:
    """The outlines of some frames, evenly spread, which are enough to compare cameras."""
    every = -(-max(map(len, outlines)) // _TRIAL_FRAMES)
    return [of_camera[::every] for of_camera in outlines]


def undone_mistake(cameras: tuple[Camera, ...], outlines: Outlines, up: Up) -> Mistake | None:
    """The mistake that, undone, makes most cameras agree, those that it concerns among them.

    Others may disagree before and after, as those do before which furniture stands. Of several such mistakes
    it is the one after which most pairs of cameras agree, and the cameras best.
    """
    if len(cameras) < _FEWEST_GOOD:
        return None
    few = few_of(outlines)
    found = agreement_of(cameras, few)
    if not found.odd and np.isfinite(found.off_px).any():
        return None
    limit_px = agreement_limit_px(cameras)
    mended = []
    for trial in _trials(cameras, few, found, up):
        then = agreement_of(trial.cameras, trial.outlines)
        good, wrong = then.good, sorted(trial.changed)
        if len(good) < _FEWEST_GOOD or 2 * len(good) <= len(cameras) or then.n_agreeing <= found.n_agreeing:
            continue
        before_px, after_px = found.off_px[wrong], then.off_px[wrong]
        is_clear = not wrong or float(after_px.max()) < _CLEARLY * limit_px
        is_better = not np.isfinite(before_px).all() or after_px.sum() * _BETTER <= before_px.sum()
        if trial.changed <= set(good) and is_clear and is_better:
            mended.append((then.n_agreeing, -float(then.off_px[good].mean()), trial.mistake))
    return max(mended, key=lambda each: each[:2])[2] if mended else None


def _trials(
    cameras: tuple[Camera, ...], outlines: Outlines, found: TangentAgreement, up: Up
) -> Iterator[_Trial]:
    everybody = range(len(cameras))
    for what, convention in _CONVENTIONS.items():
        meant = tuple(convention(camera, up) for camera in cameras)
        seen = [_in_camera(*them) for them in zip(outlines, cameras, meant, strict=True)]
        mistake = Mistake(
            "calibration.toml: rotation, translation",
            f"the cameras agree only if these are read as {what}",
            "convert them to OpenCV's, from the world to the camera, which looks along z with y down",
            is_certain=True,
        )
        yield _Trial(mistake, frozenset(), meant, seen)
    yield _all_upside_down(cameras, outlines)
    unknown = tuple(c for c in everybody if not np.isfinite(found.off_px[c]))
    tried = (found.odd + unknown)[:_MOST_TRIED] if len(cameras) > _MOST_TRIED else everybody
    for a, b in combinations(sorted(tried), 2):
        if cameras[a].size_px == cameras[b].size_px:
            yield _swapped(a, b, cameras, outlines)
    for c in tried:
        yield from _turned(c, cameras, outlines)


def _all_upside_down(cameras: tuple[Camera, ...], outlines: Outlines) -> _Trial:
    """Pictures of cameras that hung upside down, turned in the recording or in the calibration only."""
    of_x, of_y, filters = _FLIPS[_UPSIDE_DOWN]
    mistake = Mistake(
        "calibration.toml",
        f"the pictures of all cameras are {_UPSIDE_DOWN} against it",
        f"flip them (ffmpeg -vf {filters}), or calibrate with pictures as they are",
        is_certain=True,
    )
    pairs = zip(outlines, cameras, strict=True)
    seen = [_in_camera(of_camera, camera, camera, (of_x, of_y)) for of_camera, camera in pairs]
    return _Trial(mistake, frozenset(), cameras, seen)


def _swapped(a: int, b: int, cameras: tuple[Camera, ...], outlines: Outlines) -> _Trial:
    """Two cameras that have each other's pictures."""
    mistake = Mistake(
        "calibration.toml",
        f"{cameras[a].name} and {cameras[b].name} are swapped: each agrees with the pictures of the other",
        "swap their names there, or rename their files",
        is_certain=True,
    )
    seen = list(outlines)
    seen[a] = _in_camera(outlines[b], cameras[b], cameras[a])
    seen[b] = _in_camera(outlines[a], cameras[a], cameras[b])
    return _Trial(mistake, frozenset((a, b)), cameras, seen)


def _turned(c: int, cameras: tuple[Camera, ...], outlines: Outlines) -> Iterator[_Trial]:
    """A camera that looks the other way, or whose pictures are flipped."""
    camera = cameras[c]
    faces_away = Mistake(
        f"calibration.toml: [{camera.name}] rotation",
        "faces away from the actor, whom the other cameras see behind it",
        "expected OpenCV's axes, z forward and y down",
        is_certain=True,
    )
    for turn in (_OPENGL_AXES, _BEHIND):
        meant = _with_axes(camera, turn)
        seen = [*outlines[:c], _in_camera(outlines[c], camera, meant), *outlines[c + 1 :]]
        yield _Trial(faces_away, frozenset((c,)), (*cameras[:c], meant, *cameras[c + 1 :]), seen)
    for what, (of_x, of_y, filters) in _FLIPS.items():
        is_flipped = Mistake(
            f"calibration.toml: [{camera.name}]",
            f"its pictures are {what} against its calibration",
            f"flip the pictures (ffmpeg -vf {filters}), or calibrate with pictures as they are",
            is_certain=True,
        )
        seen = [*outlines[:c], _in_camera(outlines[c], camera, camera, (of_x, of_y)), *outlines[c + 1 :]]
        yield _Trial(is_flipped, frozenset((c,)), cameras, seen)


def _in_camera(
    of_camera: Sequence[Outline | None], camera: Camera, other: Camera, flip: tuple[float, float] = (1.0, 1.0)
) -> list[Outline | None]:
    return [outline and outline.in_camera(camera, other, flip) for outline in of_camera]
