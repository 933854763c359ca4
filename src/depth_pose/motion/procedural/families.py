"""Families of procedural motion by name, and their shares in a set of poses."""

from __future__ import annotations

from dataclasses import dataclass, field

from depth_pose.motion.procedural import games as games
from depth_pose.motion.procedural import moving as moving
from depth_pose.motion.procedural import standing as standing
from depth_pose.motion.procedural.parts import Family


@dataclass(frozen=True)
class Entry:
    """A family and its share in a set of poses.

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
    "stand_casual": Entry(standing.stand_casual, 1.5, 1.3),
    "stand_gesture": Entry(standing.stand_gesture, 3.0, 1.1),
    "reach_around": Entry(standing.reach_around, 1.5, 1.0),
    "raise_arms": Entry(standing.raise_arms, 0.8, 1.1),
    "wave": Entry(standing.wave, 0.8, 1.1),
    "signals": Entry(standing.signals, 1.2, 1.1),
    "crossed_arms": Entry(standing.crossed_arms, 0.8, 1.1),
    "hold_things": Entry(standing.hold_things, 1.2, 1.0),
    "wash_window": Entry(standing.wash_window, 0.6, 1.1),
    "walk": Entry(moving.walk, 2.5, 1.6),
    "walk_gesture": Entry(moving.walk_gesture, 2.5, 1.1),
    "run": Entry(moving.run, 2.0, 1.3),
    "side_step": Entry(moving.side_step, 0.8, 1.0),
    "kick": Entry(games.kick, 1.2, 1.1),
    "throw": Entry(games.throw, 0.8, 1.0),
    "racket": Entry(games.racket, 0.7, 0.9),
    "punch": Entry(games.punch, 0.7, 1.0),
    "shoot": Entry(games.shoot, 0.8, 1.1),
    "jump": Entry(games.jump, 1.0, 1.1),
    "dribble": Entry(games.dribble, 1.2, 1.1),
    "play": Entry(games.play, 2.0, 0.9),
    "lunges": Entry(moving.lunges, 1.0, 0.8),
    "squats": Entry(moving.squats, 1.0, 0.8),
    "bends": Entry(moving.bends, 0.8, 0.8),
    "sit_down": Entry(moving.sit_down, 0.8, 0.8),
    "balance": Entry(moving.balance, 0.9, 0.8),
    "turn_on_spot": Entry(moving.turn_on_spot, 0.8, 1.2),
}
"""Every motion by name; shares and weights chosen with ``benchmarks/banks.py coverage`` in view."""
