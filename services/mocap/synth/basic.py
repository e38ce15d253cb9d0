"""The `basic` motion: slow single movements one after the other, as in the paper's sequence A.

Arms raised to the front and to the side, elbows bent, a squat, bends and turns of the trunk and the head,
knees lifted, steps to all sides, one full slow turn of the body.
"""

from collections.abc import Callable

from services.mocap.synth.choreography import HANGING, Arm, Choreography, Leg, turn_in_steps

_FRONT = Arm(0, 86, 4)
_FRONT_LOW = Arm(-60, 60, 8)
_SIDE = Arm(0, 0, 4)
_UP = Arm(76, 10, 6)
_CURLED = Arm(-74, 8, 125, twist=4)


def _raise_to_front(c: Choreography) -> None:
    for beat, arm in ((0.0, HANGING), (0.6, _FRONT_LOW), (1.2, _FRONT), (1.4, _FRONT), (2.0, _FRONT_LOW)):
        c.put(beat, arm, arm)
    c.done(2.6, arms=HANGING)


def _raise_to_side(c: Choreography) -> None:
    for beat, arm in ((0.0, HANGING), (0.8, _SIDE), (1.5, _UP), (1.7, _UP), (2.4, _SIDE)):
        c.put(beat, arm, arm)
    c.done(3.2, arms=HANGING)


def _bend_elbows(c: Choreography) -> None:
    c.put(0.0, HANGING, HANGING)
    c.put(0.8, _CURLED, HANGING)
    c.put(1.5, HANGING, _CURLED)
    c.done(2.2, arms=HANGING)


def _squat(c: Choreography) -> None:
    c.put(0.0, HANGING, HANGING, drop=0.0, root_pitch=0.0, shift_ahead=0.0, head_pitch=0.0)
    c.put(0.6, _FRONT_LOW, _FRONT_LOW)
    c.put(1.1, _FRONT, _FRONT)
    c.put(1.2, drop=0.3, root_pitch=36.0, shift_ahead=-0.085, head_pitch=-18.0)
    c.hold(1.4, "drop", "root_pitch", "shift_ahead", "head_pitch")
    c.hold_arms(1.5)
    c.put(2.0, _FRONT_LOW, _FRONT_LOW)
    c.put(2.6, drop=0.0, root_pitch=0.0, shift_ahead=0.0, head_pitch=0.0)
    c.done(2.6, arms=HANGING)


def _bend_forward(c: Choreography) -> None:
    c.put(0.0, HANGING, HANGING, root_pitch=0.0, shift_ahead=0.0, drop=0.0, head_pitch=0.0)
    c.put(1.1, Arm(-62, 66, 10), Arm(-62, 66, 10))
    c.put(1.2, root_pitch=62.0, shift_ahead=-0.07, drop=0.01, head_pitch=12.0)
    c.hold(1.4, "root_pitch", "shift_ahead", "drop", "head_pitch")
    c.put(2.5, root_pitch=0.0, shift_ahead=0.0, drop=0.0, head_pitch=0.0)
    c.done(2.5, arms=HANGING)


def _bend_sideways(c: Choreography) -> None:
    """To the leading side with the other arm overhead, then the other way round."""
    c.put(0.0, HANGING, HANGING, root_lean=0.0, shift_left=0.0)
    c.put(0.5, HANGING, Arm(-10, 2, 6))
    c.put(1.1, Arm(-70, 12, 20), Arm(62, 8, 25), root_lean=-20.0, shift_left=0.03)
    c.put(1.8, Arm(-25, 4, 12), Arm(-5, 2, 8), root_lean=0.0, shift_left=0.0)
    c.put(2.5, Arm(62, 8, 25), Arm(-70, 12, 20), root_lean=20.0, shift_left=-0.03)
    c.put(3.1, Arm(-10, 2, 6), HANGING)
    c.put(3.5, root_lean=0.0, shift_left=0.0)
    c.done(3.6, arms=HANGING)


def _turn_trunk(c: Choreography) -> None:
    c.put(0.0, HANGING, HANGING, trunk_turn=0.0, head_turn=0.0)
    c.put(0.6, _SIDE, _SIDE)
    c.put(0.9, trunk_turn=32.0, head_turn=15.0)
    c.put(1.9, trunk_turn=-32.0, head_turn=-15.0)
    c.hold_arms(2.1)
    c.put(2.7, trunk_turn=0.0, head_turn=0.0)
    c.done(2.7, arms=HANGING)


def _turn_head(c: Choreography) -> None:
    c.put(0.0, head_turn=0.0, head_pitch=0.0, head_lean=0.0)
    c.put(0.5, head_turn=50.0)
    c.put(1.2, head_turn=-50.0)
    c.put(1.6, head_turn=0.0, head_pitch=0.0)
    c.put(1.9, head_pitch=30.0)
    c.put(2.3, head_pitch=-22.0, head_lean=0.0)
    c.put(2.6, head_pitch=0.0, head_lean=20.0)
    c.put(2.9, head_lean=0.0)
    c.done(2.9)


def _lift_knees(c: Choreography) -> None:
    c.put(0.0, HANGING, HANGING)
    c.put(0.5, Arm(-50, 20, 15), Arm(-50, 20, 15))
    c.step("left", (0.1, 1.3))
    c.free_leg("left", (0.1, 1.3), Leg(80, 6, 90, ankle=-10))
    c.step("right", (1.5, 2.7))
    c.free_leg("right", (1.5, 2.7), Leg(80, 6, 90, ankle=-10))
    c.hold_arms(2.2)
    c.done(2.8, arms=HANGING)


def _step_around(c: Choreography) -> None:
    """A step ahead and back, a step to the side and back."""
    c.put(0.0, HANGING, HANGING)
    c.step("left", (0.1, 0.6), ahead=0.2)
    c.put(0.0, drop=0.0)
    c.put(0.7, Arm(-74, -14, 16), Arm(-70, 30, 24), drop=0.01)
    c.step("left", (0.9, 1.4))
    c.put(1.5, HANGING, HANGING)
    c.step("right", (1.6, 2.1), out=0.16)
    c.put(2.2, Arm(-50, 10, 20), Arm(-50, 10, 20), drop=0.01)
    c.step("right", (2.4, 2.9))
    c.put(3.0, drop=0.0)
    c.done(3.0, arms=HANGING)


def _turn_around(c: Choreography) -> None:
    """One full turn on the spot in small steps."""
    c.put(0.0, HANGING, HANGING, head_turn=0.0)
    c.put(0.6, head_turn=14.0)
    c.put(0.8, Arm(-50, 8, 20), Arm(-50, 8, 20))
    turn_in_steps(c, 0.1, 4.5, 8, lift=0.025)
    c.hold_arms(3.8)
    c.hold(3.8, "head_turn")
    c.put(4.6, head_turn=0.0)
    c.done(4.6, arms=HANGING)


BASIC: tuple[Callable[[Choreography], None], ...] = (
    _raise_to_front,
    _raise_to_side,
    _bend_elbows,
    _squat,
    _turn_head,
    _bend_forward,
    _bend_sideways,
    _turn_trunk,
    _lift_knees,
    _step_around,
    _turn_around,
)
