"""A viewer's figures for Prometheus."""

from prometheus_client import Counter, Gauge, Histogram

from services.metrics import TIME_BUCKETS_S

FRAMES = Counter(
    "xormocap_frames_shown", "Poses that came in to be shown; those asked for again count again."
)
ANSWER = Histogram(
    "xormocap_page_answer_seconds", "Time until a browser had taken in an update.", buckets=TIME_BUCKETS_S
)
BEHIND = Histogram(
    "xormocap_page_behind_seconds", "How old a pose was when a browser that follows live had it.",
    buckets=TIME_BUCKETS_S,
)  # fmt: skip
BROWSERS = Gauge("xormocap_browsers", "Browsers that look at the page.")
