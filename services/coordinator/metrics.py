"""Prometheus metrics of a coordinator."""

from collections.abc import Iterator

from prometheus_client import REGISTRY, Counter, Histogram
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from proto.messages import DROPPED_BY, Pose, Telemetry
from services.metrics import TIME_BUCKETS_S

_ENERGY_BUCKETS_PX = (100, 200, 500, 1000, 2000, 5000, 10_000, 20_000, 50_000, 100_000)

_FRAMES = Counter("xormocap_frames_solved", "Frames solved by this process.")
_ENERGY = Histogram(
    "xormocap_energy_px", "Differing pixels of solved frames, over all cameras.", buckets=_ENERGY_BUCKETS_PX
)
_STAGES = Histogram(
    "xormocap_stage_seconds", "Wall time of a frame's stages.", ["stage"], buckets=TIME_BUCKETS_S
)
TURNAROUND = Histogram(
    "xormocap_task_turnaround_seconds",
    "Time from a limb task's submission to its result; the rate of its sum is the mean number of tasks.",
    buckets=TIME_BUCKETS_S,
)
_DISTRUSTED = Counter("xormocap_frames_distrusted", "Frames with an unreliable part.", ["part"])


class Gauges(Collector):
    """Metrics from the latest telemetry; registers itself."""

    def __init__(self) -> None:
        self.latest: Telemetry | None = None
        REGISTRY.register(self)

    def collect(self) -> Iterator[Metric]:
        """See Collector; called from the thread that answers."""
        told = self.latest
        if told is None:
            return
        for name, meaning, value in (
            ("next_frame", "One past the last frame that was solved.", told.next_frame),
            ("end_frame", "One past the last frame that is to be tracked.", told.end_frame),
            ("frames_ready", "Frames whose silhouettes wait to be solved.", told.frames_ready),
            ("frames_unrecorded", "Poses that some recorder does not have on disk yet.", told.unrecorded),
            ("tasks_waiting", "Limb tasks that no worker has.", told.tasks_waiting),
            ("tasks_running", "Limb tasks that workers have.", len(told.limbs)),
            ("task_deadline_seconds", "Time after which a task is given out again.", told.deadline_s),
            ("workers", "Limb workers that are registered.", len(told.workers)),
            ("recorders", "Recorders that are registered.", len(told.recorders)),
        ):
            yield GaugeMetricFamily(f"xormocap_{name}", meaning, value)
        yield CounterMetricFamily("xormocap_task_retries", "Tasks given out again.", told.counts["retries"])
        dropped = CounterMetricFamily("xormocap_dropped", "Dropped or refused messages.", labels=["why"])
        for why, count in told.counts.items():
            if why != "retries":
                dropped.add_metric([why], count)
        yield dropped
        if told.drops:
            yield from _of_live(told)


def _of_live(told: Telemetry) -> Iterator[Metric]:
    lost = CounterMetricFamily(
        "xormocap_live_drops", "Pictures of a camera that were not solved.", labels=["camera", "where"]
    )
    for camera, counts in told.drops.items():
        for where, count in zip(DROPPED_BY, counts, strict=True):
            lost.add_metric([camera, where], count)
    yield lost
    yield GaugeMetricFamily("xormocap_live_absent", "Cameras without a picture just now.", len(told.absent))
    latency = GaugeMetricFamily(
        "xormocap_live_latency_seconds",
        "Time from the shutter to the pose, of the last poses.",
        labels=["which"],
    )
    for which, seconds in told.latency_s.items():
        latency.add_metric([which], seconds)
    yield latency


def note_pose(pose: Pose) -> None:
    """Count a solved frame."""
    _FRAMES.inc()
    _ENERGY.observe(pose.energy_px)
    for stage, seconds in pose.seconds.items():
        _STAGES.labels(stage).observe(seconds)
    for part in pose.distrusted:
        _DISTRUSTED.labels(part).inc()
