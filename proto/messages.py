"""Every message, its fields and units. PROTOCOL.md shows the same table in words; a test compares both.

A field annotated with Array travels as a raw binary frame of its own, all others in the msgpack header.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, ClassVar, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

PROTOCOL_VERSION = 8
MAX_SHARDS = 64
"""Workers that may share one limb's grid."""
MAX_TOLD = 200
"""Clients that telemetry tells of by name."""
MAX_BACKENDS = 20
"""Energy backends that one run may tell apart."""
MAX_CAMERAS = 256
OPEN_END = 2**31 - 1
"""The end_frame of live input, which ends when somebody ends it."""

Count: TypeAlias = Annotated[int, Field(ge=0, lt=2**31)]
Name: TypeAlias = Annotated[str, Field(min_length=1, max_length=200)]
Hash: TypeAlias = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
Run: TypeAlias = Annotated[str, Field(pattern=r"^[0-9a-f]{32}$")]
Scalar: TypeAlias = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Moment: TypeAlias = Annotated[float, Field(allow_inf_nan=False)]
_Whole: TypeAlias = Annotated[int, Field(ge=-(2**31), lt=2**31)]
_Number: TypeAlias = Annotated[float, Field(allow_inf_nan=False)]
_Text: TypeAlias = Annotated[str, Field(max_length=200)]
Limb: TypeAlias = Literal["left_arm", "right_arm", "left_leg", "right_leg"]
Part: TypeAlias = Literal["torso", "head", "left_arm", "right_arm", "left_leg", "right_leg"]
Share: TypeAlias = Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)]
Setting: TypeAlias = bool | _Whole | _Number | _Text | list[_Whole] | list[_Number]
Memory: TypeAlias = Annotated[
    dict[Name, Annotated[list[_Whole], Field(max_length=100)]], Field(max_length=20)
]
Measured: TypeAlias = Annotated[
    dict[Name, Annotated[list[Scalar], Field(max_length=MAX_CAMERAS)]], Field(max_length=50)
]
Settings: TypeAlias = Annotated[dict[Name, Setting], Field(max_length=100)]


@dataclass(frozen=True)
class Array:
    """How an array field travels: little-endian, C order, one frame."""

    dtype: Literal["uint8", "int32", "float64"]
    shape: tuple[str | int, ...]
    """A number is that size; a letter any size, the same wherever it stands in the message."""


MESSAGES: dict[str, type["Message"]] = {}
"""All messages by their type, in the order of PROTOCOL.md; each class that names its type adds itself."""


class Message(BaseModel):
    """What all messages have in common."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, arbitrary_types_allowed=True)
    type: ClassVar[str]

    def __init_subclass__(cls, type: str | None = None, **options: Any) -> None:  # noqa: A002
        super().__init_subclass__(**options)
        if type is not None:
            cls.type = type
            MESSAGES[type] = cls


class OfTake(Message):
    """What belongs to a take."""

    take: Name
    """The take's name, from take.toml or the live configuration."""


class OfRun(OfTake):
    """What belongs to a run."""

    run: Run
    """The coordinator's run that this belongs to, a random name; it outlives a coordinator that dies."""


_Unsure: TypeAlias = Annotated[NDArray[np.uint8], Array("uint8", ("Q", "H", "W"))]


def _no_planes_like(field: str) -> Callable[[dict[str, Any]], NDArray[np.uint8]]:
    """What makes planes (0, H, W) where that other field holds planes (P, H, W)."""

    def none_of_them(fields: dict[str, Any]) -> NDArray[np.uint8]:
        return fields[field][:0] if field in fields else np.zeros((0, 0, 0), np.uint8)

    return none_of_them


class Hello(Message, type="hello"):
    """A client of the coordinator says that it is there and ready (again)."""

    role: Literal["limb_worker", "recorder"]
    """What the coordinator may expect of it."""
    name: Name
    """Chosen by the client, unique among all: role, host and process id."""
    backend: Annotated[str, Field(max_length=50)]
    """The energy backend that a limb worker begins with; empty for a recorder."""


class Beat(Message, type="beat"):
    """I am here; sent either way when there is nothing else to say."""


class OfLimbTask(OfRun):
    """What a limb task, its result and its refusal have in common: what tells that task from all others."""

    frame: Count
    """The frame's number in the take."""
    pass_index: Count
    """Tells the searches of one frame apart; no more follows from it."""
    limb: Limb
    """An arm with its hand, or a leg with its foot."""
    shard: Count
    """Which part of the limb's grid to search, less than shards: every shards-th point from this one on."""
    shards: Annotated[int, Field(ge=1, le=MAX_SHARDS)]
    """Into how many parts the limb's grid is divided."""

    @property
    def task_key(self) -> dict[str, Any]:
        """These fields, to make an answer with."""
        return {name: getattr(self, name) for name in OfLimbTask.model_fields}


class LimbTask(OfLimbTask, type="limb_task"):
    """One limb of one pass over one frame, self-contained but for the two blobs that it names."""

    actor: Hash
    """Names the blob of kind actor."""
    rig: Hash
    """Names the blob of kind rig."""
    search: Settings
    """The search settings by name; those left out have the default of the worker's version."""
    pose: Annotated[NDArray[np.float64], Array("float64", ("D",))]
    """The present pose: the body's D parameters, in metres and radians, in the z-up world."""
    origin_px: Annotated[NDArray[np.int32], Array("int32", ("C", 2))]
    """x and y of the window's first pixel in each camera's undistorted picture."""
    window: Annotated[NDArray[np.uint8], Array("uint8", ("P", "h", "w"))]
    """Input silhouettes: bit c % 8 of plane c // 8 is camera c's; unused bits are 0. Where distances cost,
    wider than the window on all sides by distance_cap_px, rounded up, and one."""
    unsure: Annotated[NDArray[np.uint8], Array("uint8", ("Q", "h", "w"))] = Field(
        default_factory=_no_planes_like("window")
    )
    """As in the silhouettes, in the layout of window: Q = P, or 0 where nothing is unsure."""


class LimbResult(OfLimbTask, type="limb_result"):
    """A solved limb task."""

    energy_px: Scalar
    """What the differing pixels in the limb's window cost by the search settings; the extremity is not yet
    turned."""
    evaluations: Count
    """How often the energy was evaluated."""
    seconds: Scalar
    """Time that solving took, in seconds."""
    backend: Name
    """The energy backend that solved it."""
    values: Annotated[NDArray[np.float64], Array("float64", ("d",))]
    """The limb's parameters, in radians and within the joint limits: ball, hinge, then hand or foot."""


class LimbRefusal(OfLimbTask, type="limb_refusal"):
    """A worker cannot solve a task that it was given."""

    reason: Annotated[str, Field(max_length=1000)]
    """Why, for a log."""


class BlobRequest(Message, type="blob_request"):
    """A client lacks the content that a message named."""

    hash: Hash
    """SHA-256 of the content that is asked for."""


class Blob(Message, type="blob"):
    """Content by its SHA-256."""

    hash: Hash
    """SHA-256 of the content's bytes, in lower-case hexadecimal."""
    kind: Literal["actor", "rig", "mesh"]
    """What the content is; a mesh is named by an actor that has its own."""
    content: Annotated[NDArray[np.uint8], Array("uint8", ("n",))]
    """UTF-8 text: actor.toml, or the rig as JSON; or an own mesh: the bytes of actor_mesh.npz."""


class Silhouettes(OfRun, type="silhouettes"):
    """Undistorted silhouettes of some cameras in one frame."""

    frame: Count
    """The frame's number in the take."""
    cameras: Annotated[list[Count], Field(min_length=1, max_length=256)]
    """Which cameras, by their place in calibration.toml, from 0; none twice."""
    planes: Annotated[NDArray[np.uint8], Array("uint8", ("P", "H", "W"))]
    """Bit k % 8 of plane k // 8 is the silhouette of the k-th camera of the list, from 0."""
    unsure: _Unsure = Field(default_factory=_no_planes_like("planes"))
    """Pixels that may be actor or not, in the layout of planes: they count for nothing. Q = P, or 0 where
    there is none; a bit that is set in both means unsure."""


class Credit(OfRun, type="credit"):
    """How far segmentation may go: frames from next_frame on, up to but not including end_frame."""

    next_frame: Count
    """The first frame of which a camera is still lacking; those before it are no longer wanted."""
    end_frame: Count
    """One past the last frame that may be sent."""


class TakeInfo(OfRun, type="take_info"):
    """What a recorder must know to write a take's results."""

    fps: Annotated[float, Field(gt=0, lt=10000)]
    """Frames per second of the recording."""
    first_frame: Count
    """The first frame that is tracked."""
    end_frame: Count
    """One past the last frame that is to be tracked; 2147483647 for live input, whose end is open."""
    plan: Hash
    """Names what poses depend on: take, frames, settings. Runs of one plan can go on from each other."""
    shards: Annotated[int, Field(ge=1, le=MAX_SHARDS)]
    """Into how many parts limbs' grids are divided in this run."""
    actor: Hash
    """Names the blob of kind actor."""
    rig: Hash
    """Names the blob of kind rig."""
    backend: Name
    """The coordinator's own energy backend at the first frame."""
    backend_reason: Annotated[str, Field(max_length=1000)]
    """Why it is that one, in words."""
    threads: Count
    """Threads of the coordinator's cpu backend; 0 for one per core."""
    search: Settings
    """The search settings by name."""


class Pose(OfRun, type="pose"):
    """A solved frame."""

    frame: Count
    """The frame's number in the take."""
    time_s: Scalar
    """The frame's time in the take: frame / fps, in seconds. Live: since the shutter of shot 0."""
    energy_px: Scalar
    """Differing pixels, over all cameras, of the whole body."""
    passes: Count
    """Rounds of torso, limbs and head that it took."""
    evaluations: Count
    """How often the energy was evaluated, by workers too."""
    workers: Count
    """Limb workers alive when the frame was solved."""
    retries: Count
    """Limb tasks given out again or solved by the coordinator since the take began."""
    backend: Name
    """The coordinator's own energy backend by then."""
    worker_backends: Annotated[dict[Name, Count], Field(max_length=MAX_BACKENDS)]
    """Limb results that counted and came from workers since the take began, by their energy backend."""
    seconds: Annotated[dict[Name, Scalar], Field(max_length=20)]
    """Wall time in seconds per stage: torso (or the whole body's alignment), head, limbs; by a limb's name
    what solving it took; frame: since the frame before was published; overhead: the coordinator's processor
    time that went into anything but fitting."""
    confidence: Annotated[dict[Part, Share], Field(max_length=6)] = Field(default_factory=dict)
    """How far each part may be trusted in this frame, from 0 to 1; a part that is left out was not judged."""
    distrusted: Annotated[list[Part], Field(max_length=6)] = Field(default_factory=list)
    """Parts that must not be trusted in this frame, none twice; the torso stands for the whole body."""
    measured: Measured = Field(default_factory=dict)
    """What else was measured of the frame, by name (see What is measured of a frame)."""
    memory: Memory = Field(default_factory=dict)
    """What the coordinator knows by then beside the last two poses, for one that goes on after it."""
    shot: Count = 0
    """Live: which shot of the cameras this is, some of which are never solved; else as frame."""
    latency_s: Scalar = 0.0
    """Live: from the shutter to this message; else 0."""
    absent: Annotated[list[Count], Field(max_length=MAX_CAMERAS)] = Field(default_factory=list)
    """Live: cameras that had no picture of this shot and no say in the pose, by their place from 0."""
    pose: Annotated[NDArray[np.float64], Array("float64", ("D",))]
    """The body's D parameters, in metres and radians, in the z-up world."""
    steady: Annotated[NDArray[np.float64], Array("float64", ("k", "D"))] = Field(
        default_factory=lambda fields: np.zeros((0, len(fields.get("pose", ()))))
    )
    """Live: k = 1, the pose as a one-euro filter makes it of those up to now, for whoever shows it; else
    k = 0."""


class PoseRequest(Message, type="pose_request"):
    """A recorder missed frames: send them again."""

    run: Run
    """The run whose frames these are."""
    first_frame: Count
    """The first frame that is missing."""
    end_frame: Count
    """One past the last frame that is missing."""


class SilhouettesRequest(Message, type="silhouettes_request"):
    """A viewer wants to see what was compared with the model: all silhouettes of a frame, solved just now."""

    frame: Count
    """The frame's number in the take."""


class Recording(OfTake, type="recording"):
    """What a recorder has on disk of a take; said after its hello, even if it is nothing, and as it grows."""

    run: Annotated[str, Field(pattern=r"^([0-9a-f]{32})?$")]
    """The run that it has poses of; empty where it has none."""
    plan: Annotated[str, Field(pattern=r"^([0-9a-f]{64})?$")]
    """As in the take's description; empty where there is no run."""
    shards: Annotated[int, Field(ge=1, le=MAX_SHARDS)]
    """As in the take's description; 1 where there is no run."""
    end_frame: Count
    """One past the last frame before which it has them all."""
    retries: Count
    """As in the last of these poses; 0 where there is none."""
    worker_backends: Annotated[dict[Name, Count], Field(max_length=MAX_BACKENDS)]
    """As in the last of these poses."""
    memory: Memory
    """As in the last of these poses."""
    poses: Annotated[NDArray[np.float64], Array("float64", ("k", "D"))]
    """The last two of these poses, or fewer where there are not so many."""
    actor: Annotated[NDArray[np.uint8], Array("uint8", ("n",))]
    """UTF-8 text: actor.toml of the run; empty where it is not known yet."""


class Telemetry(OfTake, type="telemetry"):
    """How a coordinator is doing; published about twice a second, also before a take has begun."""

    run: Annotated[str, Field(pattern=r"^([0-9a-f]{32})?$")]
    """The run; empty as long as it waits for clients."""
    stage: Literal["waiting for clients", "first frame", "tracking", "ended"]
    """What it is at."""
    first_frame: Count
    """The first frame that is tracked."""
    next_frame: Count
    """One past the last frame that was solved."""
    end_frame: Count
    """As in the take's description."""
    frames_ready: Count
    """Frames whose silhouettes are all there and that are not being solved yet."""
    unrecorded: Count
    """Poses that a recorder has not got on disk yet."""
    deadline_s: Scalar
    """How long a limb task may take, in seconds, before it is given to somebody else too."""
    tasks_waiting: Count
    """Limb tasks that no worker has."""
    workers: Annotated[dict[Name, Name], Field(max_length=MAX_TOLD)]
    """Limb workers by name (role@host:process id), with the energy backend that each began with."""
    limbs: Annotated[dict[Name, Limb], Field(max_length=MAX_TOLD)]
    """What those workers that have a task are searching."""
    recorders: Annotated[dict[Name, Count], Field(max_length=MAX_TOLD)]
    """Recorders by name, and one past the last frame before which each has them all on disk."""
    counts: Annotated[dict[Name, Count], Field(max_length=20)]
    """Since it was started: retries (tasks given out again), and what was dropped and why."""
    seconds: Annotated[dict[Name, Scalar], Field(max_length=20)]
    """As in the last pose."""
    latency_s: Annotated[dict[Name, Scalar], Field(max_length=20)] = Field(default_factory=dict)
    """Live: from the shutter to the pose, over the last poses: median, and p95, which 95% of them stay
    below."""
    drops: Annotated[
        dict[Name, Annotated[list[Count], Field(min_length=3, max_length=3)]], Field(max_length=MAX_CAMERAS)
    ] = Field(default_factory=dict)
    """Live, by camera: shots of which the source gave no picture, pictures that segmentation did not get to,
    and shots that arrived here but were not solved, since newer ones had come."""
    absent: Annotated[list[Name], Field(max_length=MAX_CAMERAS)] = Field(default_factory=list)
    """Live: cameras that have no picture just now."""


class TakeEnd(OfRun, type="take_end"):
    """No pose will follow."""

    first_frame: Count
    """The first frame that was asked for."""
    end_frame: Count
    """One past the last frame that was solved; equal to first_frame if there is none."""
    end_shot: Count = 0
    """Live: one past the last shot that belongs to a recording of the cameras; else 0."""


class LiveSilhouettes(OfRun, type="live_silhouettes"):
    """Live: undistorted silhouettes of some cameras in one shot."""

    shot: Count
    """Which shot it is, as the live pace counts them."""
    cameras: Annotated[list[Count], Field(min_length=1, max_length=MAX_CAMERAS)]
    """Which cameras, by their place in calibration.toml, from 0; none twice. Those of the sender that are
    left out have no picture of this shot."""
    times_s: Annotated[list[Moment], Field(min_length=1, max_length=MAX_CAMERAS)]
    """When each of them took its picture, on the coordinator's clock."""
    planes: Annotated[NDArray[np.uint8], Array("uint8", ("P", "H", "W"))]
    """Bit k % 8 of plane k // 8 is the silhouette of the k-th camera of the list, from 0."""
    unsure: _Unsure = Field(default_factory=_no_planes_like("planes"))
    """Pixels that may be actor or not, in the layout of planes: they count for nothing. Q = P, or 0 where
    there is none; a bit that is set in both means unsure."""


class LiveSources(OfTake, type="live_sources"):
    """Live: a segmentation says how its cameras are doing, and asks for the pace; about twice a second."""

    asked_s: Moment
    """When this was sent, on the sender's clock."""
    cameras: Annotated[list[Count], Field(min_length=1, max_length=MAX_CAMERAS)]
    """Its cameras, by their place in calibration.toml, from 0; none twice."""
    latest_s: Annotated[list[Moment], Field(max_length=MAX_CAMERAS)]
    """When those that deliver by a clock of their own took their latest pictures, on the coordinator's clock;
    empty as long as that is not known."""
    missed: Annotated[list[Count], Field(max_length=MAX_CAMERAS)]
    """Per camera: shots of which its source gave no picture."""
    dropped: Annotated[list[Count], Field(max_length=MAX_CAMERAS)]
    """Per camera: pictures that were not segmented, since newer ones had come."""
    unsent: Count
    """Shots that were segmented but not sent, since the coordinator took none at that time."""
    absent: Annotated[list[Count], Field(max_length=MAX_CAMERAS)]
    """Cameras that have no picture just now."""
    ended: bool
    """Whether no picture will ever follow, since all sources are files that are over."""


class LivePace(OfTake, type="live_pace"):
    """Live: the coordinator's answer to live_sources: which shot is when, and what its clock says."""

    run: Annotated[str, Field(pattern=r"^([0-9a-f]{32})?$")]
    """The run; empty as long as it has not begun, and then there is no shot yet."""
    asked_s: Moment
    """As it was asked: the sender's own clock, so that it can tell how long the round trip took."""
    answered_s: Moment
    """When this was answered, on the coordinator's clock, in seconds from anywhere."""
    clock: Name
    """Names that clock: who reads the same one need not compare."""
    shot: Count
    """A shot …"""
    shot_s: Moment
    """… and when it is due, on the coordinator's clock."""
    period_s: Scalar
    """From one shot to the next."""


class Recorded(Message, type="recorded"):
    """A recorder has every frame before end_frame."""

    run: Run
    """The run whose frames these are."""
    end_frame: Count
    """One past the last frame that it has."""


@cache
def arrays_of(message: type[Message]) -> Mapping[str, Array]:
    """The array fields of a message type, in the order of their frames."""
    return {
        name: extra
        for name, field in message.model_fields.items()
        for extra in field.metadata
        if isinstance(extra, Array)
    }
