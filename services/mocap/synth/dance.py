"""The `dance` motion: fast, with the whole body, as in the paper's sequence B.

Kicks, turns on one foot and in steps, leaps, arm circles, limbs that cross the trunk and each other.
"""

from collections.abc import Callable

from services.mocap.body.skeleton import SIDES
from services.mocap.synth.choreography import HANGING, Arm, Choreography, Leg, turn_in_steps

_SECOND = Arm(-8, 12, 14)  # out to the side
_FIRST = Arm(-34, 66, 50)  # rounded before the waist
_FIFTH = Arm(74, 26, 44)  # rounded overhead
_AHEAD = Arm(6, 84, 8)
_HIGH = Arm(78, 22, 10)
_BACK_LOW = Arm(-62, -24, 12)
_CROSSED_HIGH, _CROSSED_LOW = Arm(4, 104, 52), Arm(-66, 84, 74)  # before the chest, one over the other
_ROUND_WAIST, _ROUND_BACK = Arm(-40, 84, 72), Arm(-58, -30, 45)
_CIRCLE = (Arm(-74, 20, 12), Arm(-8, 84, 8), Arm(82, 26, 8), Arm(22, -34, 10))  # down, ahead, up, behind


def _port_de_bras(c: Choreography) -> None:
    """Arms crossing low, up overhead on the toes, out and down."""
    c.put(0.0, drop=0.0, head_pitch=0.0, left_heel=0.0, right_heel=0.0)
    c.put(0.4, _CROSSED_LOW, _CROSSED_HIGH, drop=0.035, head_pitch=12.0)
    c.put(0.85, _FIFTH, _FIFTH, drop=0.0, head_pitch=-16.0, left_heel=34.0, right_heel=34.0)
    c.hold(1.1, "left_heel", "right_heel", "head_pitch")
    c.put(1.25, _SECOND, _SECOND)
    c.put(1.5, left_heel=0.0, right_heel=0.0, drop=0.02, head_pitch=0.0)
    c.put(1.7, HANGING, HANGING)
    c.put(1.8, drop=0.0)
    c.done(1.8)


def _arm_circles(c: Choreography) -> None:
    """Two circles of the leading arm forwards and up, the other arm half a circle behind it."""
    c.put(0.0, root_lean=0.0, drop=0.0, trunk_turn=0.0, head_turn=0.0)
    for i in range(8):
        c.put(0.3 * (i + 1), _CIRCLE[(i + 1) % 4], _CIRCLE[(i + 3) % 4])
        sway = 9.0 if i % 4 in (0, 1) else -9.0
        c.put(0.3 * (i + 1), root_lean=-sway, drop=0.025, trunk_turn=2 * sway, head_turn=-sway)
    c.put(3.0, root_lean=0.0, drop=0.0, trunk_turn=0.0, head_turn=0.0)
    c.done(3.0, arms=HANGING)


def _kick_ahead(c: Choreography) -> None:
    """The leading leg up to the front, the other arm towards it."""
    c.put(0.0, drop=0.0, root_pitch=0.0, right_heel=0.0, trunk_turn=0.0)
    c.put(0.3, _SECOND, _BACK_LOW, drop=0.035, root_pitch=6.0)
    c.step("left", (0.3, 1.3))
    c.free_leg("left", (0.3, 1.3), Leg(96, 4, 8, ankle=-35), soft=0.42)
    c.put(0.78, Arm(10, -14, 10), _AHEAD, drop=0.01, root_pitch=-10.0, right_heel=0.0, trunk_turn=-14.0)
    c.put(1.3, drop=0.025, root_pitch=4.0, trunk_turn=0.0)
    c.put(1.5, HANGING, HANGING)
    c.put(1.6, drop=0.0, root_pitch=0.0)
    c.done(1.6)


def _kick_aside(c: Choreography) -> None:
    """The leading leg up to the side, the trunk leaning away from it, the other arm overhead."""
    c.put(0.0, drop=0.0, root_lean=0.0, head_lean=0.0)
    c.put(0.35, _FIRST, _FIRST, drop=0.05)
    c.step("left", (0.35, 1.45))
    c.free_leg("left", (0.35, 1.45), Leg(28, 62, 12, twist=25, ankle=-35), soft=0.42)
    c.put(0.9, _SECOND, _FIFTH, drop=0.01, root_lean=20.0, head_lean=-8.0)
    c.put(1.5, drop=0.025, root_lean=0.0, head_lean=0.0)
    c.put(1.7, HANGING, HANGING)
    c.put(1.75, drop=0.0)
    c.done(1.75)


def _pirouette(c: Choreography) -> None:
    """A full turn on one foot, the other one at its knee, the arms rounded before the body."""
    c.put(0.0, drop=0.0, left_heel=0.0, trunk_turn=0.0, head_turn=0.0)
    c.put(0.45, _FIRST, _SECOND, drop=0.08, trunk_turn=-22.0, head_turn=18.0, left_heel=0.0)
    c.face(turn=360.0)
    c.step("right", (0.5, 2.0))
    c.step("left", (0.55, 1.85), lift=0.0)
    c.free_leg("right", (0.5, 2.0), Leg(62, 34, 108, twist=-8, ankle=-35), soft=0.25)
    c.put(0.8, _FIRST, _FIRST, drop=0.0, trunk_turn=0.0, left_heel=30.0, head_turn=14.0)
    c.put(1.2, _FIFTH, _FIFTH)
    c.hold(1.6, "left_heel", "head_turn")
    c.put(1.9, _SECOND, _SECOND)
    c.put(2.0, drop=0.05, left_heel=0.0, head_turn=0.0)
    c.put(2.5, drop=0.0)
    c.done(2.5, arms=HANGING)


def _spin_in_steps(c: Choreography) -> None:
    """A full turn in quick small steps, hugging oneself, then flung open."""
    c.put(0.0, drop=0.0, head_turn=0.0)
    c.put(0.35, _CROSSED_HIGH, _CROSSED_LOW)
    c.put(0.3, drop=0.02, head_turn=20.0)
    turn_in_steps(c, 0.3, 2.05, 6, lift=0.03)
    c.hold_arms(1.3)
    c.put(2.0, _HIGH, _SECOND, drop=0.02, head_turn=0.0)
    c.put(2.6, drop=0.0)
    c.done(2.6, arms=HANGING)


def _cross_steps(c: Choreography) -> None:
    """To the side with a step that crosses before the other leg, arms swinging across the trunk, and back."""
    c.put(0.0, drop=0.0, root_lean=0.0, trunk_turn=0.0)
    c.put(0.35, _SECOND, _ROUND_WAIST)
    c.step("left", (0.1, 0.42), out=0.13)
    c.put(0.4, drop=0.03, root_lean=5.0, trunk_turn=10.0)
    c.step("right", (0.45, 0.85), ahead=0.14, out=-0.31)
    c.put(0.85, _ROUND_WAIST, _SECOND, drop=0.04, root_lean=-6.0, trunk_turn=-12.0)
    c.step("right", (1.05, 1.45))
    c.put(1.4, _SECOND, _ROUND_WAIST, drop=0.03, root_lean=5.0, trunk_turn=8.0)
    c.step("left", (1.5, 1.85))
    c.put(2.0, drop=0.0, root_lean=0.0, trunk_turn=0.0)
    c.done(2.0, arms=HANGING)


def _leap(c: Choreography) -> None:
    """A jump with both arms thrown up."""
    c.put(0.0, drop=0.0, root_pitch=0.0, shift_ahead=0.0, hop=0.0, left_heel=0.0, right_heel=0.0)
    c.put(0.4, _BACK_LOW, _BACK_LOW)
    c.put(0.42, drop=0.15, root_pitch=20.0, shift_ahead=-0.03)
    c.put(0.6, hop=0.0, left_heel=0.0, right_heel=0.0)
    c.put(0.74, drop=0.0, root_pitch=0.0, shift_ahead=0.0, hop=0.0, left_heel=30.0, right_heel=30.0)
    c.put(0.90, hop=0.075)
    c.put(0.88, _HIGH, _HIGH)
    c.put(1.06, hop=0.0, drop=0.0, left_heel=24.0, right_heel=24.0)
    c.put(1.26, drop=0.1, root_pitch=12.0, left_heel=0.0, right_heel=0.0)
    c.put(1.3, _SECOND, _SECOND)
    c.put(1.7, HANGING, HANGING)
    c.put(1.75, drop=0.0, root_pitch=0.0)
    c.done(1.75)


def _arabesque(c: Choreography) -> None:
    """The trunk forward, the leading leg back, arms ahead and aside."""
    c.put(0.0, drop=0.0, root_pitch=0.0, head_pitch=0.0, shift_ahead=0.0)
    c.step("left", (0.15, 1.75), lift=0.09)
    c.free_leg(
        "left",
        (0.15, 1.75),
        Leg(42, 8, 84, ankle=2),
        Leg(-34, 6, 8, ankle=-40),
        Leg(-34, 6, 8, ankle=-40),
        Leg(42, 8, 84, ankle=2),
        soft=0.2,
    )
    c.put(0.9, _SECOND, _AHEAD, drop=0.01, root_pitch=42.0, head_pitch=-30.0)
    c.hold(1.1, "root_pitch", "head_pitch")
    c.put(1.15, _SECOND, Arm(24, 80, 6))
    c.put(1.8, drop=0.02, root_pitch=0.0, head_pitch=0.0)
    c.put(1.9, HANGING, HANGING)
    c.put(2.0, drop=0.0)
    c.done(2.0)


def _lunge(c: Choreography) -> None:
    """A deep step to the leading side, both arms swept down before the knees and up again."""
    c.put(0.0, drop=0.0, root_lean=0.0, root_pitch=0.0, shift_left=0.0, trunk_turn=0.0)
    c.put(0.3, Arm(40, 30, 12), Arm(-20, 92, 40))
    c.step("left", (0.15, 0.55), out=0.2, turn=20.0)
    c.put(0.62, Arm(-52, 66, 14), Arm(-52, 72, 16))
    c.put(0.62, drop=0.08, root_lean=-12.0, root_pitch=20.0, shift_left=0.045, trunk_turn=4.0)
    c.put(1.0, Arm(-30, 96, 30), Arm(-4, 4, 10))
    c.put(1.0, drop=0.035, root_lean=10.0, root_pitch=4.0, shift_left=-0.01, trunk_turn=-16.0)
    c.step("left", (1.2, 1.6))
    c.put(1.45, _SECOND, _HIGH)
    c.put(1.6, drop=0.01, root_lean=0.0, root_pitch=0.0, shift_left=0.0, trunk_turn=0.0)
    c.put(1.95, drop=0.0)
    c.done(1.95, arms=HANGING)


def _wring(c: Choreography) -> None:
    """The trunk thrown from side to side, one arm round the front, the other round the back."""
    c.put(0.0, trunk_turn=0.0, head_turn=0.0, drop=0.0)
    for i, turn in enumerate((34.0, -34.0, 34.0)):
        front, back = (_ROUND_BACK, _ROUND_WAIST) if turn > 0 else (_ROUND_WAIST, _ROUND_BACK)
        c.put(0.3 + 0.63 * i, _SECOND, _SECOND)
        c.put(0.6 + 0.63 * i, front, back, trunk_turn=turn, head_turn=0.5 * turn, drop=0.03)
    c.put(2.45, trunk_turn=0.0, head_turn=0.0, drop=0.0)
    c.done(2.45, arms=HANGING)


def _knee_to_elbow(c: Choreography) -> None:
    """Each knee up across, met by the other side's elbow."""
    c.put(0.0, root_pitch=0.0, trunk_turn=0.0, drop=0.0)
    fists = Arm(-8, 62, 98, twist=40)
    for i, side in enumerate(SIDES):
        start, sign = 0.1 + 0.85 * i, 1.0 if side == "left" else -1.0
        moving: tuple[float, float] = (start, start + 0.8)
        c.step(side, moving)
        c.free_leg(side, moving, Leg(88, -2, 100, ankle=-20), soft=0.42)
        met, other = Arm(-34, 84, 112, twist=38), Arm(-14, 18, 70, twist=20)
        c.put(start + 0.4, *((other, met) if side == "left" else (met, other)))
        c.put(start + 0.4, root_pitch=14.0, trunk_turn=16.0 * sign, drop=0.01)
        c.put(start + 0.8, fists, fists, root_pitch=2.0, trunk_turn=0.0, drop=0.02)
    c.put(2.2, root_pitch=0.0, drop=0.0)
    c.done(2.2, arms=HANGING)


DANCE: tuple[Callable[[Choreography], None], ...] = (
    _port_de_bras,
    _kick_ahead,
    _arm_circles,
    _cross_steps,
    _pirouette,
    _kick_aside,
    _wring,
    _leap,
    _arabesque,
    _spin_in_steps,
    _lunge,
    _knee_to_elbow,
)
