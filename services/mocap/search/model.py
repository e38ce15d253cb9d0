"""The body, the cameras and the backend."""

from collections.abc import Collection, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import cached_property

from services.mocap.body.actor import Actor, Body, build_body
from services.mocap.camera.rig import Rig
from services.mocap.energy.backend import Backend
from services.mocap.energy.bitplanes import TriPlanes
from services.mocap.energy.colours import ColourPainter
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.engine import Engine
from services.mocap.energy.picture import Picture
from services.mocap.search.alignment.aligner import Aligner
from services.mocap.search.settings import SearchSettings


@dataclass(frozen=True, eq=False)
class Model:
    """The body, the cameras, and a backend made for both."""

    body: Body
    rig: Rig
    backend: Backend

    def aligner(self, settings: SearchSettings) -> Aligner:
        """The aligner of the body, with full meshes if the settings allow no level of detail."""
        return self._thinned if settings.detail_px > 0 else self._full

    def without_cameras(
        self, seen: TriPlanes, absent: Collection[int], settings: SearchSettings
    ) -> tuple[Picture, SearchSettings]:
        """A frame (P, H, W), and the settings for it, in which absent cameras count for nothing."""
        picture = Picture.of_frame(self.rig, seen).without_cameras(absent)
        return picture, settings.without_cameras(absent, self.rig.n_cameras)

    def counts_colours(self, picture: Picture, price: float) -> bool:
        """Whether pixels of a picture can have a wrong colour class that costs something."""
        return picture.classes is not None and price > 0.0 and bool(self.body.colour_classes.any())

    @cached_property
    def colours(self) -> ColourPainter:
        """Paints the body's colour classes."""
        return ColourPainter(self.body, self.rig)

    @cached_property
    def _thinned(self) -> Aligner:
        return Aligner(self.body, self.rig)

    @cached_property
    def _full(self) -> Aligner:
        return Aligner(self.body, self.rig, thinned=False)


def model_of(actor: Actor, rig: Rig, engine: Engine) -> Model:
    """The model of an actor in a rig, with a backend of the engine."""
    body = build_body(actor)
    return Model(body, rig, engine.backend(body, rig))


@contextmanager
def model_on_cpu(actor: Actor, rig: Rig) -> Iterator[Model]:
    """The model of an actor in a rig with a backend of its own on the CPU, closed at the end."""
    body = build_body(actor)
    with closing(CpuBackend(body, rig)) as backend:
        yield Model(body, rig, backend)
