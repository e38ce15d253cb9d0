"""Silhouettes of several cameras at once: evidence of each, shadow on the floor, what the others see, a cut.

A pixel is the actor's, the stage's in light, or the stage's in shadow. What is likelier is told by the
actor's colours, by whether other cameras see the same shadow on the floor, by how many of them see a change
along the pixel's ray, and by the pixel's neighbours. Where all that together tells nothing, the pixel is
unsure.
"""

from collections.abc import Mapping, Sequence

import cv2
import numpy as np

from services.mocap.camera.camera import Camera
from services.mocap.types import ACTOR, UNSURE, Bytes, Ints, Mask, Trimap
from services.segmentation.cleanup import SegmentationSettings, cleanup_in_place
from services.segmentation.colours import ActorColours
from services.segmentation.deviation import PERHAPS_SHADOW, UNSEEN
from services.segmentation.edges import settle_edges
from services.segmentation.floor_shadow import SUPPORTED, Floor, find_floor, unknown_shadow
from services.segmentation.lenses import Lenses
from services.segmentation.likelihood import actor_evidence
from services.segmentation.message_passing import beliefs, prices
from services.segmentation.patches import Part, box_of, drop_specks, drop_unconfirmed
from services.segmentation.pixels import Levels
from services.segmentation.plate import Plate
from services.segmentation.view import CHANGED, View
from services.segmentation.voxels import ALONE, INSIDE, MISS, MORE_MISS, NEAR, Stage

_ROUNDS = 3
"""Of messages; more change hardly anything."""
_SURELY_CHANGED, _SURELY_SAME = 1.0, -0.5
"""Evidence for a change by which the odds of other cameras' word, and colours, are learnt."""
_BIAS = np.float32(-0.3)
"""Evidence against the actor: rims mix both, and are better cut off, since edges are settled afterwards."""
_TELLING = -0.5
"""Prior odds by the other cameras above which they are believed to see the actor along a pixel's ray."""
_HARDLY_AGAINST = -2.2
"""Log odds of a pixel, its own evidence plus the other cameras' word, above which it is unsure and not surely
background."""
_ALONE = -1.7
"""Counts there as the others' word where too few see a place to have one: such a pixel is unsure only if its
own evidence is."""
_SLIGHTLY_AGAINST = -0.5
"""Own evidence below which a pixel is the actor's by its neighbours alone."""
_MARGIN_PX, _RIM_MARGIN_PX = 8, 6
"""About what may be the actor, for messages to spread; and about what is, for edges to be settled."""
_SQUARE = np.ones((3, 3), np.uint8)


class JointSegmenter:
    """Cuts the actor out of the pictures that several cameras took at one moment; one camera will do."""

    def __init__(
        self, cameras: Sequence[Camera], plates: Sequence[Plate], settings: SegmentationSettings
    ) -> None:
        self._cameras, self._settings = list(cameras), settings
        self._views = [View(plate) for plate in plates]
        self._lenses = Lenses.of(cameras)
        self._has_others = len(cameras) > 1
        self._floor = Floor.at(0.0, cameras) if self._has_others else None
        self._stage = Stage.of(cameras, self._lenses, 0.0) if len(cameras) > 2 else None
        width, height = self._lenses.sizes_px.max(axis=0)
        shape = len(self._cameras), int(height), int(width)
        self._ratios: Levels = np.ones(shape, np.float32)
        self._states: Bytes = np.full(shape, UNSEEN, np.uint8)
        self._misses: Bytes = np.full(shape, MISS, np.uint8)

    def trimaps(self, images_bgr: Mapping[int, Bytes]) -> dict[int, Trimap]:
        """The actor in raw pictures (H, W, 3) by their camera's place: trimaps (H, W).

        Cameras may be missing. Raises UserError where a picture is not of its plate's size.
        """
        trimaps = {c: self._cut(c, *told) for c, told in self._look(images_bgr).items()}
        for c, trimap in trimaps.items():
            trimap[self._views[c].moved] = UNSURE
        return trimaps

    @property
    def moved(self) -> list[Mask]:
        """Per camera (H, W): where something stands since its plate was recorded, or no longer does."""
        return [view.moved for view in self._views]

    def learn(self, images_bgr: Mapping[int, Bytes]) -> None:
        """Take in what is sure of the actor in pictures; `conclude` makes it count."""
        for c, (shadow_prior, classes) in self._look(images_bgr).items():
            view = self._views[c]
            in_shadow = view.state == PERHAPS_SHADOW
            if self._floor is not None:
                in_shadow &= shadow_prior >= SUPPORTED
            changed = (view.change > _SURELY_CHANGED) & ~in_shadow
            view.count(images_bgr[c], classes, changed, view.change < _SURELY_SAME)
            seen_by_others = (classes <= NEAR) | (classes == ALONE)
            sure = cv2.erode((changed & seen_by_others).view(np.uint8), _SQUARE) > 0
            view.colours.add(images_bgr[c][sure])

    def conclude(self) -> None:
        """Let what was learnt count from now on."""
        of_all = ActorColours(np.sum([view.colours.counts for view in self._views], axis=0))
        for view in self._views:
            view.learn(of_all)

    def settle_floor(self, moments: Sequence[Mapping[int, Bytes]]) -> None:
        """Find out how high the floor lies, by the shadows in pictures of some moments."""
        if not self._has_others:
            return
        seen = []
        for images in moments:
            there = self._compare(images)
            seen.append((self._ratios.copy(), self._states.copy(), there))
        self._floor = find_floor(self._cameras, self._lenses, seen)
        if self._stage is not None:
            height_m = self._floor.height_m if self._floor is not None else 0.0
            self._stage = Stage.of(self._cameras, self._lenses, height_m)

    def _compare(self, images_bgr: Mapping[int, Bytes]) -> Ints:
        """Compare pictures with their plates; returns the cameras that have one."""
        self._states[:] = UNSEEN
        for c, image in images_bgr.items():
            view = self._views[c]
            view.look(image)
            height, width = view.plate.shape
            self._ratios[c, :height, :width], self._states[c, :height, :width] = view.ratio, view.state
        return np.array(sorted(images_bgr), np.int32)

    def _look(self, images_bgr: Mapping[int, Bytes]) -> dict[int, tuple[Levels, Bytes]]:
        """Per camera the prior odds of shadow (H, W), and what the others say of each pixel (H, W)."""
        there = self._compare(images_bgr)
        shadow_priors = [self._shadow_prior(int(c), there) for c in there]
        for c, prior in zip(there, shadow_priors, strict=True):
            view = self._views[c]
            height, width = view.plate.shape
            misses = np.clip(MISS / 2 * (1 - view.change), 0, MISS).astype(np.uint8)
            misses[(view.state == PERHAPS_SHADOW) & (prior >= SUPPORTED)] = MISS // 2
            misses[view.moved] = MISS // 2
            self._misses[c, :height, :width] = misses
        if self._stage is None or len(there) <= 2:
            classes = [np.full(self._views[c].plate.shape, ALONE, np.uint8) for c in there]
        else:
            classes = self._stage.classes(self._lenses, self._misses, there)
        told = zip(shadow_priors, classes, strict=True)
        return dict(zip(map(int, there), told, strict=True))

    def _shadow_prior(self, camera: int, there: Ints) -> Levels:
        if self._floor is None:
            return unknown_shadow(self._views[camera].plate.shape, has_others=self._has_others)
        part = self._views[camera].part
        return self._floor.shadow_prior(camera, part, self._lenses, self._ratios, self._states, there)

    def _cut(self, camera: int, shadow_prior: Levels, classes: Bytes) -> Trimap:
        view = self._views[camera]
        plate = view.plate
        height, width = plate.shape
        trimap: Trimap = np.zeros((height, width), np.uint8)
        part = self._likely_part(view.change, classes)
        if part is None:
            return trimap
        corner_px, shape = (part[0].start, part[1].start), trimap[part].shape
        even = np.stack([cv2.blur(plane[part], (5, 5)) for plane in view.channels])
        own = np.empty(shape, np.float32)
        actor_evidence(
            view.channels, even, view.expected, view.deviation2, view.ratio, plate.turn_noise, plate.slack,
            plate.log_slack, plate.log_peak, plate.log_span, view.log_colours, shadow_prior, corner_px, own,
        )  # fmt: skip
        own += _BIAS
        prior = view.class_prior[classes[part]]
        across, down = np.empty(shape, np.float32), np.empty(shape, np.float32)
        prices(view.channels, view.expected, plate.usual_noise2, corner_px, across, down)
        belief = beliefs(own + prior, across, down, _ROUNDS)
        prior[classes[part] == ALONE] = _ALONE
        self._settle(view, belief, own, prior, part, trimap)
        return trimap

    def _likely_part(self, change: Levels, classes: Bytes) -> Part | None:
        """The part of the picture that may show the actor; None where nothing does."""
        changed = ((change > CHANGED) & (classes != MORE_MISS)).view(np.uint8)
        likely = np.asarray(
            cv2.morphologyEx(changed | (classes == INSIDE), cv2.MORPH_OPEN, _SQUARE), np.uint8
        )
        # With few cameras there is much in which all others see a change, where this one sees none.
        drop_unconfirmed(likely, changed, self._settings.speck_area_ppm * 1e-6 * changed.size)
        return box_of(likely, _MARGIN_PX)

    def _settle(
        self, view: View, belief: Levels, own: Levels, prior: Levels, part: Part, trimap: Trimap
    ) -> None:
        """Write what is believed in a part of a picture to a trimap (H, W): its edges, and what is unsure."""
        settings, (height, width) = self._settings, trimap.shape
        inner = box_of((belief > 0) | (own + prior > _HARDLY_AGAINST), _RIM_MARGIN_PX)
        if inner is None:
            return
        actor = np.ascontiguousarray(belief[inner] > 0).view(np.uint8)
        corner_px = part[0].start + inner[0].start, part[1].start + inner[1].start
        rim_px = settings.edge_width_permille * 1e-3 * width
        settle_edges(
            actor, corner_px, view.channels, view.expected, _AS_EXPECTED, rim_px, settings.edge_misfit
        )
        cleanup_in_place(actor, height * width, settings)
        found = actor * np.uint8(ACTOR)
        doubt = _doubtful(actor > 0, own[inner], prior[inner])
        drop_specks(doubt, settings.speck_area_ppm * 1e-6 * height * width)
        found[doubt > 0] = UNSURE
        if actor.any():  # what the others leave room for far from the actor is nobody
            body = (found > 0).view(np.uint8)
            drop_unconfirmed(body, actor, 1)
            found *= body
        trimap[part][inner] = found


_AS_EXPECTED: Levels = np.ones(3, np.float32)
"""Gains of what is expected: light is in it already."""


def _doubtful(actor: Mask, own: Levels, prior: Levels) -> Bytes:
    """Which pixels (h, w) are unsure: cut off or kept against what the other cameras or their own colours
    say."""
    against = (own < _SLIGHTLY_AGAINST) & (prior <= _TELLING)
    doubt = np.where(actor, against, own + prior > _HARDLY_AGAINST)
    return np.asarray(cv2.morphologyEx(doubt.view(np.uint8), cv2.MORPH_OPEN, _SQUARE), np.uint8)
