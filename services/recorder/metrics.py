"""Prometheus metrics of a recorder."""

from prometheus_client import Counter, Gauge, Histogram

from services.metrics import TIME_BUCKETS_S

FRAMES = Gauge("xormocap_recorded_frames", "Consecutive frames on disk, from the first.")
FOREIGN = Gauge("xormocap_messages_foreign", "Messages of other runs that were dropped.")
ASKED = Counter("xormocap_frames_asked_for", "Requests for missing frames.")
SYNC = Histogram(
    "xormocap_journal_sync_seconds", "Time until the journal was on disk.", buckets=TIME_BUCKETS_S
)
