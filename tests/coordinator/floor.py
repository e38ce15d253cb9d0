"""A make-believe floor for the dispatcher: a clock that tests turn, workers that lose their connection."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from proto.messages import Beat, Hello, LimbRefusal, LimbResult, LimbTask, Message
from services.coordinator.dispatch import Dispatcher, Identity
from services.mocap.body.kinematics import N_DOF
from services.mocap.search.chains import LIMBS
from services.mocap.take.marks import LIMB_NAMES, LimbName
from services.mocap.types import Floats

_RUN = "0" * 32


def limb_task(limb: LimbName = "left_arm", frame: int = 0, shard: int = 0, shards: int = 1) -> LimbTask:
    """A task of one camera, as small as they come."""
    return LimbTask(
        take="walk", run=_RUN, frame=frame, pass_index=0, limb=limb, shard=shard, shards=shards,
        actor="a" * 64, rig="b" * 64, search={}, pose=np.zeros(N_DOF), origin_px=np.zeros((1, 2), np.int32),
        window=np.zeros((1, 2, 2), np.uint8),
    )  # fmt: skip


def pass_tasks(frame: int = 0, shards: int = 1) -> list[LimbTask]:
    """The tasks of one pass over a frame."""
    return [limb_task(limb, frame, shard, shards) for limb in LIMB_NAMES for shard in range(shards)]


def result_of(task: LimbTask, energy_px: float = 1.0, values: Floats | None = None) -> LimbResult:
    """What a worker answers; the limb's rest pose unless values are given."""
    found = np.zeros(len(LIMBS[task.limb].dofs)) if values is None else values
    key = task.task_key
    return LimbResult(**key, energy_px=energy_px, evaluations=10, seconds=0.1, backend="cpu", values=found)


def refusal_of(task: LimbTask) -> LimbRefusal:
    """What a worker answers that cannot solve a task."""
    return LimbRefusal(**task.task_key, reason="no such rig")


@dataclass
class Floor:
    """A dispatcher with its clock and its workers' connections."""

    now_s: float = 1000.0
    gone: set[Identity] = field(default_factory=set)
    inbox: dict[Identity, list[LimbTask]] = field(default_factory=dict)
    """Every task that was sent to a worker, in order."""

    def __post_init__(self) -> None:
        self.dispatcher = Dispatcher(self._send, lambda: self.now_s)

    def _send(self, identity: Identity, message: Message) -> bool:
        if identity in self.gone:
            return False
        if isinstance(message, LimbTask):
            self.inbox.setdefault(identity, []).append(message)
        else:
            assert isinstance(message, Beat)
        return True

    def register(self, identity: Identity, name: str | None = None) -> None:
        """A worker says hello."""
        hello = Hello(role="limb_worker", name=name or identity.decode(), backend="cpu")
        self.dispatcher.heard(identity, hello)

    def workers(self, n: int) -> list[Identity]:
        """Register n workers."""
        identities = [b"w%d" % k for k in range(n)]
        for identity in identities:
            self.register(identity)
        return identities

    def latest(self, identity: Identity) -> LimbTask:
        """The task that a worker was given last."""
        return self.inbox[identity][-1]

    def solve(self, *identities: Identity) -> None:
        """Workers answer the tasks that they were given last; see Switchboard._act."""
        for identity in identities:
            self.dispatcher.finished(identity, result_of(self.latest(identity)))
            self.dispatcher.heard(identity)

    def later(self, seconds: float, beating: Sequence[Identity] = ()) -> None:
        """Let time pass, while some workers beat, then tick."""
        self.now_s += seconds
        for identity in beating:
            self.dispatcher.heard(identity)
        self.dispatcher.tick()

    def n_given(self) -> int:
        """How many tasks were sent so far, over all workers."""
        return sum(map(len, self.inbox.values()))


def limbs_of(results: Sequence[LimbResult | LimbTask]) -> list[tuple[str, int]]:
    """Limb and shard of each, sorted."""
    return sorted((result.limb, result.shard) for result in results)
