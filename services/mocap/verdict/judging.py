"""Judges a result by what its folder holds, and tells why: cameras, moments and bodies that stand out."""

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Set
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from services.mocap.errors import TakeError
from services.mocap.result.layout import RUN_JSON
from services.mocap.result.result import Result
from services.mocap.search.chains import LIMBS
from services.mocap.search.lacking_ends import LACKING_REMEDY, lacking_in_words
from services.mocap.take.layout import CALIBRATION
from services.mocap.take.marks import PARTS, WHOLE_BODY
from services.mocap.take.moved_cameras import AS_THE_BODY_SHOWS, moves_in_words
from services.mocap.types import Floats, Mask
from services.mocap.verdict.verdict import (
    LEVELS,
    Cause,
    Doubt,
    Level,
    Verdict,
    part_in_words,
    spans_in_words,
    spans_of,
)

_MOST_LOST, _MOST_LOST_LIMBS = 0.2, 0.08
"""Shares of frames with a doubtful body, and of arms and legs that may be lost (lost_limbs_of), above which a
result is not usable. Of 37 takes of people, some of which the confidence was fitted to, four are above the
second: in these, 10 % or more of the limbs were lost, in all others at most 3 %."""
_LIMB_COLUMNS = [PARTS.index(limb) for limb in LIMBS]
LEAST_IOU = 0.6
"""Typical overlap with the silhouettes below which a result is not usable."""
CHECKS = "checks"
"""The entry of run.json with the causes that were found before the run."""
_BELOW_OTHERS = 0.1
"""A camera whose median IoU is lower by this than the median of the others stands out."""
_FEWEST_CAMERAS = 3
_DROP, _LEAST_DROP_FRAMES = 0.15, 3
"""A moment stands out if a camera's IoU is lower by this than its median, in so many frames in a row."""
_GROWN, _COVERED = 1.25, 0.8
"""Against the other frames: growth of the pixels that body or silhouettes cover, and share of those that both
cover. With both the silhouettes show more (second persons in a synthetic take: 1.8 and 1.0), with neither
less (actors half out of the pictures: 1.2 and 0.6)."""
_LEAST_APART = 1e-3
"""Of one minus the IoU, which has four digits."""
_LOW_IOU = 0.75
"""All cameras' typical IoU below which the body or the silhouettes are wrong; people in coats have 0.82."""
_UNEXPLAINED = Cause(
    what="no camera, no moment and no measure of the body stands out",
    remedy="look at overlay.mp4: if the body is wrong from the first frame on, begin with another one "
    "(--frames A:B); if the outlines are wrong, look at the silhouettes (xormocap segment)",
    level="not usable",
)
_OFTEN = 0.25
"""Share of the frames from which on a limb that is doubtful needs a cause."""
_ALONG_ONE_LINE = 0.85
"""Cameras look along nearly one line if the mean of the outer products of their viewing directions has an
eigenvalue of this or more (1: exactly one line). Ten rigs of two facing groups have 0.89 to 0.94, 60 others
at most 0.8."""
_FEW_CAMERAS = 3
_HEIGHT_OFF_M = 0.05
_TALLEST_M, _SMALLEST_M = 2.1, 1.2
"""One adult in a million is taller; smaller people are children, who are measured less well."""


def verdict_of(result: Result, folder: Path | None = None) -> Verdict:
    """The verdict on a result, by its files alone. folder: where they will be, if they are elsewhere yet.
    Raises TakeError if one cannot be read."""
    iou = {camera: values for camera, values in result.quantities.get("iou", {}).items() if len(values)}
    before = _found_before(result)
    found = _found(result, iou, before, folder or result.folder)
    lost_limbs = lost_limbs_of(result.distrusted, result.confidence)
    levels = [level_of(result.distrusted, lost_limbs, iou), *(cause.level for cause in (*before, *found))]
    level = max(levels, key=LEVELS.index)
    if level == LEVELS[-1]:  # then a remark from before the run, such as a missing plate, is a likely cause
        before = tuple(c.model_copy(update={"level": level}) if c.remedy else c for c in before)
    if all(cause.kind == "remark" for cause in (*before, *found)):
        likely = (_UNEXPLAINED,) if level == LEVELS[-1] else _hidden_limbs(result.distrusted)
        if likely:
            likely = _with_placement(result, likely)
        found = (*likely, *found)
    whole = PARTS.index(WHOLE_BODY)
    named = result.distrusted & ~result.distrusted[:, [whole]]  # a limb is not named beside the whole body
    named[:, whole] = result.distrusted[:, whole]
    return Verdict(
        level=level,
        frames=len(result.frames),
        doubtful_frames=int(result.distrusted.any(axis=1).sum()),
        lost_frames=int(result.distrusted[:, whole].sum()),
        lost_limbs=round(lost_limbs, 3),
        doubts=tuple(
            Doubt(part=part, frames=int(chosen.sum()), spans=spans_of(chosen, int(result.frames[0])))
            for part, chosen in zip(PARTS, named.T, strict=True)
            if chosen.any()
        ),
        iou={camera: round(float(np.nanmedian(values)), 3) for camera, values in iou.items()},
        causes=tuple(sorted((*before, *found), key=lambda cause: cause.kind == "remark")),
    )


def lost_limbs_of(distrusted: Mask, confidence: Floats) -> float:
    """The share of arms and legs that may be lost, of the frames in which not the whole body is doubtful.

    A doubtful one (N, 6) counts by the probability that it is lost, one minus its confidence (N, 6), or
    wholly where it has none (NaN); others do not count.
    """
    lost = np.where(distrusted, np.where(np.isnan(confidence), 1.0, 1.0 - confidence), 0.0)
    of_limbs = lost[~distrusted[:, PARTS.index(WHOLE_BODY)]][:, _LIMB_COLUMNS]
    return float(of_limbs.mean()) if of_limbs.size else 0.0


def level_of(distrusted: Mask, lost_limbs: float, iou: Mapping[str, Floats]) -> Level:
    """The level by the doubtful parts (N, 6), the limbs that may be lost, and the overlaps (N,) of the
    cameras."""
    lost = distrusted[:, PARTS.index(WHOLE_BODY)].mean()
    overlap = float(np.median([np.nanmedian(values) for values in iou.values()])) if iou else 1.0
    if lost > _MOST_LOST or lost_limbs > _MOST_LOST_LIMBS or overlap < LEAST_IOU:
        return "not usable"
    return "usable with gaps" if distrusted.any() else "good"


def _found_before(result: Result) -> tuple[Cause, ...]:
    """The causes that were found before the run."""
    try:
        return tuple(Cause.model_validate(entry) for entry in result.run.get(CHECKS, []))
    except (ValidationError, TypeError):
        where = f"{result.folder / RUN_JSON}: {CHECKS}"
        raise TakeError(f"{where}: expected what xormocap track wrote: remove this entry") from None


def _found(
    result: Result, iou: Mapping[str, Floats], before: tuple[Cause, ...], folder: Path
) -> tuple[Cause, ...]:
    """The causes that the result in a folder shows. iou: (N,) by camera."""
    explained = {name for name in iou for cause in before if re.search(rf"\b{re.escape(name)}\b", cause.what)}
    return (
        *_body(result),
        *_moved_cameras(result, folder),
        *_silhouettes(result, len(iou)),
        *_cameras(result, iou, explained, folder),
        *_moments(result, iou, explained),
    )


def _hidden_limbs(distrusted: Mask) -> tuple[Cause, ...]:
    """What most likely makes arms or legs doubtful in many of the frames (N, 6), if nothing else is wrong."""
    tracked = distrusted[~distrusted[:, PARTS.index(WHOLE_BODY)]]
    n_doubtful = {part: np.count_nonzero(tracked[:, PARTS.index(part)]) for part in LIMBS}
    often = [part_in_words(part) for part, n in n_doubtful.items() if n > _OFTEN * len(distrusted)]
    if not often:
        return ()
    return (
        Cause(
            what=f"{', '.join(often)}: doubtful in more than a quarter of the frames, and nothing else "
            "stands out; silhouettes do not show limbs that lie before the body or against each other",
            remedy="look at overlay.mp4; a camera from another side or from above shows more of them, and "
            "sleeves or trousers in a colour of their own help",
            level="usable with gaps",
        ),
    )


def _with_placement(result: Result, likely: tuple[Cause, ...]) -> tuple[Cause, ...]:
    """The likely causes, and that the cameras are few, if they are; or, instead, that they look along nearly
    one line. The likely causes alone without a fit."""
    projections = np.array(list(result.run.get("fit", {}).get("projections", {}).values()))
    if len(projections) < 2:
        return likely
    axes = projections[:, 2, :3]
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    if np.linalg.eigvalsh(axes.T @ axes / len(axes))[-1] >= _ALONG_ONE_LINE:
        along = Cause(
            what="all cameras look along nearly one line, from one end of it or from both: they hardly show "
            "how far away limbs are, and which of them lie before the body or behind it",
            remedy="place one or two cameras at right angles to the others",
            level="usable with gaps",
        )
        return (along,)
    if len(axes) > _FEW_CAMERAS:
        return likely
    few = Cause(
        what=f"only {len(axes)} cameras see the actor: limbs before or behind the body show in few of them",
        remedy="add one or two cameras where the gap between them is widest",
        level="usable with gaps",
    )
    return (*likely, few)


def _body(result: Result) -> Iterator[Cause]:
    """A height that is not the take's, or nobody's."""
    stated_m, height_m = result.run.get("take", {}).get("actor_height"), result.actor.height
    calibration = "check the scale of calibration.toml (the side of the board's squares, units)"
    if stated_m is not None and abs(height_m - stated_m) > _HEIGHT_OFF_M:
        yield Cause(
            what=f"the body is {height_m:.2f} m tall, take.toml says actor_height = {stated_m:.2f}",
            remedy=f"correct that number, or {calibration}",
            level="usable with gaps",
        )
    elif not _SMALLEST_M <= height_m <= _TALLEST_M:
        is_tall = height_m > _TALLEST_M
        yield Cause(
            what=f"the fitted body is {height_m:.2f} m tall, as {'hardly anybody' if is_tall else 'a child'}",
            remedy=f"{calibration}, or give actor_height in take.toml",
            level="not usable" if is_tall else "usable with gaps",
        )


def _silhouettes(result: Result, n_cameras: int) -> Iterator[Cause]:
    """Hands, feet or a head that silhouettes lack in the frames of the fit."""
    lacking: dict[str, list[str]] = result.run.get("fit", {}).get("lacking", {})
    most = max(Counter(end for ends in lacking.values() for end in ends).values(), default=0)
    if sentence := lacking_in_words(lacking):
        yield Cause(
            what=sentence,
            remedy=LACKING_REMEDY,
            level="usable with gaps" if 2 * most > n_cameras else "good",
        )


def _moved_cameras(result: Result, folder: Path) -> Iterator[Cause]:
    """Cameras that do not stand where the calibration says; the run had them where the body shows them."""
    fit = result.run.get("fit", {})
    if moves := fit.get("moved"):
        yield Cause(
            what=f"{moves_in_words(moves, len(fit['projections']))}: {AS_THE_BODY_SHOWS}",
            remedy="calibrate again, or, if these places are likely, copy "
            f"{folder / CALIBRATION} into the take",
            level="good",
        )


def _cameras(result: Result, iou: Mapping[str, Floats], explained: Set[str], folder: Path) -> Iterator[Cause]:
    """Cameras whose silhouettes the body covers far less than it covers the others'.

    explained: cameras of which it is known why.
    """
    typical = {camera: round(float(np.nanmedian(values)), 3) for camera, values in iou.items()}
    if not typical:
        return
    take, middle = result.run.get("take", {}).get("folder", "TAKE"), float(np.median(list(typical.values())))
    if middle < _LOW_IOU:
        yield Cause(
            what=f"body and silhouettes overlap little in most cameras (IoU {middle:.2f}, usual: above 0.82)",
            remedy=f"look at overlay.mp4, and run xormocap calibrate --check {take}",
            level="usable with gaps",
        )
    for camera, value in typical.items() if len(typical) >= _FEWEST_CAMERAS else ():
        others = float(np.median([of for name, of in typical.items() if name != camera]))
        if value < others - _BELOW_OTHERS and camera not in explained:
            yield Cause(
                what=f"{camera} agrees less with the body than the others (IoU {value:.2f}, others "
                f"{others:.2f}): it is out of step, was moved, or its silhouettes are wrong",
                remedy=f"xormocap sync {take} tells whether it is out of step, xormocap calibrate --check "
                f"{take} whether it was moved; xormocap calibrate {take} --refine {folder} then finds "
                "where it stands now",
                level="usable with gaps",
            )


def _moments(result: Result, iou: Mapping[str, Floats], explained: Set[str]) -> Iterator[Cause]:
    """Stretches of frames in which a camera's silhouettes are unlike the body, but are not elsewhere."""
    by_frame = {camera: _long_only(values < np.nanmedian(values) - _DROP) for camera, values in iou.items()}
    cameras = [camera for camera, low in by_frame.items() if low.any()]
    if not cameras:
        return
    together = _long_only(2 * np.sum(list(by_frame.values()), axis=0) > len(by_frame))
    if together.any():
        # More than half of the cameras cannot be below their medians in every frame: some frames are left.
        start, last = max(spans_of(~together, int(result.frames[0])), key=lambda span: span[1] - span[0])
        yield Cause(
            what=f"most cameras' silhouettes stop matching the body in {_when(result, together)}: "
            f"{_what_changed(result, iou, together)}",
            remedy="look at these frames in overlay.mp4; the longest part without them is tracked with "
            f"--frames {start}:{last + 1}",
            level="usable with gaps",
        )
    for camera in (camera for camera in cameras if camera not in explained):
        alone = _long_only(by_frame[camera] & ~together)
        if alone.any():
            yield Cause(
                what=f"{camera}'s silhouettes stop matching the body in {_when(result, alone)}: something "
                "else moves there, the light changed, or the actor leaves its picture",
                remedy="look at them with xormocap view (Cameras: difference)",
                level="good",
            )


def _what_changed(result: Result, iou: Mapping[str, Floats], chosen: Mask) -> str:
    """What may have happened in chosen frames (N,), by the areas that body and silhouettes cover."""
    overlap = _mean_overlap(np.array(list(iou.values())))
    either_px = result.energies_px / np.maximum(1 - overlap, _LEAST_APART)
    is_known = ~np.isnan(either_px)
    if (is_known & chosen).any() and (is_known & ~chosen).any():
        grown, covered = (
            float(np.nanmedian(of_px[chosen]) / max(np.nanmedian(of_px[~chosen]), 1.0))
            for of_px in (either_px, overlap * either_px)
        )
        if grown > _GROWN and covered > _COVERED:
            return "they show more than the body: a second person, a thing that moves, or light that changed"
        if grown < _GROWN and covered < _COVERED:
            return "they show less than the body: an actor who leaves the pictures or is hidden"
    return "a second person or a thing that moves, light that changed, or an actor who leaves the pictures"


def _mean_overlap(iou: Floats) -> Floats:
    """(N,) the mean of the cameras' overlaps (C, N) in each frame; NaN where there is none.

    One of 1 does not count: body and silhouette are then most likely out of that camera's picture.
    """
    counts = iou < 1.0  # which NaN is not
    n_cameras = counts.sum(axis=0)
    total = np.where(counts, iou, 0.0).sum(axis=0)
    return np.where(n_cameras > 0, total / np.maximum(n_cameras, 1), np.nan)


def _when(result: Result, chosen: Mask) -> str:
    return spans_in_words(spans_of(chosen, int(result.frames[0])))


def _long_only(chosen: Mask) -> Mask:
    """The frames (N,) of stretches that are long enough."""
    kept: Mask = np.zeros_like(chosen)
    for start, stop in spans_of(chosen):
        kept[start : stop + 1] = stop + 1 - start >= min(_LEAST_DROP_FRAMES, len(chosen))
    return kept
