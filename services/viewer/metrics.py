"""Prometheus metrics of a viewer."""

from prometheus_client import Counter, Gauge, Histogram

from services.metrics import TIME_BUCKETS_S

FRAMES = Counter("xormocap_frames_shown", "Received poses; repeated ones count again.")
ANSWER = Histogram(
    "xormocap_page_answer_seconds", "Time until a browser has received an update.", buckets=TIME_BUCKETS_S
)
BEHIND = Histogram(
    "xormocap_page_behind_seconds", "Age of a pose when a browser that follows live has received it.",
    buckets=TIME_BUCKETS_S,
)  # fmt: skip
BROWSERS = Gauge("xormocap_browsers", "Browsers that show the page.")
