"""Prometheus metrics of a segmentation."""

from prometheus_client import Counter, Gauge, Histogram

from services.metrics import TIME_BUCKETS_S

FRAMES = Counter("xormocap_silhouettes_sent", "Frames sent; those sent again count again.")
SECONDS = Histogram(
    "xormocap_segmentation_seconds", "Time that a frame's silhouettes took, of all cameras here.",
    buckets=TIME_BUCKETS_S,
)  # fmt: skip
CREDIT = Gauge("xormocap_credit_frames", "Frames that the coordinator would take now.")
