"""Recorder process: `python -m services.recorder --take TAKE --out DIR --connect tcp://HOST:5550`."""

import json
import logging
import time
from pathlib import Path
from typing import Annotated

import typer

from proto.keys import ClientKeys
from proto.link import Link
from proto.messages import Blob, BlobRequest, Hello, Message, Pose, PoseRequest, Recorded, TakeEnd, TakeInfo
from proto.streams import ASK_AGAIN_S, DEFAULT_ENDPOINT, RECORDING_EVERY_S
from services.health import beat
from services.listener import PosesListener
from services.logs import about
from services.mocap.result.layout import partial_of
from services.mocap.take.live import open_source
from services.mocap.take.moved_cameras import take_of_fit
from services.options import (
    DEFAULT_OUTPUT,
    CutoffOption,
    FittedOption,
    KeysOption,
    MetricsOption,
    SmoothOption,
    keys_of_client,
    output_settings,
)
from services.pose_size import with_whole_poses
from services.process import STOP_CHECK_S, StopRequest, client_name, run_service
from services.recorder.collection import Collection
from services.recorder.metrics import ASKED, FOREIGN, FRAMES, SYNC
from services.recorder.result_folder import check_out, clear_leftovers
from services.recorder.results import write_results
from services.recorder.store import Store

_ANNOUNCEMENT_S = 20.0
"""How long a recorder whose journal holds the whole take hears nothing of a coordinator before it continues
alone."""
_GRACE_S = 1.5
"""How long to wait for the end of the take after a stop."""

log = logging.getLogger(__name__)


class RecordingListener(PosesListener):
    """Receives poses and requests missing ones until the take is complete."""

    def __init__(self, take: str, endpoint: str, store: Store, keys: ClientKeys | None = None) -> None:
        """store: where received messages are kept, including those of an earlier recorder."""
        super().__init__(endpoint, keys)
        self._take, self._store = take, store
        self.collection = Collection(store)
        hello = Hello(role="recorder", name=client_name("recorder"), backend="")
        self._link = Link(
            self.context, endpoint, hello, keys, also=lambda: self.collection.recording(self._take)
        )
        self.lines.append(self._link)
        self._asked_s = self._told_s = 0.0
        self._told_end = (0, 0)

    def listen(self, timeout_s: float) -> None:
        """Wait briefly for messages, store them, and request what is missing."""
        super().listen(timeout_s)
        with SYNC.time():
            self._store.sync()
        FRAMES.set(self.collection.n_recorded)
        FOREIGN.set(self.collection.foreign)
        self._ask()
        self._tell()

    def take_in(self, message: Message) -> None:
        """Keep what is of this take."""
        message = with_whole_poses(message)
        mine = isinstance(message, Blob) or getattr(message, "take", None) == self._take
        if mine and isinstance(message, TakeInfo | Pose | TakeEnd | Blob):
            self.collection.add(message)
        elif isinstance(message, PoseRequest):
            for pose in self.collection.sent_back(message):
                self._link.send(pose)

    def _ask(self) -> None:
        if time.monotonic() - self._asked_s < ASK_AGAIN_S:
            return
        self._asked_s = time.monotonic()
        for content in self.collection.missing_blobs():
            self._link.send(BlobRequest(hash=content))
        info = self.collection.info
        gaps = (self.collection.missing_frames(), self.collection.missing_settled())
        for gap, settled in zip(gaps, (False, True), strict=True):
            if info is not None and gap is not None:
                ASKED.inc()
                request = PoseRequest(run=info.run, first_frame=gap[0], end_frame=gap[1], settled=settled)
                self._link.send(request)

    def _tell(self) -> None:
        """Report from time to time what is on disk, so that the coordinator need not keep it."""
        now, end = time.monotonic(), self.collection.held_ends
        if end != self._told_end and now - self._told_s > RECORDING_EVERY_S:
            self._told_s, self._told_end = now, end
            self._link.send(self.collection.recording(self._take))

    def confirm(self) -> None:
        """Tell the coordinator that every frame is here."""
        if self.collection.info is not None:
            self._link.send(self.collection.recording(self._take))
            self._link.send(Recorded(run=self.collection.info.run, end_frame=self.collection.end_frame))


def _listen(listener: RecordingListener, stop: StopRequest) -> None:
    """Listen until the take is complete or a stop is requested.

    The journal may be complete without a message of a coordinator: it may have exited, or may not have
    announced its new run yet.
    """
    collection, stopped_s = listener.collection, None
    while not (
        collection.complete
        and (collection.is_announced or time.monotonic() - listener.heard_s > _ANNOUNCEMENT_S)
    ):
        beat()
        if stop:
            stopped_s = stopped_s or time.monotonic()
            if time.monotonic() - stopped_s > _GRACE_S:
                break
        listener.listen(STOP_CHECK_S)


def main(
    take: Annotated[Path, typer.Option(help="The take folder.")],
    out: Annotated[Path, typer.Option(help="Folder for the results.")],
    connect: Annotated[str, typer.Option(help="The coordinator's endpoint.")] = DEFAULT_ENDPOINT,
    overlay: Annotated[bool, typer.Option(help="Write overlay.mp4.")] = True,
    report: Annotated[bool, typer.Option(help="Write report.html.")] = True,
    smooth: SmoothOption = DEFAULT_OUTPUT.smooth,
    cutoff_hz: CutoffOption = None,
    fitted: FittedOption = None,
    known: Annotated[Path | None, typer.Option(help="A JSON file with further entries of run.json.")] = None,
    keys: KeysOption = None,
    metrics: MetricsOption = None,
) -> None:
    """Record a take's poses and write its results."""

    def work(stop: StopRequest) -> None:
        """Listen until the take has ended, then write its results.

        After a stop the coordinator has a moment to end the take; then the frames so far are written. A
        second stop leaves the overlay out. A journal keeps all messages until all frames are in the results.
        """
        own_keys = keys_of_client(keys, "recorder")
        entries = None if known is None else json.loads(known.read_text(encoding="utf-8"))
        output = output_settings(smooth, cutoff_hz)
        source = take_of_fit(open_source(take), fitted)
        about(take=source.settings.name)
        check_out(out)
        store, is_whole = Store(partial_of(out)), False
        try:
            clear_leftovers(out)
            listener = RecordingListener(source.settings.name, connect, store, own_keys)
            log.info("ready with %d frames, coordinator at %s", len(store.first.frames), connect)
            collection = listener.collection
            _listen(listener, stop)
            if collection.complete:
                listener.confirm()
            listener.close()
            if collection.foreign:
                log.warning("dropped %d messages of other runs", collection.foreign)
            if collection.n_recorded:  # else the coordinator reports why there is nothing
                is_whole = write_results(
                    out, source, collection, output, overlay=overlay, report=report,
                    hurry=lambda: stop.count > 1, known=entries,
                )  # fmt: skip
        finally:
            store.close(remove=is_whole)

    run_service("recorder", work, metrics)


if __name__ == "__main__":
    typer.run(main)
