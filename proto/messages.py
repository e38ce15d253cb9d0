"""Every message, its fields and units. PROTOCOL.md shows the same table in words; a test compares both.

A field annotated with Array travels as its own raw binary frame, all others in the msgpack header.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, ClassVar, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

PROTOCOL_VERSION = 14
MAX_SHARDS = 64
"""Workers that may share one limb's grid."""
MAX_TOLD = 200
"""Clients that telemetry lists by name."""
MAX_BACKENDS = 20
"""Energy backends that one run counts separately."""
MAX_CAMERAS = 256
DROPPED_BY = ("source", "segmentation", "tracking")
"""What may lose a live picture, in the order of Telemetry.drops."""
LONGEST_REASON = 1000
"""Characters of a sentence that says why."""
OPEN_END = 2**31 - 1
"""The end_frame of live input, whose end is open."""

Count: TypeAlias = Annotated[int, Field(ge=0, lt=2**31)]
Name: TypeAlias = Annotated[str, Field(min_length=1, max_length=200)]
Hash: TypeAlias = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
Run: TypeAlias = Annotated[str, Field(pattern=r"^[0-9a-f]{32}$")]
Scalar: TypeAlias = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Moment: TypeAlias = Annotated[float, Field(allow_inf_nan=False)]
_Whole: TypeAlias = Annotated[int, Field(ge=-(2**31), lt=2**31)]
_Text: TypeAlias = Annotated[str, Field(max_length=200)]
Limb: TypeAlias = Literal["left_arm", "right_arm", "left_leg", "right_leg"]
Part: TypeAlias = Literal["torso", "head", "left_arm", "right_arm", "left_leg", "right_leg"]
CoordinatorStage: TypeAlias = Literal[
    "waiting for clients", "first frame", "tracking", "tracking back", "settling", "ended"
]
Share: TypeAlias = Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)]
Setting: TypeAlias = bool | _Whole | Moment | _Text | list[_Whole] | list[Moment]
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
    """A number is that size; a letter is any size, the same wherever it occurs in the message."""


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
    """The random name of the coordinator's run that this belongs to; it stays the same if the coordinator
    restarts."""


_Unsure: TypeAlias = Annotated[NDArray[np.uint8], Array("uint8", ("Q", "H", "W"))]
_Classes: TypeAlias = Annotated[NDArray[np.uint8], Array("uint8", ("B", "P", "H", "W"))]


def _none_like(field: str, *, of_bits: bool = False) -> Callable[[dict[str, Any]], NDArray[np.uint8]]:
    """A default factory: planes (0, H, W), or of bits (0, P, H, W), to match another field's (P, H, W)."""

    def none_of_them(fields: dict[str, Any]) -> NDArray[np.uint8]:
        planes: NDArray[np.uint8] = fields.get(field, np.zeros((0, 0, 0), np.uint8))
        return planes[None][:0] if of_bits else planes[:0]

    return none_of_them


class Hello(Message, type="hello"):
    """A client registers with the coordinator, for the first time or again."""

    role: Literal["limb_worker", "recorder"]
    """What kind of client it is."""
    name: Name
    """Chosen by the client, unique among all: role, host and process id."""
    backend: Annotated[str, Field(max_length=50)]
    """The energy backend that a limb worker starts with; empty for a recorder."""


class Beat(Message, type="beat"):
    """A sign of life, sent in both directions when there is nothing else to send."""


class OfLimbTask(OfRun):
    """The fields that a limb task, its result and its refusal share; they identify the task."""

    frame: Count
    """The frame's number in the take."""
    pass_index: Count
    """Distinguishes the searches of one frame; it has no other meaning."""
    limb: Limb
    """An arm with its hand, or a leg with its foot."""
    shard: Count
    """Which part of the limb's grid to search, less than shards: every shards-th point, starting from this
    one."""
    shards: Annotated[int, Field(ge=1, le=MAX_SHARDS)]
    """Into how many parts the limb's grid is divided."""

    @property
    def task_key(self) -> dict[str, Any]:
        """These fields, for an answer."""
        return {name: getattr(self, name) for name in OfLimbTask.model_fields}


class LimbTask(OfLimbTask, type="limb_task"):
    """One limb of one pass over one frame, self-contained except for the two blobs that it names."""

    actor: Hash
    """Names the blob of kind actor."""
    rig: Hash
    """Names the blob of kind rig."""
    search: Settings
    """The search settings by name; missing ones have the default of the worker's version."""
    pose: Annotated[NDArray[np.float64], Array("float64", ("D",))]
    """The current pose: the body's D parameters, in metres and radians, in the z-up world."""
    origin_px: Annotated[NDArray[np.int32], Array("int32", ("C", 2))]
    """x and y of the window's first pixel in each camera's undistorted picture."""
    window: Annotated[NDArray[np.uint8], Array("uint8", ("P", "h", "w"))]
    """Input silhouettes: bit c % 8 of plane c // 8 is camera c's; unused bits are 0."""
    unsure: Annotated[NDArray[np.uint8], Array("uint8", ("Q", "h", "w"))] = Field(
        default_factory=_none_like("window")
    )
    """Unsure pixels, in the layout of window: Q = P, or 0 if nothing is unsure."""
    classes: Annotated[NDArray[np.uint8], Array("uint8", ("B", "P", "h", "w"))] = Field(
        default_factory=_none_like("window", of_bits=True)
    )
    """Colour classes of actor pixels, numbers from 1 to 7 and 0 for none: bit b of each is in plane b, in the
    layout of window. B = 3, or 0 if no classes are known."""


class LimbResult(OfLimbTask, type="limb_result"):
    """A solved limb task."""

    energy_px: Scalar
    """The cost of the differing pixels in the limb's window, by the search settings, before the hand or foot
    was fitted."""
    evaluations: Count
    """How often the energy was evaluated."""
    seconds: Scalar
    """Time to solve the task, in seconds."""
    backend: Name
    """The energy backend that solved it."""
    values: Annotated[NDArray[np.float64], Array("float64", ("d",))]
    """The limb's parameters, in radians and within the joint limits: ball, hinge, then hand or foot."""


class LimbRefusal(OfLimbTask, type="limb_refusal"):
    """A worker cannot solve a task that it was given."""

    reason: Annotated[str, Field(max_length=LONGEST_REASON)]
    """The reason, for a log."""


class BlobRequest(Message, type="blob_request"):
    """A client asks for content that a message named."""

    hash: Hash
    """SHA-256 of the content."""


class Blob(Message, type="blob"):
    """Content, identified by its SHA-256."""

    hash: Hash
    """SHA-256 of the content's bytes, in lower-case hexadecimal."""
    kind: Literal["actor", "rig", "mesh"]
    """What the content is. An actor with its own mesh names the mesh."""
    content: Annotated[NDArray[np.uint8], Array("uint8", ("n",))]
    """UTF-8 text: actor.toml, or the rig as JSON; for a mesh: the bytes of actor_mesh.npz."""


class Silhouettes(OfRun, type="silhouettes"):
    """Undistorted silhouettes of some cameras in one frame."""

    frame: Count
    """The frame's number in the take."""
    cameras: Annotated[list[Count], Field(min_length=1, max_length=MAX_CAMERAS)]
    """The cameras' positions in calibration.toml, from 0, without repetition."""
    planes: Annotated[NDArray[np.uint8], Array("uint8", ("P", "H", "W"))]
    """Bit k % 8 of plane k // 8 is the silhouette of the k-th camera of the list, from 0."""
    unsure: _Unsure = Field(default_factory=_none_like("planes"))
    """Pixels that may be actor or background, in the layout of planes; they are not counted. Q = P, or 0 if
    there are none. A bit that is set in both means unsure."""
    classes: _Classes = Field(default_factory=_none_like("planes", of_bits=True))
    """Colour classes of actor pixels, numbers from 1 to 7 and 0 for none: bit b of each is in plane b, in the
    layout of planes. B = 3, or 0 if no classes are known."""


class Credit(OfRun, type="credit"):
    """How far segmentation may go: frames from next_frame on, up to but not including end_frame."""

    next_frame: Count
    """The first frame that still lacks a camera; earlier frames are no longer wanted."""
    end_frame: Count
    """One past the last frame that may be sent."""


class TakeInfo(OfRun, type="take_info"):
    """What a recorder needs to write a take's results."""

    fps: Annotated[float, Field(gt=0, lt=10000)]
    """Frames per second of the recording."""
    first_frame: Count
    """The first frame that is tracked."""
    end_frame: Count
    """One past the last frame that is to be tracked; 2147483647 for live input, whose end is open."""
    plan: Hash
    """A hash of everything that poses depend on: take, frames, settings. A run can continue another of the
    same plan."""
    shards: Annotated[int, Field(ge=1, le=MAX_SHARDS)]
    """Into how many parts limbs' grids are divided in this run."""
    actor: Hash
    """Names the blob of kind actor."""
    rig: Hash
    """Names the blob of kind rig."""
    backend: Name
    """The coordinator's own energy backend at the first frame."""
    backend_reason: Annotated[str, Field(max_length=LONGEST_REASON)]
    """Why this backend was chosen."""
    threads: Count
    """Threads of the coordinator's cpu backend; 0 for one per core."""
    search: Settings
    """The search settings by name."""
    coordinator: Annotated[str, Field(pattern=r"^([0-9a-f]{32})?$")] = ""
    """The random name of the coordinator itself, which changes if it restarts."""
    continued_at: Count = 0
    """The first frame that this coordinator solves of a run that another one began; 0 if it began the run."""

    @property
    def is_live(self) -> bool:
        """Whether the poses are of live input."""
        return self.end_frame == OPEN_END


class Pose(OfRun, type="pose"):
    """A solved frame."""

    frame: Count
    """The frame's number in the take."""
    time_s: Scalar
    """The frame's time in the take: frame / fps, in seconds. Live: since the shutter of shot 0."""
    energy_px: Scalar
    """Differing pixels, over all cameras, of the whole body."""
    passes: Count
    """Number of rounds of torso, limbs and head."""
    evaluations: Count
    """How often the energy was evaluated, including by workers."""
    workers: Count
    """Limb workers alive when the frame was solved."""
    retries: Count
    """Limb tasks given out again or solved by the coordinator since the take began."""
    backend: Name
    """The coordinator's own energy backend at this frame."""
    worker_backends: Annotated[dict[Name, Count], Field(max_length=MAX_BACKENDS)]
    """Number of limb results used from workers since the take began, by their energy backend."""
    seconds: Annotated[dict[Name, Scalar], Field(max_length=20)]
    """Wall time in seconds per stage: torso (or the whole body's alignment; of settled recorded frames its
    processor time), head, limbs; a limb's name: solving that limb; frame: since the previous frame was
    published; overhead: the coordinator's processor time for everything except fitting."""
    confidence: Annotated[dict[Part, Share], Field(max_length=6)] = Field(default_factory=dict)
    """The probability that no joint of a part is more than 15 cm off; missing parts were not judged."""
    distrusted: Annotated[list[Part], Field(max_length=6)] = Field(default_factory=list)
    """Unreliable parts in this frame, without repetition; the torso stands for the whole body."""
    measured: Measured = Field(default_factory=dict)
    """What else was measured of the frame, by name (see What is measured of a frame)."""
    memory: Memory = Field(default_factory=dict)
    """The state of the coordinator, besides the last two poses, for a coordinator that continues the run."""
    shot: Count = 0
    """Live: the number of the cameras' shot (some shots are never solved); else the same as frame."""
    latency_s: Scalar = 0.0
    """Live: time from the shutter to this message; else 0."""
    absent: Annotated[list[Count], Field(max_length=MAX_CAMERAS)] = Field(default_factory=list)
    """Live: cameras without a picture of this shot, which were not used, by their position from 0."""
    settled: bool = False
    """Whether the pose is final, found with the frames after it; replaces the frame's earlier pose, and may
    be the same."""
    pose: Annotated[NDArray[np.float64], Array("float64", ("D",))]
    """The body's D parameters, in metres and radians, in the z-up world."""
    steady: Annotated[NDArray[np.float64], Array("float64", ("k", "D"))] = Field(
        default_factory=lambda fields: np.zeros((0, len(fields.get("pose", ()))))
    )
    """Live: k = 1, the pose smoothed by a one-euro filter, for display; else k = 0."""


class PoseRequest(Message, type="pose_request"):
    """Send poses: a recorder has missed some, or a restarted coordinator needs those that a recorder has."""

    run: Run
    """The run whose frames these are."""
    first_frame: Count
    """The first frame that is missing."""
    end_frame: Count
    """One past the last frame that is missing."""
    settled: bool = False
    """Whether the settled poses of these frames are missing, or the first ones."""


class SilhouettesRequest(Message, type="silhouettes_request"):
    """A viewer asks for the input of a frame that was solved just now: all its silhouettes."""

    frame: Count
    """The frame's number in the take."""


class Recording(OfTake, type="recording"):
    """What a recorder has on disk of a take; sent after its hello, even if empty, and as it grows."""

    run: Annotated[str, Field(pattern=r"^([0-9a-f]{32})?$")]
    """The run of these poses; empty if there are none."""
    plan: Annotated[str, Field(pattern=r"^([0-9a-f]{64})?$")]
    """As in take_info; empty if there is no run."""
    shards: Annotated[int, Field(ge=1, le=MAX_SHARDS)]
    """As in take_info; 1 if there is no run."""
    end_frame: Count
    """One past the last frame up to which it has all frames."""
    settled_end: Count = 0
    """One past the last frame up to which it has all settled poses as well."""
    retries: Count
    """As in the last of these poses; 0 if there are none."""
    worker_backends: Annotated[dict[Name, Count], Field(max_length=MAX_BACKENDS)]
    """As in the last of these poses."""
    memory: Memory
    """As in the last of these poses."""
    poses: Annotated[NDArray[np.float64], Array("float64", ("k", "D"))]
    """The last two of these poses, or fewer if there are fewer."""
    actor: Annotated[NDArray[np.uint8], Array("uint8", ("n",))]
    """UTF-8 text: actor.toml of the run; empty if it is not known yet."""


class Telemetry(OfTake, type="telemetry"):
    """The state of a coordinator; published about twice a second, also before a take has begun."""

    run: Annotated[str, Field(pattern=r"^([0-9a-f]{32})?$")]
    """The run; empty while the coordinator waits for clients."""
    stage: CoordinatorStage
    """What the coordinator is doing."""
    first_frame: Count
    """The first frame that is tracked."""
    next_frame: Count
    """One past the last frame that was solved; settling: that was settled; tracking back: the frame that is
    being solved."""
    end_frame: Count
    """As in take_info."""
    frames_ready: Count
    """Frames whose silhouettes are all there and that are not being solved yet."""
    unrecorded: Count
    """Poses that some recorder does not have on disk yet."""
    deadline_s: Scalar
    """How long a limb task may take, in seconds, before it is given to another worker as well."""
    tasks_waiting: Count
    """Limb tasks that no worker has."""
    workers: Annotated[dict[Name, Name], Field(max_length=MAX_TOLD)]
    """Limb workers by name (role@host:process id), with the energy backend that each started with."""
    limbs: Annotated[dict[Name, Limb], Field(max_length=MAX_TOLD)]
    """The limb that each worker with a task is searching."""
    recorders: Annotated[dict[Name, Count], Field(max_length=MAX_TOLD)]
    """Recorders by name; for each, one past the last frame up to which it has all frames on disk."""
    counts: Annotated[dict[Name, Count], Field(max_length=20)]
    """Since the start: retries (tasks given out again), and dropped messages by reason."""
    seconds: Annotated[dict[Name, Scalar], Field(max_length=20)]
    """As in the last pose."""
    latency_s: Annotated[dict[Name, Scalar], Field(max_length=20)] = Field(default_factory=dict)
    """Live: time from the shutter to the pose, over the last poses: median, and p95, the 95th percentile;
    settled_median and settled_p95 of settled poses."""
    drops: Annotated[
        dict[Name, Annotated[list[Count], Field(min_length=3, max_length=3)]], Field(max_length=MAX_CAMERAS)
    ] = Field(default_factory=dict)
    """Live, by camera: shots without a picture from the source, pictures that segmentation skipped, and shots
    that arrived but were not solved because newer ones had come."""
    absent: Annotated[list[Name], Field(max_length=MAX_CAMERAS)] = Field(default_factory=list)
    """Live: cameras without a current picture."""


class TakeEnd(OfRun, type="take_end"):
    """No pose will follow."""

    first_frame: Count
    """The first requested frame."""
    end_frame: Count
    """One past the last frame that was solved; equal to first_frame if there is none."""
    end_shot: Count = 0
    """Live: one past the last shot that belongs to a recording of the cameras; else 0."""
    settled: bool = False
    """Whether all these frames have a settled pose as well."""


class LiveSilhouettes(OfRun, type="live_silhouettes"):
    """Live: undistorted silhouettes of some cameras in one shot."""

    shot: Count
    """The number of the shot, as counted by the live pace."""
    cameras: Annotated[list[Count], Field(min_length=1, max_length=MAX_CAMERAS)]
    """The cameras' positions in calibration.toml, from 0, without repetition. Missing cameras of the sender
    have no picture of this shot."""
    times_s: Annotated[list[Moment], Field(min_length=1, max_length=MAX_CAMERAS)]
    """When each of these cameras took its picture, on the coordinator's clock."""
    planes: Annotated[NDArray[np.uint8], Array("uint8", ("P", "H", "W"))]
    """Bit k % 8 of plane k // 8 is the silhouette of the k-th camera of the list, from 0."""
    unsure: _Unsure = Field(default_factory=_none_like("planes"))
    """Pixels that may be actor or background, in the layout of planes; they are not counted. Q = P, or 0 if
    there are none. A bit that is set in both means unsure."""
    classes: _Classes = Field(default_factory=_none_like("planes", of_bits=True))
    """As in `silhouettes`."""


class LiveSources(OfTake, type="live_sources"):
    """Live: a segmentation reports the state of its cameras and asks for the pace, about twice a second."""

    asked_s: Moment
    """When this was sent, on the sender's clock."""
    cameras: Annotated[list[Count], Field(min_length=1, max_length=MAX_CAMERAS)]
    """Its cameras' positions in calibration.toml, from 0, without repetition."""
    latest_s: Annotated[list[Moment], Field(max_length=MAX_CAMERAS)]
    """When the cameras with their own clock took their latest pictures, on the coordinator's clock; empty
    while that is not known."""
    missed: Annotated[list[Count], Field(max_length=MAX_CAMERAS)]
    """Per camera: shots without a picture from its source."""
    dropped: Annotated[list[Count], Field(max_length=MAX_CAMERAS)]
    """Per camera: pictures that were not segmented because newer ones had come."""
    unsent: Count
    """Shots that were segmented but not sent because the coordinator was not receiving."""
    absent: Annotated[list[Count], Field(max_length=MAX_CAMERAS)]
    """Cameras without a current picture."""
    ended: bool
    """Whether all sources are files that have ended, so that no picture will follow."""


class LivePace(OfTake, type="live_pace"):
    """Live: the coordinator's answer to live_sources: when each shot is due, and its clock."""

    run: Annotated[str, Field(pattern=r"^([0-9a-f]{32})?$")]
    """The run; empty before it begins, when there is no shot yet."""
    asked_s: Moment
    """Copied from the request: the sender's own clock, so that it can measure the round trip."""
    answered_s: Moment
    """When this was answered, on the coordinator's clock, in seconds from an arbitrary origin."""
    clock: Name
    """The name of that clock: a sender with the same clock need not compare."""
    shot: Count
    """The number of a shot."""
    shot_s: Moment
    """When that shot is due, on the coordinator's clock."""
    period_s: Scalar
    """Time from one shot to the next, in seconds."""


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
