"""Prometheus metrics of a limb worker."""

from prometheus_client import Counter, Gauge, Histogram

from proto.messages import LimbRefusal, LimbResult
from services.metrics import TIME_BUCKETS_S

_SECONDS = Histogram("xormocap_task_seconds", "Time to solve a limb task.", ["limb"], buckets=TIME_BUCKETS_S)
_EVALUATIONS = Counter("xormocap_energy_evaluations", "Evaluations of the energy.", ["backend"])
_REFUSED = Counter("xormocap_tasks_refused", "Limb tasks that this worker refused.")
WAITING = Gauge("xormocap_tasks_without_content", "Limb tasks that wait for an actor, a mesh or a rig.")
HELD = Gauge("xormocap_tasks_held", "Limb tasks of all coordinators that this worker has not started.")


def note_answer(answer: LimbResult | LimbRefusal) -> None:
    """Count a task that was answered."""
    if isinstance(answer, LimbRefusal):
        _REFUSED.inc()
        return
    _SECONDS.labels(answer.limb).observe(answer.seconds)
    _EVALUATIONS.labels(answer.backend).inc(answer.evaluations)
