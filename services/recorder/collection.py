"""Collects the poses of one take, without a socket, and knows which are missing."""

import logging
from collections.abc import Iterator

import numpy as np

from proto.messages import Blob, Pose, PoseRequest, Recording, TakeEnd, TakeInfo
from services.blob_store import BlobStore, UnusableBlobError
from services.mocap.body.actor import Actor
from services.mocap.body.kinematics import N_DOF
from services.mocap.search.settings import SearchSettings
from services.mocap.types import Floats
from services.recorder.store import Store

log = logging.getLogger(__name__)

_REMEMBERED = 2
"""Number of poses that a tracker needs to continue."""
_SETTLED = ("energy_px", "confidence", "distrusted", "measured", "pose")
"""What a settled pose replaces; times and effort stay those of the first one."""


class Collection:
    """Collects what a take's results need, from one run: the coordinator's latest."""

    def __init__(self, store: Store) -> None:
        """store: where everything is kept; its present content was collected earlier."""
        self._store = store
        self.info: TakeInfo | None = None
        self._end: int | None = None
        self._is_empty = self._is_settled = False
        self._run: str | None = None
        self._held_end = self._settled_end = 0
        self.is_live = False
        """Whether a coordinator has described this run, and not only the journal of an earlier recorder."""
        self._blobs = BlobStore()
        self.foreign = 0
        """Number of dropped messages of other runs."""
        for message in store.described:
            self._describe(message)
        if store.frames:
            self._run = store.pose(store.frames[0]).run
        if self.info is not None and self.held_end == self.info.end_frame:
            self._is_settled = SearchSettings.from_wire(self.info.search).goes_both_ways
            if not self._is_settled or self.missing_settled() is None:  # else more is to follow
                self._end = self.info.end_frame

    def add(self, message: TakeInfo | Pose | TakeEnd | Blob) -> None:
        """Add a message; repeated, foreign and damaged ones change nothing.

        The description of another run means that the coordinator has started again: everything so far is
        dropped.
        """
        if isinstance(message, TakeInfo):
            if self._run not in (None, message.run):
                self.info, self._end, self._held_end, self._settled_end = None, None, 0, 0
                self._blobs = BlobStore()
                self._store.forget()
            self.is_live = True
        if isinstance(message, TakeInfo | Blob):
            if self._describe(message):
                self._store.keep(message)
        elif self._run not in (None, message.run):
            self.foreign += 1
            if isinstance(message, TakeEnd) and not self.is_live:  # nobody will continue the journal's run
                self.info, self._end, self._is_empty = None, message.end_frame, True
        else:
            self._run = message.run
            if isinstance(message, TakeEnd):
                self._end, self._is_empty = message.end_frame, message.first_frame == message.end_frame
                self._is_settled = message.settled
            elif not self._store.holds(message):
                self._store.keep(message)

    def _describe(self, message: TakeInfo | Blob) -> bool:
        """Add a description or content; False if it is known, unwanted or damaged (then it is requested
        again)."""
        if isinstance(message, TakeInfo):
            if self.info is not None:
                return False
            self.info, self._run = message, message.run
            self._held_end = self._settled_end = message.first_frame
            return True
        if message.hash not in self.missing_blobs():
            return False
        try:
            self._blobs.add(message)
        except UnusableBlobError as error:
            log.warning("unusable content: %s", error)
            return False
        return True

    def missing_blobs(self) -> list[str]:
        """Hashes of the content still needed."""
        return [] if self.info is None else self._blobs.missing(self.info)

    def actor(self) -> Actor:
        """The actor of the take, whose content has arrived."""
        if self.info is None:
            raise ValueError("the take has not been announced")
        return self._blobs.actor(self.info)

    def missing_frames(self) -> tuple[int, int] | None:
        """The first gap in the frames, as a range, up to the latest pose or, once known, the end of the
        take."""
        if self.info is None:
            return None
        end = self._end if self._end is not None else self._store.last_frame
        first = self.held_end
        if first >= end:
            return None
        return first, next((f for f in range(first, end) if f in self._store), end)

    def missing_settled(self) -> tuple[int, int] | None:
        """The first gap in the settled poses, as a range, of a run that has them for all frames."""
        if self.info is None or not self._is_settled:
            return None
        has, first, end = self._store.has_settled, self.settled_end, self.held_end
        return (first, next((f for f in range(first, end) if has(f)), end)) if first < end else None

    @property
    def settled_end(self) -> int:
        """One past the last frame up to which all settled poses are here."""
        while self.info is not None and self._store.has_settled(self._settled_end):
            self._settled_end += 1
        return self._settled_end

    @property
    def held_end(self) -> int:
        """One past the last frame up to which all frames are here."""
        while self.info is not None and self._held_end in self._store:
            self._held_end += 1
        return self._held_end

    @property
    def n_recorded(self) -> int:
        """Number of poses from the first frame up to the first missing one."""
        return 0 if self.info is None else self.held_end - self.info.first_frame

    def recorded(self) -> list[Pose]:
        """The poses from the first frame up to the first missing one, settled if all of them are."""
        frames = range(self.held_end - self.n_recorded, self.held_end)
        if self.settled_end < self.held_end:
            return [self._store.pose(frame) for frame in frames]
        return [self._settled(frame) for frame in frames]

    def first_poses(self) -> Floats:
        """(N, D) the poses of the same frames as the way forwards found them."""
        frames = range(self.held_end - self.n_recorded, self.held_end)
        return np.array([self._store.pose(frame).pose for frame in frames])

    def _settled(self, frame: int) -> Pose:
        settled = self._store.settled(frame)
        changed = {name: getattr(settled, name) for name in (*_SETTLED, "settled")}
        return self._store.pose(frame).model_copy(update=changed)

    def sent_back(self, request: PoseRequest) -> Iterator[Pose]:
        """The first poses that a restarted coordinator requests, as far as they are here."""
        if request.run == self._run:
            asked = range(request.first_frame, request.end_frame)
            yield from (self._store.pose(frame) for frame in asked if frame in self._store)

    def recording(self, take: str) -> Recording:
        """What is here, for a coordinator that may have to continue from it."""
        info, end = self.info, self.held_end
        last = self._store.pose(end - 1) if self.n_recorded else None
        remembered = range(max(end - _REMEMBERED, end - self.n_recorded), end)
        poses = np.array([self._store.pose(frame).pose for frame in remembered], np.float64)
        actor = "" if info is None else self._blobs.actor_text(info)
        return Recording(
            take=take,
            run=info.run if info else "",
            plan=info.plan if info else "",
            shards=info.shards if info else 1,
            end_frame=end,
            settled_end=self.settled_end,
            retries=last.retries if last else 0,
            worker_backends=last.worker_backends if last else {},
            memory=last.memory if last else {},
            poses=poses.reshape(-1, N_DOF),
            actor=np.frombuffer(actor.encode(), np.uint8),
        )

    @property
    def complete(self) -> bool:
        """Whether the take has ended and nothing is missing; its end may arrive before its description."""
        if self._end is None:
            return False
        if self.info is None:
            return self._is_empty
        whole = self.missing_frames() is None and self.missing_settled() is None
        return whole and not self.missing_blobs()

    @property
    def end_frame(self) -> int:
        """One past the take's last frame; only after its end."""
        if self._end is None:
            raise ValueError("the take is not over")
        return self._end
