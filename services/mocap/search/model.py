"""The body, the cameras and the backend."""

from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import cached_property
from queue import SimpleQueue
from typing import TypeVar

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
from services.mocap.side_by_side import N_CORES

_MOST_COPIES = 4
"""Each takes some tens of megabytes."""

_Given = TypeVar("_Given")
_Made = TypeVar("_Made")


@dataclass(frozen=True, eq=False)
class Model:
    """The body, the cameras, and a backend made for both; only one thread at a time may use it."""

    body: Body
    rig: Rig
    backend: Backend

    def aligner(self, settings: SearchSettings) -> Aligner:
        """The aligner of the body, with full meshes if the settings allow no level of detail."""
        return self._thinned if settings.detail_px > 0 else self._full

    def without_cameras(
        self, seen: TriPlanes, absent: Collection[int], settings: SearchSettings
    ) -> tuple[Picture, SearchSettings]:
        """A frame (see picture_of), and the settings for it, in which absent cameras count for nothing."""
        picture = self.picture_of(seen).without_cameras(absent)
        return picture, settings.without_cameras(absent, self.rig.n_cameras)

    def picture_of(self, seen: TriPlanes) -> Picture:
        """A frame (P, H, W) to track, in which cameras that show nobody or are white, while others show
        somebody, count for nothing."""
        return Picture.of_frame(self.rig, seen.doubting_failed(self.rig.sizes_px))

    def counts_colours(self, picture: Picture, price: float) -> bool:
        """Whether pixels of a picture can have a wrong colour class that costs something."""
        return picture.classes is not None and price > 0.0 and bool(self.body.colour_classes.any())

    @cached_property
    def colours(self) -> ColourPainter:
        """Paints the body's colour classes."""
        return ColourPainter(self.body, self.rig)

    @cached_property
    def copies(self) -> "ModelCopies":
        """Copies of the model, to solve several frames or poses at the same time."""
        return ModelCopies(self)

    def close(self) -> None:
        """Give back what the backend holds, and end the threads of copies."""
        self.backend.close()
        if "copies" in vars(self):
            self.copies.close()

    @cached_property
    def _thinned(self) -> Aligner:
        return Aligner(self.body, self.rig)

    @cached_property
    def _full(self) -> Aligner:
        return Aligner(self.body, self.rig, thinned=False)


class ModelCopies:
    """Copies of a model, one for every core up to four, each for a thread of its own.

    They draw on the CPU, whatever draws the model.
    """

    def __init__(self, model: Model) -> None:
        self._n = min(N_CORES, _MOST_COPIES)
        self._pool = ThreadPoolExecutor(self._n, "model")
        self._models = SimpleQueue[Model]()
        for _ in range(self._n):
            self._models.put(Model(model.body, model.rig, CpuBackend(model.body, model.rig)))

    def each(self, work: Callable[[Model, _Given], _Made], given: Iterable[_Given]) -> Iterator[_Made]:
        """What work makes of each, in order; the caller's thread reads what is given a little ahead.

        Raises what the work raises.
        """

        def with_copy(one: _Given) -> _Made:
            model = self._models.get()
            try:
                return work(model, one)
            finally:
                self._models.put(model)

        waiting = deque[Future[_Made]]()
        try:
            for one in given:
                waiting.append(self._pool.submit(with_copy, one))
                if len(waiting) == 2 * self._n:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            for future in waiting:
                future.cancel()

    def close(self) -> None:
        """End the threads."""
        self._pool.shutdown(cancel_futures=True)


def model_of(actor: Actor, rig: Rig, engine: Engine) -> Model:
    """The model of an actor in a rig, with a backend of the engine."""
    body = build_body(actor)
    return Model(body, rig, engine.backend(body, rig))


@contextmanager
def model_on_cpu(actor: Actor, rig: Rig) -> Iterator[Model]:
    """The model of an actor in a rig with a backend of its own on the CPU, closed at the end."""
    body = build_body(actor)
    with closing(Model(body, rig, CpuBackend(body, rig))) as model:
        yield model
