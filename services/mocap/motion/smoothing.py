"""Smoothing of poses for output: without delay for recorded takes, and causally for live input.

The root's orientation is smoothed as a rotation, everything else parameter by parameter; the joint limits are
kept.
"""

import numpy as np
from scipy.fft import dct
from scipy.interpolate import make_smoothing_spline
from scipy.spatial.transform import Rotation

from services.mocap.body.actor import DEFAULT_HEIGHT_M
from services.mocap.body.kinematics import N_DOF, clip_to_limits, joint_positions
from services.mocap.body.skeleton import DOFS, JOINTS
from services.mocap.motion.root import ROOT_TURN, root_angles, root_rotations, without_flips
from services.mocap.motion.settings import ONE_EURO_HZ, OutputSettings
from services.mocap.types import Floats

_FEWEST = 5
"""Poses that a smoothing spline needs."""
_CUTOFFS_HZ: Floats = np.geomspace(4.0, 12.0, 12).round(1)
"""What rts chooses from. Cross-validation takes errors of neighbouring frames for independent, which those
of a track are not, so it tends to too high cutoffs. On takes of people 14 Hz was no better than 12."""
_OFFSETS_M: Floats = DEFAULT_HEIGHT_M * np.array([joint.offset_heights for joint in JOINTS])
"""(J, 3) of the generic body, whose joints tell the size of a motion."""
_SPEED_CUTOFF_HZ = 10.0
"""By how much the cutoff rises per radian a second; chosen on tracked takes by their joint errors."""
_DERIVATIVE_CUTOFF_HZ = 1.0
_METRES_PER_RADIAN = 0.5
"""Distance that converts a shift of the root to an equivalent rotation, about an arm's length."""
_SPEED_UNIT: Floats = np.array([_METRES_PER_RADIAN if dof.unit == "m" else 1.0 for dof in DOFS])


def smoothed(poses: Floats, fps: float, settings: OutputSettings, times_s: Floats | None = None) -> Floats:
    """Poses (N, D) of consecutive frames smoothed by the settings; N >= 1.

    times_s: (N,) of frames that do not come evenly, which one-euro heeds.
    """
    cutoff_hz = cutoff_of(poses, fps, settings)
    if cutoff_hz is None:
        return poses.copy()
    if settings.smooth == "rts":
        return rts(poses, fps, cutoff_hz)
    one_euro = OneEuro(cutoff_hz)
    moments_s = np.arange(len(poses)) / fps if times_s is None else times_s
    return np.array([one_euro(pose, at_s) for pose, at_s in zip(poses, moments_s.tolist(), strict=True)])


def cutoff_of(poses: Floats, fps: float, settings: OutputSettings) -> float | None:
    """The cutoff frequency in hertz with which `smoothed` smooths poses (N, D); None if it does not.

    If none is given, rts takes the one of least generalised cross-validation (Craven and Wahba 1979; Woltring
    1986 for movements): fast motion keeps its peaks, slow motion loses its noise. With y the spectrum of
    the joints' paths and g the smoother's gain with a cutoff, it is |(1 - g) y|² / (sum of 1 - g)².
    """
    if settings.smooth == "none":
        return None
    if settings.cutoff_hz is not None or settings.smooth == "one-euro":
        return settings.cutoff_hz or ONE_EURO_HZ
    paths_m = joint_positions(poses, _OFFSETS_M).reshape(len(poses), -1)
    # Without the line from end to end, so that the ends do not look like jumps.
    paths_m -= np.linspace(paths_m[0], paths_m[-1], len(poses))
    power = (dct(paths_m, axis=0, norm="ortho") ** 2).sum(axis=1)
    frequencies_hz = fps * np.arange(len(poses)) / (2 * len(poses))
    removed = 1.0 - 1.0 / (1.0 + (frequencies_hz[:, None] / _CUTOFFS_HZ) ** 4)
    errors = power @ removed**2 / np.maximum(removed.sum(axis=0), 1e-9) ** 2
    return float(_CUTOFFS_HZ[int(errors.argmin())])


def rts(poses: Floats, fps: float, cutoff_hz: float) -> Floats:
    """Poses (N, D) without what is faster than cutoff_hz, where half of the amplitude passes; nothing lags.

    This is the Rauch-Tung-Striebel smoother of a body whose velocities follow random walks. It is computed as
    the cubic smoothing spline, which is the same estimate: see Wahba 1978, and Weinert, Byrd and Sidhu 1980.
    Its gain at a frequency f is 1 / (1 + (f / cutoff)^4), that of a second-order Butterworth filter run
    forward and back, but it needs no margin at the ends and leaves no ringing.
    """
    if len(poses) < _FEWEST:
        return poses.copy()
    values = np.column_stack([poses, without_flips(root_rotations(poses).as_quat())])
    times_s = np.arange(len(values)) / fps
    roughness = fps / (2 * np.pi * cutoff_hz) ** 4  # weight of the spline's squared acceleration
    found = make_smoothing_spline(times_s, values, lam=roughness)(times_s)
    result = found[:, :N_DOF]
    turned = Rotation.from_quat(found[:, N_DOF:])
    result[:, ROOT_TURN] = root_angles(turned, near=poses[:, ROOT_TURN])
    return clip_to_limits(result)


class OneEuro:
    """The one-euro filter (Casiez, Roussel, Vogel 2012): filters one pose after the other, for live output.

    It is an exponential average whose cutoff frequency rises with speed: jitter at rest is averaged over a
    long time, and fast motion hardly at all, so that it lags little.
    """

    def __init__(self, rest_cutoff_hz: float = ONE_EURO_HZ) -> None:
        self._rest_hz = rest_cutoff_hz
        self._before: tuple[float, Floats, Floats] | None = None
        """Time, the filtered pose (D,) and its filtered velocity (D,), with the root's turn as a vector."""

    def __call__(self, pose: Floats, at_s: float) -> Floats:
        """The next pose (D,), filtered; raises ValueError unless it is later than the one before."""
        if self._before is None:
            self._before = at_s, pose.copy(), np.zeros(len(pose))
            return pose.copy()
        then_s, last, velocity = self._before
        if at_s <= then_s:
            raise ValueError(f"a pose at {at_s} s after one at {then_s} s")
        step_s = at_s - then_s
        change = pose - last
        turn_last = root_rotations(last[None])
        change[ROOT_TURN] = (turn_last.inv() * root_rotations(pose[None])).as_rotvec()[0]
        velocity = velocity + _weight(_DERIVATIVE_CUTOFF_HZ, step_s) * (change / step_s - velocity)
        speed = np.abs(velocity) / _SPEED_UNIT
        speed[ROOT_TURN] = np.linalg.norm(velocity[ROOT_TURN])
        step = _weight(self._rest_hz + _SPEED_CUTOFF_HZ * speed, step_s) * change
        result = last + step
        turned = turn_last * Rotation.from_rotvec(step[ROOT_TURN][None])
        result[ROOT_TURN] = root_angles(turned, near=pose[ROOT_TURN][None])[0]
        result = clip_to_limits(result)
        self._before = at_s, result, velocity
        return result.copy()


def _weight(cutoff_hz: float | Floats, step_s: float) -> float | Floats:
    """The weight of the new value in an exponential average with that cutoff frequency."""
    return 1.0 / (1.0 + 1.0 / (2.0 * np.pi * cutoff_hz * step_s))
