"""Rounds of choreographed movements: all of a repertoire once, in a new order, tempo and side each time."""

from collections.abc import Callable, Sequence

import numpy as np

from services.mocap.body.actor import Body
from services.mocap.synth.basic import BASIC
from services.mocap.synth.choreography import HANGING, Choreography
from services.mocap.synth.dance import DANCE
from services.mocap.synth.motion import STAND_S
from services.mocap.synth.staging import perform
from services.mocap.types import Floats

ROUND_S = 400 / 15
"""The paper's sequences are about 400 frames at 15 frames a second: so long is one round, in seconds."""
_FIRST_MOVEMENT_S = STAND_S + 0.5

Movement = Callable[[Choreography], None]


def basic(n_frames: int, fps: float, body: Body, seed: int = 0) -> Floats:
    """Poses (n_frames, D) of slow single movements; see _rounds."""
    return _rounds(BASIC, n_frames, fps, body, seed, in_order=True)


def dance(n_frames: int, fps: float, body: Body, seed: int = 0) -> Floats:
    """Poses (n_frames, D) of a fast dance with the whole body; see _rounds."""
    return _rounds(DANCE, n_frames, fps, body, seed, in_order=False)


def _rounds(
    repertoire: Sequence[Movement], n_frames: int, fps: float, body: Body, seed: int, *, in_order: bool
) -> Floats:
    """It stands in the A pose for STAND_S, then does the whole repertoire in 26.7 s in all, then again.

    A shorter take shows the beginning. The seed gives the sides, the tempo of each movement and, unless they
    stay in order, the order.
    """
    rng = np.random.default_rng((seed, 5))
    choreography = Choreography(body)
    choreography.put(STAND_S, **dict.fromkeys(("drop", "head_pitch"), 0.0))
    choreography.hold_arms(STAND_S)
    choreography.arms(_FIRST_MOVEMENT_S, HANGING, HANGING)
    choreography.done(_FIRST_MOVEMENT_S)
    begin_s, round_s = _FIRST_MOVEMENT_S, ROUND_S - _FIRST_MOVEMENT_S
    while begin_s < n_frames / fps:
        order = [int(i) for i in (range(len(repertoire)) if in_order else rng.permutation(len(repertoire)))]
        mirrored = rng.random(len(repertoire)) < 0.5
        tempos = rng.uniform(0.94, 1.06, len(repertoire))
        for tempo, i, mirror in zip(
            _fitted(repertoire, order, tempos, round_s, body), order, mirrored, strict=True
        ):
            choreography.tempo, choreography.mirrored = float(tempo), bool(mirror)
            repertoire[i](choreography)
        begin_s = choreography.now_s
    return perform(choreography, n_frames, fps, body)


def _fitted(
    repertoire: Sequence[Movement], order: Sequence[int], tempos: Floats, round_s: float, body: Body
) -> Floats:
    """The tempos (M,) scaled so that the movements in that order take a round's time."""
    beats = []
    for i in order:
        alone = Choreography(body)
        repertoire[i](alone)
        beats.append(alone.now_s)
    fitted: Floats = tempos * round_s / float(np.dot(tempos, beats))
    return fitted
