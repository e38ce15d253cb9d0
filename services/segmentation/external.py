"""What users bring to cut the actor out: a matting network in an ONNX file, or a plug-in."""

import logging
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from services.mocap.camera.camera import Camera
from services.mocap.energy.bitplanes import trimap_of
from services.mocap.errors import UserError
from services.mocap.take.segmenter_name import GROUP
from services.mocap.types import ACTOR, BACKGROUND, UNSURE, Bytes, Trimap
from services.segmentation.cleanup import cleanup

log = logging.getLogger(__name__)

_HALF = 0.25, 0.75
"""Range of undecided opacities."""
_WIDER_THAN_A_RIM = np.ones((5, 5), np.uint8)
_TYPES = {"tensor(float)": np.float32, "tensor(float16)": np.float16}


class OnnxMatte:
    """Runs a network that takes a picture, and the clean plate if it has a second input: `onnx:FILE`.

    Inputs are (1, 3, h, w) RGB from 0 to 1, at the network's own size if it has one. The first output with
    one channel is the actor's opacity, 0 to 1; 0.5 and more is actor. Areas of about 0.5 that are wider than
    a soft edge are unsure.
    """

    def __init__(self, file: Path, plate_bgr: Bytes | None) -> None:
        """Raises UserError if the file, the package or the clean plate is missing, or the inputs are not as
        expected."""
        self._file = file
        self._session = _session(file)
        self._inputs = list(self._session.get_inputs())
        self._plates: list[Bytes] = []
        if len(self._inputs) not in (1, 2) or any(i.type not in _TYPES for i in self._inputs):
            found = ", ".join(f"{i.name}: {i.type}" for i in self._inputs)
            raise UserError(
                f"{file}: expected one input for a picture, and a second at most for the clean plate, of "
                f"floats; found {found}"
            )
        if len(self._inputs) == 2:
            if plate_bgr is None:
                raise UserError(
                    f"{file}: its second input is for the clean plate, but the take has no background/: "
                    "record the empty stage, or use a network that needs none"
                )
            self._plates.append(plate_bgr)

    def trimap(self, image_bgr: Bytes) -> Trimap:
        """See Matte.trimap. Raises UserError for no such output."""
        height, width = image_bgr.shape[:2]
        for output in self._outputs(image_bgr):
            opacity = np.squeeze(output).astype(np.float32)
            if opacity.ndim == 2:
                whole = cv2.resize(opacity, (width, height), interpolation=cv2.INTER_LINEAR)
                trimap = trimap_of(cleanup(whole >= 0.5))
                half = cv2.inRange(whole, *_HALF)
                trimap[cv2.morphologyEx(half, cv2.MORPH_OPEN, _WIDER_THAN_A_RIM) > 0] = UNSURE
                return trimap
        raise UserError(f"{self._file}: expected an output of one channel, the actor's opacity from 0 to 1")

    def _outputs(self, image_bgr: Bytes) -> list[NDArray[Any]]:
        """What the network makes of a picture; raises UserError if it fails."""
        try:
            feeds = {
                put.name: _as_input(picture, put.shape, _TYPES[put.type])
                for put, picture in zip(self._inputs, [image_bgr, *self._plates], strict=True)
            }
            return list(self._session.run(None, feeds))
        except Exception as problem:
            log.exception("%s failed", self._file)
            reason = next(iter(str(problem).splitlines()), type(problem).__name__)
            raise UserError(f"{self._file}: failed on a picture ({reason}): export it again") from problem


def _session(file: Path) -> Any:
    try:
        onnxruntime = import_module("onnxruntime")
    except ImportError:
        raise UserError(
            f"--segmenter onnx:{file}: needs the package onnxruntime, which is not installed: "
            "pip install 'xormocap[onnx]'"
        ) from None
    if not file.is_file():
        raise UserError(f"{file}: is missing: expected the ONNX file of a matting network")
    try:
        return onnxruntime.InferenceSession(str(file), providers=onnxruntime.get_available_providers())
    except Exception as problem:
        reason = next(iter(str(problem).splitlines()), type(problem).__name__)
        raise UserError(f"{file}: cannot be loaded as a network ({reason}): export it again") from None


def _as_input(picture_bgr: Bytes, shape: list[int | str | None], dtype: Any) -> NDArray[Any]:
    """A picture as (1, 3, h, w) RGB from 0 to 1; h and w of the input's shape where these are numbers."""
    height, width = (
        asked if isinstance(asked, int) else own
        for asked, own in zip(shape[-2:], picture_bgr.shape[:2], strict=True)
    )
    if (height, width) != picture_bgr.shape[:2]:
        resized = cv2.resize(picture_bgr, (width, height), interpolation=cv2.INTER_AREA)
        picture_bgr = np.asarray(resized, np.uint8)
    rgb = picture_bgr[..., ::-1].transpose(2, 0, 1)[None]
    return (np.ascontiguousarray(rgb, np.float32) / 255).astype(dtype)


class PluginMatte:
    """A matte that another package makes for one camera; what it answers is checked before it is believed.

    Its entry point names a class (or function) that is called with the camera and its clean plate (H, W, 3)
    BGR uint8, or None, and returns an object with `silhouette(image_bgr)`: a mask (H, W) of bool, true on
    the actor, or a trimap (H, W) of uint8: 0 is background, 128 unsure, 255 actor.
    """

    def __init__(self, name: str, camera: Camera, plate_bgr: Bytes | None) -> None:
        """Raises UserError if the entry point cannot be loaded or called."""
        self._name, self._shape = name, camera.shape_px
        (entry,) = list(entry_points(group=GROUP, name=name))[:1]
        try:
            self._plugin = entry.load()(camera, plate_bgr)
        except UserError:
            raise
        except Exception as problem:
            raise UserError(
                f"--segmenter {name}: {entry.value} failed for {camera.name} "
                f"({type(problem).__name__}: {problem}): ask its authors"
            ) from problem

    def trimap(self, image_bgr: Bytes) -> Trimap:
        """See Matte.trimap. Raises UserError if it fails, or answers no mask and no trimap."""
        try:
            answer = np.asarray(self._plugin.silhouette(image_bgr))
        except UserError:
            raise
        except Exception as problem:
            log.exception("%s failed", self._name)
            raise UserError(
                f"--segmenter {self._name}: failed on a picture ({type(problem).__name__}: {problem}): ask "
                "its authors"
            ) from problem
        if answer.dtype not in (np.bool_, np.uint8) or answer.shape != self._shape:
            raise UserError(
                f"--segmenter {self._name}: expected masks of (height, width) {self._shape} and type bool "
                f"or uint8, got {answer.shape} of {answer.dtype}: ask its authors"
            )
        if answer.dtype == np.bool_:
            return trimap_of(np.array(answer, np.bool_, order="C"))  # the plug-in may keep its own
        unknown = ~np.isin(answer, (BACKGROUND, UNSURE, ACTOR), kind="table")
        if unknown.any():
            raise UserError(
                f"--segmenter {self._name}: expected {BACKGROUND} for background, {UNSURE} for unsure and "
                f"{ACTOR} for the actor in masks of uint8, got {answer[unknown][0]}: ask its authors"
            )
        return np.array(answer, np.uint8, order="C")
