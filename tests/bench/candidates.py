"""Who takes part: our backends as users choose them, and alternatives; whoever cannot run here says why."""

from collections.abc import Callable, Collection
from enum import StrEnum

from bench.alternatives import OpenCvSilhouettes, PyrenderSilhouettes, Silhouettes, energy_by
from bench.problems import Case, Scene
from bench.rates import Runner, with_best_batch
from services.mocap.body.actor import Body
from services.mocap.camera.camera import Camera
from services.mocap.energy.engine import Engine, open_engine
from services.mocap.energy.settings import EngineSettings
from services.mocap.errors import UserError
from services.mocap.search.model import Model
from services.mocap.search.stages import energy_of


class Name(StrEnum):
    """How candidates are called."""

    CPU = "cpu"
    CPU_LOD = "cpu-lod"
    GL = "gl"
    PAPER = "paper"
    PYRENDER = "pyrender"
    OPENCV = "opencv"


ENGINES: dict[Name, EngineSettings] = {
    Name.CPU: EngineSettings(backend="cpu"),
    Name.CPU_LOD: EngineSettings(backend="cpu"),
    Name.GL: EngineSettings(backend="gl"),
    Name.PAPER: EngineSettings(backend="paper"),
}
"""One thread each; all draw the full mesh but cpu-lod, which draws thinned ones where the search would."""
ALTERNATIVES: dict[Name, Callable[[Body, tuple[Camera, ...]], Silhouettes]] = {
    Name.PYRENDER: PyrenderSilhouettes,
    Name.OPENCV: OpenCvSilhouettes,
}


class Candidates:
    """All that take part and run here; reasons: one line for each that does not."""

    def __init__(self, names: Collection[Name]) -> None:
        self.names = [name for name in Name if name in names]
        self.reasons: list[str] = []
        self._engines: dict[Name, Engine] = {}
        for name in [name for name in self.names if name in ENGINES]:
            try:
                self._engines[name] = open_engine(ENGINES[name])
            except UserError as error:
                self.leave_out(name, str(error))
        self._models: dict[Name, Model] = {}
        self._alternatives: dict[Name, Silhouettes] = {}
        self._scene: Scene | None = None

    def leave_out(self, name: Name, reason: str) -> None:
        """Go on without a candidate."""
        self.names.remove(name)
        self.reasons.append(f"{name} is left out: {reason}")

    def enter(self, scene: Scene) -> None:
        """Get ready to draw a scene, in place of the one before."""
        self._leave()
        self._scene = scene
        for name in list(self.names):
            try:
                if name in self._engines:
                    backend = self._engines[name].backend(scene.body, scene.rig)
                    self._models[name] = Model(scene.body, scene.rig, backend)
                else:
                    self._alternatives[name] = ALTERNATIVES[name](scene.body, scene.cameras)
            except UserError as error:
                self.leave_out(name, str(error))

    def runners(self, case: Case) -> list[Runner]:
        """What there is to measure for a case of the scene: each candidate's single poses and best batch."""
        found = []
        for name in list(self.names):
            if name in self._models:
                if name is Name.PAPER and case.problem.picture.classes is not None:
                    continue  # the paper counts no colours
                # The gl backend draws all triangles, too, but has colours painted with thinned meshes.
                problem = case.thinned if name in (Name.CPU_LOD, Name.GL) else case.problem
                single = Runner(name, energy_of(self._models[name], problem), case.values)
                # To the paper's backend a batch is but its poses.
                found += [single] if name is Name.PAPER else with_best_batch(single)
            elif case.is_plain_whole and self._scene is not None:
                energy = energy_by(self._alternatives[name], self._scene.body, case.problem)
                found.append(Runner(name, energy, case.values))
        return found

    def drop_fallen(self) -> None:
        """Leave out whoever fell back to another backend: its figures are not its own."""
        for name, engine in self._engines.items():
            if name in self.names and engine.name != ENGINES[name].backend:
                self._models.pop(name)
                self.leave_out(name, engine.reason)

    def close(self) -> None:
        """Give everything back."""
        self._leave()
        for engine in self._engines.values():
            engine.close()

    def _leave(self) -> None:
        for model in self._models.values():
            model.close()
        self._models.clear()
        self._alternatives.clear()
