"""A GPU's backend that goes on with another one where the GPU fails: nothing that was asked for is lost."""

from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING, TypeVar

from services.mocap.body.actor import Body
from services.mocap.camera.rig import Rig
from services.mocap.energy.backend import Backend, Energy, Problem
from services.mocap.energy.gl.device import GlLostError, GlUnavailableError
from services.mocap.energy.picture import Region
from services.mocap.types import Bytes, Floats

if TYPE_CHECKING:  # the engine makes fallbacks
    from services.mocap.energy.engine import Engine

T = TypeVar("T")


class FallbackBackend:
    """The backend that its engine makes now; not to be shared between threads."""

    def __init__(self, engine: "Engine", body: Body, rig: Rig) -> None:
        self._engine, self._body, self._rig = engine, body, rig
        self._made: tuple[str, Backend] | None = None
        self.attempt(lambda _: None)

    @property
    def name(self) -> str:
        """See Backend.name: changes where the GPU fails."""
        return self._engine.name

    def energy(self, problem: Problem) -> Energy:
        """See Backend.energy; the energy goes on with the other backend too."""
        prepared = self.attempt(lambda backend: (backend, backend.energy(problem)))

        def evaluate(backend: Backend, values: Floats) -> Floats:
            nonlocal prepared
            if prepared[0] is not backend:
                prepared = backend, backend.energy(problem)
            return prepared[1](values)

        return lambda values: self.attempt(lambda backend: evaluate(backend, values))

    def coverage(
        self, poses: Floats, segments: tuple[int, ...], region: Region, detail_px: float = 0.0
    ) -> Bytes:
        """See Backend.coverage."""
        return self.attempt(lambda backend: backend.coverage(poses, segments, region, detail_px))

    def close(self) -> None:
        """See Backend.close."""
        made, self._made = self._made, None
        if made is not None and made[0] == self._engine.name:  # else its GPU is gone, and its buffers with it
            with suppress(GlLostError):
                made[1].close()

    def attempt(self, work: Callable[[Backend], T]) -> T:
        """Do work with the backend, and where the GPU fails once more with the one that takes its place."""
        try:
            return work(self._backend())
        except (GlLostError, GlUnavailableError) as error:
            self._engine.fall_back(error)
            return work(self._backend())

    def _backend(self) -> Backend:
        """The backend; made anew where its engine has fallen back since, on whoever's behalf."""
        if self._made is None or self._made[0] != self._engine.name:
            self._made = self._engine.name, self._engine.make(self._body, self._rig)
        return self._made[1]
