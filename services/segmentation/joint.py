"""Silhouettes of several cameras at once: the walk from the pictures of a moment to pixels of three states.

A pixel is the actor's, the stage's in light, or the stage's in shadow. JointMatte.trimaps decides in five
steps, each of which has a module:

1. `comparison`: what has changed in each picture against its clean plate, and what of that may be shadow;
2. `floor_shadow`: whether the other cameras see the same shadow on the floor;
3. `voxels`: how many of the other cameras see a change along the pixel's ray;
4. `decision`: whether the actor or the stage explains the pixel better, weighed with its neighbours;
5. `edges`: how much of a pixel at the rim is the actor's.

Where all that together tells nothing, the pixel is `unsure`. Step 4 uses what was learnt (`learnt`).
"""

from collections.abc import Callable, Iterable, Mapping, Sequence

import cv2
import numpy as np

from services.mocap.camera.camera import Camera
from services.mocap.side_by_side import side_by_side
from services.mocap.types import ACTOR, UNSURE, Bytes, Ints, Mask, Trimap
from services.segmentation.cleanup import (
    SPECK_AREA_PPM,
    Part,
    box_of,
    cleanup_in_place,
    drop_unconfirmed,
    opened,
)
from services.segmentation.codec_errors import CodecErrors
from services.segmentation.comparison import CHANGED, LEAST_CHANGE, PERHAPS_SHADOW, UNSEEN, Comparison
from services.segmentation.decision import actor_evidence, beliefs, prices
from services.segmentation.edges import EDGE_WIDTH_PERMILLE, settle_edges
from services.segmentation.floor_shadow import ON_ITS_OWN, SUPPORTED, UNKNOWN, Floor, find_floor
from services.segmentation.floor_views import hidden_floor
from services.segmentation.learnt import ActorColours, Learnt
from services.segmentation.lenses import Lenses
from services.segmentation.pixels import Levels, Steps
from services.segmentation.plate import Plate
from services.segmentation.static_objects import StaticObjects
from services.segmentation.unsure import HARDLY_AGAINST, unsure_pixels
from services.segmentation.voxels import ALONE, INSIDE, MISS, MORE_MISS, VoxelGrid

_ROUNDS = 3
"""Rounds of messages; more change almost nothing."""
_LIKELY_SHADOW = 0.0
"""Log odds of shadow from which a pixel teaches nothing about the actor."""
_SURELY_CHANGED, _SURELY_SAME = 1.0, -0.5
"""Evidence for a change above which a pixel has surely changed, and below which it surely has not: only such
pixels are used to learn colours and the weight of the other cameras."""
_BIAS = np.float32(-0.3)
"""Bias against the actor: rims mix both and are better cut off here, because the edges are settled
afterwards."""
_NO_WORD = -1.7
"""In place of the others' word where too few see a place: the pixel is then unsure only if its own evidence
is."""
_MANY_CAMERAS = 5
"""The rays of fewer others often meet where nothing is: that a camera sees nothing there is then no sign of
furniture before it, and little of the space about the actor is excluded."""
_MARGIN_PX, _RIM_MARGIN_PX = 8, 6
"""Around what may be the actor, so that messages can spread; around what is, so that edges can be settled."""


class JointMatte:
    """Segments pictures that one or several cameras took at one moment."""

    def __init__(self, cameras: Sequence[Camera], plates: Sequence[Plate]) -> None:
        self._cameras = list(cameras)
        self._compared = [Comparison(plate) for plate in plates]
        self._errors = [CodecErrors(plate) for plate in plates]
        self._learnt = [Learnt(plate.shape) for plate in plates]
        self._lenses = Lenses.of(cameras)
        self._has_others = len(cameras) > 1
        self._floor: Floor | None = None
        if self._has_others:
            hidden = hidden_floor(0.0, self._lenses, self._plate_means)
            self._floor = Floor.at(0.0, cameras, hidden)
        self._voxels: VoxelGrid | None = None
        self._objects: StaticObjects | None = None
        if len(cameras) > 2:
            self._fill_with_voxels(0.0)
        self._are_many = len(cameras) >= _MANY_CAMERAS
        width, height = self._lenses.sizes_px.max(axis=0)
        shape = len(self._cameras), int(height), int(width)
        self._ratios: Levels = np.ones(shape, np.float32)
        self._states: Bytes = np.full(shape, UNSEEN, np.uint8)
        self._misses: Bytes = np.full(shape, MISS, np.uint8)

    def trimaps(self, images_bgr: Mapping[int, Bytes], /) -> dict[int, Trimap]:
        """The actor in raw pictures (H, W, 3) by their camera's place: trimaps (H, W).

        Cameras may be missing. Raises UserError if a picture does not have its plate's size.
        """
        there = self._compare(images_bgr)
        shadow_priors = self._shadow_priors(there)
        classes = self._classes(shadow_priors, there)
        cut = side_by_side(lambda c: self._cut(c, shadow_priors[c], classes[c]), shadow_priors)
        trimaps = dict(zip(shadow_priors, cut, strict=True))
        for c, trimap in trimaps.items():
            trimap[self._learnt[c].moved] = UNSURE
        return trimaps

    @property
    def moved(self) -> list[Mask]:
        """Per camera (H, W): where an object was added or removed since the plate was recorded."""
        return [learnt.moved for learnt in self._learnt]

    @property
    def blind(self) -> list[Mask]:
        """Per camera (H, W): where something seems to hide what nearly all other cameras see."""
        return [learnt.blind for learnt in self._learnt]

    def shifts_px(self, images_bgr: Mapping[int, Bytes]) -> list[float]:
        """By how much pictures of all cameras are off their plates; they are moved back before any work."""
        plates = (compared.plate for compared in self._compared)
        return [float(np.hypot(*plate.anchors.shift_px(images_bgr[c]))) for c, plate in enumerate(plates)]

    def allow_for_errors(self, moments: Iterable[Mapping[int, Bytes]]) -> None:
        """Expect codecs' errors as large as those in pictures of some moments, and of earlier calls."""
        for images in moments:
            self._compare(images)
            side_by_side(lambda c: self._errors[c].add(self._compared[c]), images)
        for compared, errors in zip(self._compared, self._errors, strict=True):
            compared.plate = errors.plate

    def learn(self, images_bgr: Mapping[int, Bytes]) -> None:
        """Collect the certain actor pixels in pictures; `conclude` puts them to use."""
        there = self._compare(images_bgr)
        shadow_priors = self._shadow_priors(there)
        classes = self._classes(shadow_priors, there)

        def add(c: int) -> Mask:
            compared = self._compared[c]
            in_shadow = compared.state == PERHAPS_SHADOW
            if self._floor is not None:
                in_shadow &= shadow_priors[c] >= _LIKELY_SHADOW
            changed: Mask = (compared.change > _SURELY_CHANGED) & ~in_shadow
            steadied = np.ascontiguousarray(np.moveaxis(compared.channels, 0, 2))
            self._learnt[c].add(steadied, classes[c], changed, compared.change < _SURELY_SAME)
            return changed

        changed = side_by_side(add, shadow_priors)
        if self._objects is not None:
            self._objects.add(dict(zip(shadow_priors, changed, strict=True)))

    def learn_all(self, moments: Callable[[], Iterable[Mapping[int, Bytes]]]) -> None:
        """Learn from all moments, and conclude; where objects were moved, once more without them, since their
        colours were taken for the actor's."""
        for images in moments():
            self.learn(images)
        self.conclude()
        if any(moved.any() for moved in self.moved):
            for c, learnt in enumerate(self._learnt):
                self._learnt[c] = Learnt(self._compared[c].plate.shape, learnt.moved)
            for images in moments():
                self.learn(images)
            self.conclude()

    def conclude(self) -> None:
        """Use what was learnt from now on."""
        of_all = ActorColours(np.sum([learnt.colours.counts for learnt in self._learnt], axis=0))
        plates = [compared.plate for compared in self._compared]
        if self._objects is None:
            objects = [np.zeros(plate.shape, bool) for plate in plates]
        else:
            objects = self._objects.masks([plate.shape for plate in plates])
        for learnt, plate, of_camera in zip(self._learnt, plates, objects, strict=True):
            learnt.conclude(plate, of_all, of_camera)

    def settle_floor(self, moments: Sequence[Mapping[int, Bytes]]) -> None:
        """Find the height of the floor from the shadows in pictures of some moments."""
        if not self._has_others:
            return
        seen = []
        for images in moments:
            there = self._compare(images)
            seen.append((self._ratios.copy(), self._states.copy(), there))
        self._floor = find_floor(self._cameras, self._lenses, seen, self._plate_means)
        if self._voxels is not None:
            self._fill_with_voxels(self._floor.height_m if self._floor is not None else 0.0)

    def _fill_with_voxels(self, floor_m: float) -> None:
        """Fill the place above a floor; a wrong calibration has none that several cameras look at."""
        voxels = VoxelGrid.of(self._cameras, self._lenses, floor_m)
        if len(voxels.coarse_m):
            self._voxels, self._objects = voxels, StaticObjects(voxels)

    @property
    def _plate_means(self) -> list[Steps]:
        """Per camera (3, H, W), in steps."""
        return [compared.plate.mean for compared in self._compared]

    def _compare(self, images_bgr: Mapping[int, Bytes]) -> Ints:
        """Compare pictures with their plates; returns the cameras that have one."""
        self._states[:] = UNSEEN

        def look(c: int) -> None:
            compared = self._compared[c]
            compared.look(images_bgr[c])
            height, width = compared.plate.shape
            self._ratios[c, :height, :width] = compared.ratio
            self._states[c, :height, :width] = compared.state

        side_by_side(look, images_bgr)
        return np.array(sorted(images_bgr), np.int32)

    def _shadow_priors(self, there: Ints) -> dict[int, Levels]:
        """By camera (H, W): logarithm of the odds of shadow to light, by what the others see on the floor."""

        def prior(c: int) -> Levels:
            if self._floor is None:
                unknown = UNKNOWN if self._has_others else ON_ITS_OWN
                return np.full(self._compared[c].plate.shape, unknown, np.float32)
            part = self._compared[c].part
            return self._floor.shadow_prior(c, part, self._lenses, self._ratios, self._states, there)

        cameras = there.tolist()
        return dict(zip(cameras, side_by_side(prior, cameras), strict=True))

    def _classes(self, shadow_priors: Mapping[int, Levels], there: Ints) -> dict[int, Bytes]:
        """By camera (H, W): what the others say of each pixel, INSIDE to ALONE."""
        if self._voxels is None or len(there) <= 2:
            return {c: np.full(prior.shape, ALONE, np.uint8) for c, prior in shadow_priors.items()}
        for c, prior in shadow_priors.items():
            compared = self._compared[c]
            height, width = compared.plate.shape
            misses = np.clip(MISS / 2 * (1 - compared.change), 0, MISS).astype(np.uint8)
            misses[(compared.state == PERHAPS_SHADOW) & (prior >= SUPPORTED)] = MISS // 2
            learnt = self._learnt[c]
            tells_nothing = learnt.moved | learnt.blind if self._are_many else learnt.moved
            misses[tells_nothing] = MISS // 2
            self._misses[c, :height, :width] = misses
        classes = self._voxels.classes(self._misses, there)
        return dict(zip(shadow_priors, classes, strict=True))

    def _cut(self, camera: int, shadow_prior: Levels, classes: Bytes) -> Trimap:
        """The trimap (H, W) of one camera, by its own evidence, what the others say, and its neighbours."""
        compared, learnt, plate = self._compared[camera], self._learnt[camera], self._compared[camera].plate
        trimap: Trimap = np.zeros(plate.shape, np.uint8)
        part = self._likely_part(compared, classes)
        if part is None:
            return trimap
        corner_px, shape = (part[0].start, part[1].start), trimap[part].shape
        even = np.stack([cv2.blur(plane[part], (5, 5)) for plane in compared.channels])
        own = np.empty(shape, np.float32)
        actor_evidence(
            compared.channels, even, compared.expected, compared.deviation2, compared.ratio, plate.turn_noise,
            plate.slack, plate.log_slack, plate.log_peak, plate.log_span, learnt.log_colours, shadow_prior,
            corner_px, own,
        )  # fmt: skip
        own += _BIAS
        prior = learnt.class_prior[classes[part]]
        across, down = np.empty(shape, np.float32), np.empty(shape, np.float32)
        prices(compared.channels, compared.expected, plate.usual_noise2, corner_px, across, down)
        belief = beliefs(own + prior, across, down, _ROUNDS)
        prior[classes[part] == ALONE] = _NO_WORD
        inner = box_of((belief > 0) | (own + prior > HARDLY_AGAINST), _RIM_MARGIN_PX)
        if inner is not None:
            corner_px = part[0].start + inner[0].start, part[1].start + inner[1].start
            actor = np.ascontiguousarray(belief[inner] > 0).view(np.uint8)
            trimap[part][inner] = self._settled(compared, actor, own[inner], prior[inner], corner_px)
        return trimap

    def _likely_part(self, compared: Comparison, classes: Bytes) -> Part | None:
        """The part of the picture that may show the actor; None if there is none."""
        is_likely = (compared.change > LEAST_CHANGE) & (classes != MORE_MISS)
        if not self._are_many:  # furniture may hide legs from most of the others
            is_likely |= (compared.change > _SURELY_CHANGED) & (compared.state == CHANGED)
        changed = is_likely.view(np.uint8)
        likely = opened(changed | (classes == INSIDE), 3)
        # With few cameras all others see a change along many rays of pixels that have not changed here.
        drop_unconfirmed(likely, changed, SPECK_AREA_PPM * 1e-6 * changed.size)
        return box_of(likely, _MARGIN_PX)

    def _settled(
        self, compared: Comparison, actor: Bytes, own: Levels, prior: Levels, corner_px: tuple[int, int]
    ) -> Trimap:
        """A part of a trimap (h, w): the actor (h, w) as believed, its edges settled, and what is unsure."""
        height, width = compared.plate.shape
        rim_px = EDGE_WIDTH_PERMILLE * 1e-3 * width
        settle_edges(actor, corner_px, compared.channels, compared.expected, rim_px)
        cleanup_in_place(actor, height * width)
        trimap = actor * np.uint8(ACTOR)
        has_few = self._voxels is not None and not self._are_many
        trimap[unsure_pixels(actor, own, prior, (height, width), has_few_cameras=has_few)] = UNSURE
        if actor.any():  # space that the other cameras leave open far from the actor is empty
            body = (trimap > 0).view(np.uint8)
            drop_unconfirmed(body, actor, 1)
            trimap *= body
        return trimap
