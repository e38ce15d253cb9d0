"""A recorder's figures for Prometheus."""

from prometheus_client import Counter, Gauge, Histogram

from services.metrics import TIME_BUCKETS_S

FRAMES = Gauge("xormocap_recorded_frames", "Frames on disk from the first on, without a gap.")
FOREIGN = Gauge("xormocap_messages_foreign", "Messages of other runs that were dropped.")
ASKED = Counter("xormocap_frames_asked_for", "Requests for frames that were missed.")
SYNC = Histogram(
    "xormocap_journal_sync_seconds", "Time until the journal was on disk.", buckets=TIME_BUCKETS_S
)
