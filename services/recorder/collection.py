"""Collects the poses of one take, without a socket, and knows which are missing."""

import logging
from collections.abc import Iterator

import numpy as np

from proto.messages import Blob, Pose, PoseRequest, Recording, TakeEnd, TakeInfo
from services.blob_store import BlobStore, UnusableBlobError
from services.mocap.body.actor import Actor
from services.mocap.body.kinematics import N_DOF
from services.mocap.search.settings import SearchSettings
from services.recorder.store import Store

log = logging.getLogger(__name__)

_REMEMBERED = 2
"""Number of poses that a tracker needs to continue."""
_SETTLED = ("energy_px", "confidence", "distrusted", "measured", "pose", "settled")
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
        self._coordinator = ""
        """The name of the latest one."""
        self.is_announced = False
        """Whether a coordinator has described this run, and not only the journal of an earlier recorder."""
        self._blobs = BlobStore()
        self.foreign = 0
        """Number of dropped messages of other runs."""
        for message in store.described:
            self._describe(message)
        if frames := store.first.frames:
            self._run = store.first[frames[0]].run
        if self.info is not None and store.first.end == self.info.end_frame:
            self._is_settled = self._goes_both_ways(self.info)
            if not self._is_settled or self.missing_settled() is None:  # else more is to follow
                self._end = self.info.end_frame

    def add(self, message: TakeInfo | Pose | TakeEnd | Blob) -> None:
        """Add a message; repeated, foreign and damaged ones change nothing.

        The description of another run means that the coordinator has started again: everything so far is
        dropped. If it continues a live run, what was received of the moments after that is dropped.
        """
        if isinstance(message, TakeInfo):
            if self._run not in (None, message.run):
                self.info, self._end, self._blobs = None, None, BlobStore()
                self._is_empty = self._is_settled = False
                self._store.forget()
            elif self.info is not None and message.is_live and message.coordinator != self._coordinator:
                self._coordinator = message.coordinator
                self._end, self._is_settled = None, False
                self._store.keep(message)
            self.is_announced = True
        if isinstance(message, TakeInfo | Blob):
            if self._describe(message):
                self._store.keep(message)
        elif self._run not in (None, message.run):
            self.foreign += 1
            if isinstance(message, TakeEnd) and not self.is_announced:  # nobody continues the journal
                self.info, self._end, self._is_empty = None, message.end_frame, True
        else:
            self._run = message.run
            if isinstance(message, TakeEnd):
                self._end, self._is_empty = message.end_frame, message.first_frame == message.end_frame
                self._is_settled = message.settled
            elif message.frame not in (self._store.settled if message.settled else self._store.first):
                self._store.keep(message)

    def _describe(self, message: TakeInfo | Blob) -> bool:
        """Add a description or content; False if it is known, unwanted or damaged (then it is requested
        again)."""
        if isinstance(message, TakeInfo):
            self._coordinator = message.coordinator
            if self.info is not None:
                return False
            self.info, self._run = message, message.run
            for poses in (self._store.first, self._store.settled):
                poses.begin(message.first_frame)
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
        end = self._end if self._end is not None else max(self._store.first.frames, default=0)
        return self._store.first.gap_before(end)

    def missing_settled(self) -> tuple[int, int] | None:
        """The first gap in the settled poses, as a range, up to the latest of them or, once it is known that
        all frames have one, the end of the take."""
        if self.info is None:
            return None
        settled = self._store.settled
        return settled.gap_before(
            self._store.first.end if self._is_settled else max(settled.frames, default=0)
        )

    @property
    def held_ends(self) -> tuple[int, int]:
        """One past the last frame up to which all first poses are here, and all settled ones."""
        return self._store.first.end, self._store.settled.end

    @property
    def n_recorded(self) -> int:
        """Number of poses from the first frame up to the first missing one."""
        return 0 if self.info is None else self._store.first.end - self.info.first_frame

    @property
    def is_final(self) -> bool:
        """Whether every frame of a recorded take is here, and settled if it is tracked both ways."""
        if self.info is None or self._store.first.end != self.info.end_frame:
            return False
        return not self._goes_both_ways(self.info) or self._store.settled.end == self.info.end_frame

    @staticmethod
    def _goes_both_ways(info: TakeInfo) -> bool:
        return SearchSettings.model_validate(info.search).goes_both_ways

    def first_poses(self) -> list[Pose]:
        """The poses from the first frame up to the first missing one, as the way forwards found them."""
        end = self._store.first.end
        return [self._store.first[frame] for frame in range(end - self.n_recorded, end)]

    def recorded(self) -> list[Pose]:
        """The same frames, settled if all of them are; of live input, those that are."""
        poses, settled = self.first_poses(), self._store.settled
        is_live = self.info is not None and self.info.is_live
        if settled.end < self._store.first.end and not is_live:
            return poses
        for n, pose in enumerate(poses):
            if pose.frame not in settled:
                continue
            found = settled[pose.frame]
            poses[n] = pose.model_copy(update={name: getattr(found, name) for name in _SETTLED})
        return poses

    def sent_back(self, request: PoseRequest) -> Iterator[Pose]:
        """The first poses that a restarted coordinator requests, as far as they are here."""
        if request.run == self._run:
            asked, first = range(request.first_frame, request.end_frame), self._store.first
            yield from (first[frame] for frame in asked if frame in first)

    def recording(self, take: str) -> Recording:
        """What is here, for a coordinator that may have to continue from it."""
        info, (end, settled_end) = self.info, self.held_ends
        remembered = range(max(end - _REMEMBERED, end - self.n_recorded), end)
        latest = [self._store.first[frame] for frame in remembered]
        last = latest[-1] if latest else None
        poses = np.array([message.pose for message in latest], np.float64)
        actor = "" if info is None else self._blobs.actor_text(info)
        return Recording(
            take=take,
            run=info.run if info else "",
            plan=info.plan if info else "",
            shards=info.shards if info else 1,
            end_frame=end,
            settled_end=settled_end,
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
