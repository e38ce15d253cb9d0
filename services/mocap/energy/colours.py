"""The colour classes that cameras see of a body, and how many pixels of the input show another class.

Silhouettes do not change where an arm lies before the trunk in all pictures; its sleeve or skin does. This
term adds to the XOR where a picture has classes (Picture.classes): a pixel costs if it has one class in the
input and another one of the body. It is computed by the CPU, whatever draws the silhouettes.
"""

from functools import cache, partial

import numpy as np

from services.mocap.body.actor import Body
from services.mocap.body.colours import COLOURED, SKIRT
from services.mocap.body.kinematics import N_RIGID, frame_transforms, moving_frames
from services.mocap.camera.rig import Rig
from services.mocap.energy.backend import Energy, Problem
from services.mocap.energy.bitplanes import pack
from services.mocap.energy.cpu.collecting import empty_canvas
from services.mocap.energy.cpu.facing import CENTRE_X, cameras_of
from services.mocap.energy.cpu.outline import prepared
from services.mocap.energy.cpu.painting import Coat, Drawing, Rest, count_wrong, paint, room_for
from services.mocap.energy.picture import Picture, Region
from services.mocap.types import Bytes, Floats, Ints

_CLOTH_NEARER_M = 0.25
"""Cloth hangs about the legs, so it hides them although its middle is no nearer."""
_COARSER = 4.0
"""Times the level of detail: where colours end is seen less exactly than an outline."""
_ENDS_OF_WEB = ((0.0, 0.5, 0.0), (0.25, 0.25, 0.25), (0.5, 0.0, 0.5))
"""From between the upper to between the lower points of the two legs, in a web's frame."""
_EVERYTHING: Ints = np.arange(len(COLOURED), dtype=np.int32)


class ColourPainter:
    """Paints one body in one camera rig; only one thread at a time may call it."""

    def __init__(self, body: Body, rig: Rig) -> None:
        self._body, self._rig = body, rig
        self._prepared = cache(partial(prepared, body))
        ends_m = [_ends_m(vertices_m) for vertices_m, _ in body.surfaces[:N_RIGID]]
        self.ends_m = np.array([*ends_m, *[_ENDS_OF_WEB] * (len(body.surfaces) - N_RIGID)])
        """(S + 5, 3, 3) near end, middle and far end of each surface in its frame."""
        self.nearer_m = np.where(np.array(COLOURED) == SKIRT, _CLOTH_NEARER_M, 0.0)
        """(S + 5,) how much nearer to a camera than its middle each surface counts."""

    def wrong_px(self, problem: Problem) -> Energy:
        """The number of pixels with a wrong class by a problem's values (N, d); cameras count by weight.

        The problem's picture must have classes.
        """
        picture, weights = problem.picture, problem.cost.weights(self._rig.n_cameras)
        seen, detail_px = picture.class_of_pixels, _COARSER * problem.detail_px
        cameras, drawn = self._cameras(picture.region), np.array(problem.segments, np.int32)
        T_world_frame = frame_transforms(problem.base_pose[None], self._body.offsets_m)[0]
        coat = self._body.colour_classes, self.ends_m, self.nearer_m
        others = np.setdiff1d(_EVERYTHING, drawn)
        rest = self._painted(T_world_frame, others.astype(np.int32), coat, picture.region, detail_px)
        wrong = (seen != 0) & (rest[0] != 0) & (rest[0] != seen)
        blank_px = float(wrong.sum(axis=(1, 2)) @ weights)
        plan = (np.array(problem.dofs, np.int32), moving_frames(problem.dofs, problem.segments), drawn)
        drawing, painted = self._drawing(picture.region, len(drawn), detail_px), rest[0].copy()

        def evaluate(values: Floats) -> Floats:
            more_px, poses = np.empty(len(values)), np.array(values, order="C")
            count_wrong(
                poses, plan, problem.base_pose.copy(), T_world_frame.copy(), self._body.offsets_m, coat,
                cameras, drawing, rest, painted, seen, weights, more_px,
            )  # fmt: skip
            return more_px + blank_px

        return evaluate

    def wrong(self, picture: Picture, pose: Floats) -> Bytes:
        """(P, h, w) bit-planes of the pixels in which a pose (D,) has another class than a picture."""
        seen, own = picture.class_of_pixels, self.painted(pose, picture.region)
        return pack((seen != 0) & (own != 0) & (own != seen))

    def painted(self, pose: Floats, region: Region, table: Bytes | None = None) -> Bytes:
        """(C, h, w) the classes of a pose (D,) in a region; table (S + 5, QUARTERS): others than the body's,
        0 where nothing is to be painted."""
        T_world_frame = frame_transforms(pose[None], self._body.offsets_m)[0]
        coat = (self._body.colour_classes if table is None else table), self.ends_m, self.nearer_m
        return self._painted(T_world_frame, _EVERYTHING, coat, region, 0.0)[0]

    def _painted(
        self, T_world_frame: Floats, surfaces: Ints, coat: Coat, region: Region, detail_px: float
    ) -> Rest:
        shape = self._rig.n_cameras, region.height_px, region.width_px
        rest = np.zeros(shape, np.uint8), np.full(shape, np.inf, np.float32)
        drawing = self._drawing(region, len(surfaces), detail_px)
        everywhere = np.ones(shape[1:], np.uint8)
        paint(T_world_frame, surfaces, coat, self._cameras(region), drawing, everywhere, rest)
        return rest

    def _drawing(self, region: Region, n_surfaces: int, detail_px: float) -> Drawing:
        mesh, (scratch,) = self._prepared(detail_px > 0)
        canvas = empty_canvas(region.height_px, region.width_px)
        return detail_px, mesh, scratch, canvas, room_for(n_surfaces, region.height_px)

    def _cameras(self, region: Region) -> tuple[Floats, Floats, Floats]:
        """Projections (C, 3, 4), lenses, and centres (C, 3) in the world."""
        P_px_world, lenses = cameras_of(self._rig, region)
        return P_px_world, lenses, np.ascontiguousarray(lenses[:, CENTRE_X : CENTRE_X + 3])


def _ends_m(vertices_m: Floats) -> Floats:
    """(3, 3) near end, middle and far end of a segment's vertices (V, 3) along the way from its joint to its
    middle."""
    if not len(vertices_m):
        return np.zeros((3, 3))
    middle_m = vertices_m.mean(axis=0)
    axis = middle_m / max(float(np.linalg.norm(middle_m)), 1e-9)
    along_m = vertices_m @ axis
    return np.stack([along_m.min() * axis, middle_m, along_m.max() * axis])
