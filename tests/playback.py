"""A coordinator that only plays back, as tests want it: it remembers requests, forgets, and waits."""

from bench.playback import RUN as RUN
from bench.playback import Playback as Player
from proto.messages import Message, Pose, PoseRequest, Silhouettes, SilhouettesRequest
from services.mocap.body.actor import build_body
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import trimap_of
from services.mocap.export.model_painter import ModelPainter
from services.mocap.take.actor_file import take_actor
from services.mocap.take.folder import Take
from services.segmentation.silhouettes import packed


class Playback(Player):
    """See its base; silhouettes are there, too."""

    def __init__(
        self, take: Take, endpoint: str, *, frames: int = 10_000, period_s: float = 0.1, waits: bool = False
    ) -> None:
        """waits: no frame is sent before somebody has asked for something."""
        super().__init__(take, endpoint, frames=frames, period_s=period_s)
        actor = take_actor(take)
        assert actor is not None
        self._waits, self._rig = waits, Rig.of(take.cameras)
        self._painter = ModelPainter(build_body(actor), self._rig)
        self.asked: list[Message] = []
        """What viewers asked for."""
        self.distrusted: list[str] = []
        self.forgotten_end = 0
        """It has no frames before this one any more."""

    def pose(self, frame: int) -> Pose:
        """A frame's message."""
        return super().pose(frame).model_copy(update={"distrusted": self.distrusted})

    def _goes_on(self) -> bool:
        return bool(self.asked) or not self._waits

    def _answers(self, message: Message) -> list[Message]:
        self.asked.append(message)
        if isinstance(message, SilhouettesRequest):
            return [self.silhouettes(message.frame)]
        if isinstance(message, PoseRequest):
            first = max(message.first_frame, self.forgotten_end)
            message = message.model_copy(update={"first_frame": first})
        return super()._answers(message)

    def silhouettes(self, frame: int) -> Silhouettes:
        """What the cameras would see if the model were right, but for a missing band."""
        masks = [mask > 0 for mask in self._painter.segment_masks(self._poses[frame % len(self._poses)])]
        for mask in masks:
            mask[: mask.shape[0] // 3] = False
        height, width = self._rig.shape_px
        cameras = list(range(len(masks)))
        planes = packed([trimap_of(mask) for mask in masks], width, height).silhouettes
        return Silhouettes(take=self._info.take, run=RUN, frame=frame, cameras=cameras, planes=planes)
