"""The motions that the procedural source knows: each joins a lower and an upper body in time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from depth_pose.body import procedural_motion_arms as arms
from depth_pose.body import procedural_motion_legs as legs
from depth_pose.body import procedural_motion_tables as tables
from depth_pose.body.angles import ANGLE_INDEX, ARM, TRUNK
from depth_pose.body.procedural_motion_draw import Draw, assemble, harmonic, keyed, swap_sides, sway, wander
from depth_pose.body.procedural_motion_gait import gait_arms, gait_legs, turning

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Motion:
    """Postures in time before limits, contact and floor.

    Attributes
    ----------
    angles : (T, 47) float64
        Degrees; the pelvis twist is the heading.
    lift : (T,) float64
        Height of the lowest point above the floor, metres.
    """

    angles: Array
    lift: Array


Family = Callable[[Array, Draw], Motion]


def _still(angles: Array) -> Motion:
    return Motion(angles, np.zeros(angles.shape[:-1]))


def _looks(t: Array, draw: Draw, twist: float = 22.0, lean: float = 7.0) -> Array:
    """Head and trunk moving a little on their own, (T, 15)."""
    out = np.zeros(t.shape + (15,))
    look, nod, tilt = draw.normal(0, twist), draw.normal(-2, 9), draw.normal(0, 5)
    turn, side, bow = draw.normal(0, 0.55 * twist), draw.normal(0, lean), draw.normal(0, 0.8 * lean)
    for part, share in ((3, 0.4), (4, 0.6)):
        out[..., 3 * part] = share * (nod + sway(draw, t, 5))
        out[..., 3 * part + 1] = share * tilt
        out[..., 3 * part + 2] = share * (look + sway(draw, t, 12))
    for part, share in ((1, 0.45), (2, 0.55)):
        out[..., 3 * part] = share * (bow + sway(draw, t, 3))
        out[..., 3 * part + 1] = share * (side + sway(draw, t, 3))
        out[..., 3 * part + 2] = share * (turn + sway(draw, t, 6))
    return out


def _join(t: Array, draw: Draw, lower: Array, upper: Array, looks: Array | None = None) -> Array:
    trunk = lower[..., :15] + (_looks(t, draw) if looks is None else looks)
    return assemble(t, trunk, upper, lower[..., 15:])


def _standing(draw: Draw) -> Array:
    return draw.mix([legs.stand, legs.stand_wide, legs.crouch], [6, 2, 0.8], legs.LOWER)


def stand_casual(t: Array, draw: Draw) -> Motion:
    """Stand about, arms low, shifting weight."""
    lower = wander(draw, t, _standing, 1.2, 2.0)
    return _still(_join(t, draw, lower, wander(draw, t, arms.both(arms.low_arm, 0.6), 1.0, 1.6)))


def stand_gesture(t: Array, draw: Draw) -> Motion:
    """Stand and gesture with one arm or both."""
    lower = wander(draw, t, _standing, 1.2, 2.0)
    return _still(_join(t, draw, lower, wander(draw, t, arms.free_arms)))


def reach_around(t: Array, draw: Draw) -> Motion:
    """Reach over the whole workspace, the trunk following."""
    lower = wander(draw, t, _standing, 1.2, 1.0)
    upper = wander(draw, t, arms.both(arms.reach, 0.25), 0.9, 0.3)
    looks = _looks(t, draw, 30, 12)
    # The trunk turns and bends toward where the higher hand goes.
    for arm, sign in zip(ARM, (1.0, -1.0), strict=True):
        c = arm.start - 15
        away = np.clip((upper[..., c + 3] - 40) / 100, 0, 1) * draw.uniform(0, 1)
        looks[..., 4] += sign * 10 * away
        across = np.clip(-upper[..., c + 3] / 40, 0, 1) * draw.uniform(0, 1)
        looks[..., 8] -= sign * 25 * across
    return _still(_join(t, draw, lower, upper, looks))


def raise_arms(t: Array, draw: Draw) -> Motion:
    """Raise one arm or both sideways or forward and lower them again."""
    rate = draw.uniform(0.2, 0.6)
    progress = 0.5 - 0.5 * np.cos(2 * np.pi * (rate * t + draw.uniform(0, 1)))
    plane = draw.uniform(-0.15, 1.1)
    top = draw.uniform(80, 175)
    upper = np.zeros(t.shape + (18,))
    single = draw.chance(0.3)
    for side in (0, 1):
        size = (8 + (top - 8 + draw.normal(0, 6)) * progress) * np.where(single & (side == 1), 0.1, 1.0)
        c = 9 * side
        upper[..., c + 2] = size * np.sin(plane * np.pi / 2)
        upper[..., c + 3] = 6 + size * np.cos(plane * np.pi / 2)
        upper[..., c + 4] = draw.normal(0, 25) + 10
        upper[..., c + 5] = draw.pick(3, 70, 2.5)
    lower = wander(draw, t, _standing, 1.2, 2.0)
    return _still(_join(t, draw, lower, upper))


def wave(t: Array, draw: Draw) -> Motion:
    """Wave with one hand, the other arm free."""
    upper = wander(draw, t, arms.both(arms.low_arm, 0.5), 1.0, 2.0)
    swing = np.sin(2 * np.pi * (draw.uniform(0.6, 2.2) * t + draw.uniform(0, 1)))
    upper[..., 2] = draw.normal(35, 25)
    upper[..., 3] = draw.normal(95, 25) + draw.uniform(0, 15) * swing
    upper[..., 4] = draw.normal(-75, 22) + draw.uniform(5, 32) * swing
    upper[..., 5] = draw.normal(75, 28) + draw.uniform(0, 28) * swing
    upper[..., 6] = draw.normal(-20, 30)
    lower = wander(draw, t, _standing, 1.2, 2.0)
    return _still(_join(t, draw, lower, upper))


def _signal(draw: Draw) -> Array:
    one = [arms.aside_straight, arms.goal_post, arms.forward_straight, arms.overhead, arms.on_hip, arms.hang]
    one += [arms.crossed, arms.at_head]
    return arms.both(lambda d: d.mix(one, [3, 2.5, 2.5, 3, 1, 1.5, 0.8, 0.5], 9), 0.4)(draw)


def signals(t: Array, draw: Draw) -> Motion:
    """Direct traffic or referee: arms aside, up, forward, bent, with beckoning."""
    lower = wander(draw, t, legs.stand, 1.2, 2.0)
    upper = wander(draw, t, _signal, 0.6, 0.9)
    for side in (0, 1):
        beat = np.sin(2 * np.pi * (draw.uniform(0.5, 1.5) * t + draw.uniform(0, 1)))
        upper[..., 9 * side + 5] += draw.pick(0, 35, 3) * (1 + beat)
    return _still(_join(t, draw, lower, upper))


def crossed_arms(t: Array, draw: Draw) -> Motion:
    """Fold the arms, hold hands before or behind the body or behind the head, hands on hips."""
    both = [arms.both(s, 0.75) for s in (arms.on_hip, arms.behind_head, arms.behind_back, arms.before_belly)]
    upper = wander(draw, t, lambda d: d.mix([arms.folded, *both], [1.5, 2, 1, 1, 1.5], 18), 1.2, 2.5)
    return _still(_join(t, draw, wander(draw, t, _standing, 1.2, 2.0), upper))


def hold_things(t: Array, draw: Draw) -> Motion:
    """Hold, lift and carry something with both hands."""
    return _still(_join(t, draw, wander(draw, t, _standing, 1.2, 1.5), wander(draw, t, arms.together, 1.0, 0.6)))


def wash_window(t: Array, draw: Draw) -> Motion:
    """Wipe circles before the body with one hand."""
    angle = 2 * np.pi * (draw.uniform(0.3, 0.9) * t + draw.uniform(0, 1))
    centre = draw.vector((-0.02, 0.10, 0.36), (0.16, 0.26, 0.06))
    size = draw.vector((0.16, 0.16, 0.0), (0.10, 0.12, 0.0))
    circle = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=-1)
    upper = np.zeros(t.shape + (18,))
    upper[..., :9] = arms.arm_to_target(centre + size * circle, np.array([0.6, -0.75, -0.1]))
    upper[..., 9:] = wander(draw, t, arms.low_arm, 1.2, 2.0)
    return _still(_join(t, draw, wander(draw, t, _standing, 1.5, 2.0), upper))


def _gait(t: Array, draw: Draw, run: bool) -> tuple[Array, Array, Array, Array, Array]:
    size = draw.uniform(0.45, 1.35) if not run else draw.uniform(0.5, 1.25)
    rate = (0.55 + 0.4 * size) if not run else draw.uniform(1.15, 1.6)
    phase = rate * t + draw.uniform(0, 1)
    trunk, leg = gait_legs(phase, draw, size, run)
    upper = gait_arms(phase, draw, size, run)
    return phase, size, trunk, leg, upper


def _walk_with(t: Array, draw: Draw, upper: Array | None, turn: float = 35.0) -> Motion:
    _, _, trunk, leg, swing = _gait(t, draw, run=False)
    trunk = trunk + _looks(t, draw, 14, 4)
    trunk[..., 2] += turning(t, draw, 0.6 * turn, turn)
    return _still(assemble(t, trunk, swing if upper is None else upper, leg))


def walk(t: Array, draw: Draw) -> Motion:
    """Walk in a circle, arms swinging."""
    return _walk_with(t, draw, None)


def walk_gesture(t: Array, draw: Draw) -> Motion:
    """Walk while gesturing, carrying, telephoning."""
    _, _, trunk, leg, swing = _gait(t, draw, run=False)
    upper = wander(draw, t, arms.free_arms, 1.0, 1.2)
    busy = draw.chance(0.55)
    # Often one arm is busy and the other swings.
    upper[..., 9:] = np.where(busy[..., None], swing[..., 9:], upper[..., 9:])
    trunk = trunk + _looks(t, draw, 20, 6)
    trunk[..., 2] += turning(t, draw, 15.0, 40.0)
    return _still(assemble(t, trunk, upper, leg))


def run(t: Array, draw: Draw) -> Motion:
    """Run or jog, with the flight between the steps."""
    phase, size, trunk, leg, upper = _gait(t, draw, run=True)
    trunk = trunk + _looks(t, draw, 12, 5)
    trunk[..., 2] += turning(t, draw, 30.0, 70.0)
    flight = np.maximum(harmonic(2 * phase, ((0, 0), (25, 0), (70, 0.5), (86, 1.0)), 4), 0.0)
    return Motion(assemble(t, trunk, upper, leg), 0.06 * size * flight)


def side_step(t: Array, draw: Draw) -> Motion:
    """Shuffle sideways or jump apart and together, arms low or rising (jumping jack)."""
    angle = 2 * np.pi * (draw.uniform(0.6, 1.4) * t + draw.uniform(0, 1))
    width = 0.5 - 0.5 * np.cos(angle)
    zero = np.zeros_like(width)
    half = draw.uniform(0.07, 0.13) + draw.uniform(0.1, 0.32) * width
    drop = draw.uniform(0.03, 0.22) + 0.08 * width
    lean = draw.uniform(0, 25) + zero
    lower = legs.lower_body(
        np.stack([0.5 * lean, zero, zero], axis=-1), legs._STANDING_M - drop,
        np.stack([half, zero, zero], axis=-1), np.stack([-half, zero, zero], axis=-1),
        np.stack([12 + zero, 12 + zero], axis=-1), np.stack([15 * width, 15 * width], axis=-1), 0.5 * lean,
    )  # fmt: skip
    upper = wander(draw, t, arms.both(arms.low_arm, 0.6), 1.0, 0.5)
    jack = draw.chance(0.45)[..., None]
    raised = np.zeros(t.shape + (18,))
    for c in (0, 9):
        raised[..., c + 3] = 12 + draw.uniform(70, 160) * width
        raised[..., c + 4], raised[..., c + 5] = -10.0, draw.uniform(5, 40)
    lift = 0.06 * np.maximum(np.cos(2 * angle) * -1.0, 0.0) * draw.chance(0.5)
    return Motion(_join(t, draw, lower, np.where(jack, raised, upper)), lift)


def _action(
    t: Array, draw: Draw, table: tables.Table, seconds: tuple[float, float], rest_s: float = 0.5
) -> tuple[Array, Array]:
    """Play an action again and again with its own size; returns angles and phase."""
    length = draw.uniform(*seconds)
    period = length + rest_s
    phase = np.clip(((t / period + draw.uniform(0, 1)) % 1.0) * period / length, 0.0, 1.0)
    angles = keyed(phase, table)
    size = np.repeat(draw.uniform(0.65, 1.15)[..., None], angles.shape[-1], axis=-1)
    size[..., ARM[0].start : ARM[1].stop] = draw.uniform(0.7, 1.15)[..., None]
    out = angles * size + 0.6 * _widen(draw)
    # A smaller or larger share of the stance that the table begins with.
    out[..., TRUNK] += 0.5 * _looks(t, draw, 14, 8)
    return out, phase


def _widen(draw: Draw) -> Array:
    out = np.zeros(draw.shape + (47,))
    for name, spread in (
        ("shoulder_flexion", 14), ("shoulder_abduction", 12), ("shoulder_twist", 16), ("elbow_flexion", 16),
        ("hip_flexion", 9), ("hip_abduction", 5), ("hip_twist", 6), ("knee_flexion", 11), ("ankle_dorsiflexion", 6),
    ):  # fmt: skip
        for side in ("left", "right"):
            out[..., ANGLE_INDEX[f"{side}_{name}"]] = draw.normal(0, spread)
    return out


def _either_side(draw: Draw, angles: Array) -> Array:
    return swap_sides(angles, np.broadcast_to(draw.chance(0.5), angles.shape[:-1]))


def kick(t: Array, draw: Draw) -> Motion:
    """Kick a ball with either foot."""
    return _still(_either_side(draw, _action(t, draw, tables.KICK, (1.0, 1.6))[0]))


def throw(t: Array, draw: Draw) -> Motion:
    """Throw over-arm with a step."""
    return _still(_either_side(draw, _action(t, draw, tables.THROW, (1.1, 1.8))[0]))


def racket(t: Array, draw: Draw) -> Motion:
    """Swing a racket or bat across the body."""
    return _still(_either_side(draw, _action(t, draw, tables.RACKET, (1.1, 1.9), 0.3)[0]))


def punch(t: Array, draw: Draw) -> Motion:
    """Box: guard, jab, cross, hook."""
    return _still(_either_side(draw, _action(t, draw, tables.PUNCH, (1.2, 2.2), 0.1)[0]))


def shoot(t: Array, draw: Draw) -> Motion:
    """Shoot at a basket."""
    angles, phase = _action(t, draw, tables.SHOOT, (1.1, 1.7))
    air = np.clip((phase - 0.5) / 0.26, 0, 1)
    return Motion(_either_side(draw, angles), draw.uniform(0.0, 0.3) * 4 * air * (1 - air))


def jump(t: Array, draw: Draw) -> Motion:
    """Jump up from a crouch, arms swinging."""
    angles, phase = _action(t, draw, tables.JUMP, (1.2, 1.7))
    start, end = tables.JUMP_AIR
    air = np.clip((phase - start) / (end - start), 0, 1)
    return Motion(angles, draw.uniform(0.08, 0.45) * 4 * air * (1 - air))


def dribble(t: Array, draw: Draw) -> Motion:
    """Bounce a ball with one hand, standing low or walking."""
    lower = wander(draw, t, lambda d: d.mix([legs.stand_wide, legs.crouch, legs.lunge], [2, 3, 1], legs.LOWER), 0.7, 0.5)
    _, _, trunk, leg, _ = _gait(t, draw, run=False)
    moving = draw.chance(0.5)[..., None]
    lower = np.where(moving, np.concatenate([trunk, leg], axis=-1), lower)
    angle = 2 * np.pi * (draw.uniform(1.2, 2.2) * t + draw.uniform(0, 1))
    push = 0.5 + 0.5 * np.cos(angle)
    upper = np.zeros(t.shape + (18,))
    upper[..., :9] = wander(draw, t, arms.both(arms.low_arm, 0.5), 0.8, 0.6)[..., :9]
    upper[..., 11] = draw.normal(22, 16) + 12 * push
    upper[..., 12] = draw.normal(22, 10)
    upper[..., 13] = draw.normal(-2, 32)
    upper[..., 14] = draw.normal(40, 16) + draw.uniform(20, 45) * push
    upper[..., 15] = 70.0
    upper[..., 16] = 30 - 45 * push
    lower[..., 3] += draw.pick(0, 20, 1.2)
    lower[..., 6] += draw.pick(0, 14, 1.2)
    return _still(_either_side(draw, _join(t, draw, lower, upper)))


def _sport(draw: Draw) -> Array:
    return draw.mix([legs.stand_wide, legs.crouch, legs.lunge, legs.one_leg], [3, 3, 1.5, 1.0], legs.LOWER)


def play(t: Array, draw: Draw) -> Motion:
    """Move as in a game: low wide stances and steps with any arms, hands on a ball."""
    lower = wander(draw, t, _sport, 0.6, 0.3)
    upper = wander(draw, t, arms.free_arms, 0.7, 0.4)
    return _still(_either_side(draw, _join(t, draw, lower, upper, _looks(t, draw, 28, 10))))


def lunges(t: Array, draw: Draw) -> Motion:
    """Step into lunges, arms free."""
    lower = wander(draw, t, lambda d: d.mix([legs.lunge, legs.stand], [3, 1], legs.LOWER), 0.9, 0.5)
    return _still(_either_side(draw, _join(t, draw, lower, wander(draw, t, arms.free_arms))))


def squats(t: Array, draw: Draw) -> Motion:
    """Crouch and squat, arms free or forward."""
    lower = wander(draw, t, lambda d: d.mix([legs.crouch, legs.stand, legs.kneel], [4, 1, 0.4], legs.LOWER), 1.1, 0.4)
    return _still(_join(t, draw, lower, wander(draw, t, arms.free_arms)))


def bends(t: Array, draw: Draw) -> Motion:
    """Bend, bow and pick things up."""
    lower = wander(draw, t, lambda d: d.mix([legs.bend, legs.stand], [4, 1], legs.LOWER), 1.3, 0.5)
    low = [arms.both(arms.low_arm, 0.7), arms.both(arms.forward_straight, 0.7), arms.free_arms, arms.together]
    return _still(_join(t, draw, lower, wander(draw, t, lambda d: d.mix(low, [3, 2, 1, 1], 18))))


def sit_down(t: Array, draw: Draw) -> Motion:
    """Sit, gesture, and stand up again."""
    lower = wander(draw, t, lambda d: d.mix([legs.sit, legs.stand], [3, 1], legs.LOWER), 1.4, 1.2)
    return _still(_join(t, draw, lower, wander(draw, t, arms.free_arms)))


def balance(t: Array, draw: Draw) -> Motion:
    """Stand on one leg, lift a knee, step over things; stand on tiptoe."""
    options = [legs.one_leg, legs.stand, legs.tiptoe]
    lower = wander(draw, t, lambda d: d.mix(options, [4, 1, 0.7], legs.LOWER), 0.9, 0.4)
    return _still(_either_side(draw, _join(t, draw, lower, wander(draw, t, arms.free_arms))))


def turn_on_spot(t: Array, draw: Draw) -> Motion:
    """Turn on the spot with small steps."""
    _, _, trunk, leg, _ = _gait(t, draw, run=False)
    leg = 0.55 * leg
    trunk = 0.7 * trunk + _looks(t, draw, 30, 4)
    trunk[..., 2] += turning(t, draw, 45.0, 110.0)
    return _still(assemble(t, trunk, wander(draw, t, arms.both(arms.low_arm, 0.6), 1.0, 1.0), leg))


@dataclass(frozen=True)
class Entry:
    """A family and its part in a set of poses.

    Attributes
    ----------
    motion : callable
    share : float
        Part of the pool that the poses are chosen from.
    weight : float
        How densely the chosen poses cover it, relative to others.
    """

    motion: Family
    share: float
    weight: float = field(default=1.0)


FAMILIES: dict[str, Entry] = {
    "stand_casual": Entry(stand_casual, 1.5, 1.3),
    "stand_gesture": Entry(stand_gesture, 3.0, 1.1),
    "reach_around": Entry(reach_around, 1.5, 1.0),
    "raise_arms": Entry(raise_arms, 0.8, 1.1),
    "wave": Entry(wave, 0.8, 1.1),
    "signals": Entry(signals, 1.2, 1.1),
    "crossed_arms": Entry(crossed_arms, 0.8, 1.1),
    "hold_things": Entry(hold_things, 1.2, 1.0),
    "wash_window": Entry(wash_window, 0.6, 1.1),
    "walk": Entry(walk, 2.5, 1.6),
    "walk_gesture": Entry(walk_gesture, 2.5, 1.1),
    "run": Entry(run, 2.0, 1.3),
    "side_step": Entry(side_step, 0.8, 1.0),
    "kick": Entry(kick, 1.2, 1.1),
    "throw": Entry(throw, 0.8, 1.0),
    "racket": Entry(racket, 0.7, 0.9),
    "punch": Entry(punch, 0.7, 1.0),
    "shoot": Entry(shoot, 0.8, 1.1),
    "jump": Entry(jump, 1.0, 1.1),
    "dribble": Entry(dribble, 1.2, 1.1),
    "play": Entry(play, 2.0, 0.9),
    "lunges": Entry(lunges, 1.0, 0.8),
    "squats": Entry(squats, 1.0, 0.8),
    "bends": Entry(bends, 0.8, 0.8),
    "sit_down": Entry(sit_down, 0.8, 0.8),
    "balance": Entry(balance, 0.9, 0.8),
    "turn_on_spot": Entry(turn_on_spot, 0.8, 1.2),
}
"""Every motion by name."""
