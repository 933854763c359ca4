"""Two dances; every performance is different.

A dance is a table of key postures, one to a beat, that ends as it begins. A *performance* of it
has its own tempo, timing that wanders against the beat, range of each limb, habitual posture, and
a slow irregular deviation of every joint. The dances are not part of the exemplar bank.

Values are set by hand; ranges are drawn from at random.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from depth_pose.body.angles import ANGLE_INDEX, ANGLES, N_ANGLES
from depth_pose.core.errors import ConfigError
from depth_pose.motion.clip import Clip
from depth_pose.motion.procedural.draw import keyed
from depth_pose.motion.procedural.generator import clip_from_motion
from depth_pose.motion.procedural.parts import still

Array = NDArray[np.float64]
Key = dict[str, float]


def _legs(left: tuple[float, float, float], right: tuple[float, float, float], toe_out: float = 12.0) -> Key:
    """Hip flexion, hip abduction and knee flexion of both legs; the feet stay flat."""
    key: Key = {}
    for side, (hip, aside, knee) in (("left", left), ("right", right)):
        key[f"{side}_hip_flexion"], key[f"{side}_hip_abduction"] = hip, aside
        key[f"{side}_knee_flexion"], key[f"{side}_ankle_toe_out"] = knee, toe_out
        key[f"{side}_ankle_dorsiflexion"] = float(np.clip(knee - hip, -25.0, 20.0))
    return key


def _arms(left: tuple[float, ...], right: tuple[float, ...]) -> Key:
    """Shoulder flexion, abduction, twist and elbow flexion of both arms."""
    names = ("shoulder_flexion", "shoulder_abduction", "shoulder_twist", "elbow_flexion")
    key: Key = {}
    for side, values in (("left", left), ("right", right)):
        key |= {f"{side}_{name}": value for name, value in zip(names, values, strict=True)}
        key[f"{side}_forearm_pronation"] = 40.0
    return key


def _trunk(bow: float, side: float, twist: float, heading: float) -> Key:
    """Forward bend, side bend and twist shared by the trunk's joints, and the heading."""
    return {
        "pelvis_twist": heading, "pelvis_flexion": 0.25 * bow, "pelvis_side": 0.2 * side,
        "spine_flexion": 0.4 * bow, "spine_side": 0.4 * side, "spine_twist": 0.4 * twist,
        "chest_flexion": 0.35 * bow, "chest_side": 0.4 * side, "chest_twist": 0.6 * twist,
        "neck_flexion": -0.15 * bow, "neck_side": -0.3 * side, "neck_twist": -0.25 * twist,
        "head_flexion": -0.15 * bow, "head_side": -0.2 * side, "head_twist": -0.25 * twist,
    }  # fmt: skip


_STAND = ((4.0, 6.0, 8.0), (4.0, 6.0, 8.0))
"""Leg angles of a standing person (degrees), as arguments of `_legs`."""

# lively: steps aside, swings of both arms, arms overhead, a knee raised
_SWING: tuple[Key, ...] = (
    _trunk(3, 0, 0, 0) | _arms((-4, 11, 0, 17), (-4, 11, 0, 17)) | _legs(*_STAND),
    _trunk(6, 18, 14, 20) | _arms((16, 108, -26, 10), (42, 18, 39, 94)) | _legs((12, 34, 26), (7, 5, 17)),
    _trunk(3, -6, 0, 0) | _arms((68, 63, 13, 66), (68, 63, 13, 66)) | _legs(*_STAND),
    _trunk(6, -18, -14, -20) | _arms((42, 18, 39, 94), (16, 108, -26, 10)) | _legs((7, 5, 17), (12, 34, 26)),
    _trunk(0, 0, 0, 0) | _arms((132, 63, 13, 24), (132, 63, 13, 24)) | _legs((2, 10, 5), (2, 10, 5)),
    _trunk(8, 12, 21, 30) | _arms((28, 141, -39, 31), (2, 30, 26, 115)) | _legs((90, 14, 102), (2, 5, 7)),
    _trunk(20, 0, 0, 50) | _arms((54, 4, 26, 80), (54, 4, 26, 80)) | _legs((54, 17, 72), (54, 17, 72)),
    _trunk(8, -12, -21, 30) | _arms((2, 30, 26, 115), (28, 141, -39, 31)) | _legs((2, 5, 7), (90, 14, 102)),
    _trunk(3, 0, -28, 0) | _arms((100, -8, 39, 10), (-43, 37, 13, 24)) | _legs((36, 7, 24), (-17, 10, 19)),
    _trunk(3, 0, 28, -25) | _arms((-43, 37, 13, 24), (100, -8, 39, 10)) | _legs((-17, 10, 19), (36, 7, 24)),
    _trunk(0, 15, 0, -50) | _arms((80, 134, 0, 10), (9, 63, 0, 5)) | _legs((7, 26, 12), (5, 14, 22)),
    _trunk(0, -15, 0, -25) | _arms((9, 63, 0, 5), (80, 134, 0, 10)) | _legs((5, 14, 22), (7, 26, 12)),
)  # fmt: skip

# slow and turning: arms sweep as sleeves do, deep knees, a full turn
_SWEEP: tuple[Key, ...] = (
    _trunk(6, 0, 0, 0) | _arms((35, 18, 39, 66), (35, 18, 39, 66)) | _legs((12, 6, 24), (12, 6, 24)),
    _trunk(11, 9, 25, 25) | _arms((80, 24, 26, 31), (16, 63, 13, 52)) | _legs((38, 10, 43), (2, 10, 26)),
    _trunk(6, -12, -11, 60) | _arms((42, 102, -13, 5), (68, 11, 52, 108)) | _legs((17, 22, 19), (14, 7, 36)),
    _trunk(22, 0, 0, 100) | _arms((48, 37, 13, 17), (48, 37, 13, 17)) | _legs((62, 14, 86), (48, 12, 79)),
    _trunk(3, 15, 17, 140) | _arms((126, 76, 0, 38), (-4, 44, 0, 17)) | _legs((10, 10, 12), (36, 19, 58)),
    _trunk(3, -15, -17, 180) | _arms((-4, 44, 0, 17), (126, 76, 0, 38)) | _legs((36, 19, 58), (10, 10, 12)),
    _trunk(14, 0, 34, 215) | _arms((106, -15, 39, 5), (68, 82, -13, 24)) | _legs((48, 7, 48), (-14, 12, 22)),
    _trunk(6, 9, -22, 260) | _arms((9, 89, 0, 80), (94, -2, 39, 38)) | _legs((7, 17, 24), (26, 12, 41)),
    _trunk(25, 0, 0, 300) | _arms((80, 44, 13, 122), (80, 44, 13, 122)) | _legs((53, 12, 67), (53, 12, 67)),
    _trunk(0, -9, 14, 330) | _arms((68, 115, -13, 17), (16, 24, 26, 38)) | _legs((7, 24, 14), (7, 5, 19)),
)  # fmt: skip


@dataclass(frozen=True)
class Dance:
    """A dance: key postures, and how long it takes from one to the next."""

    keys: tuple[Key, ...]
    beat_s: float
    turn_deg: float

    @property
    def seconds(self) -> float:
        """Duration of one pass of the dance (s)."""
        return self.beat_s * len(self.keys)

    def posture(self, beats: Array) -> Array:
        """Angles (T, 47) in degrees at moments counted in beats; the dance repeats."""
        n = len(self.keys)
        table: list[tuple[float, Key]] = []
        for i in range(-2, n + 3):  # two more on either side, so that the seam is as smooth as the rest
            key = dict(self.keys[i % n])
            key["pelvis_twist"] += self.turn_deg * (i // n)
            table.append((float(i), key))
        turns = np.floor(beats / n)
        angles = keyed(beats - n * turns, table)
        angles[..., ANGLE_INDEX["pelvis_twist"]] += self.turn_deg * turns
        return angles


DANCES: dict[str, Dance] = {
    "swing": Dance(_SWING, 0.95, 0.0),
    "sweep": Dance(_SWEEP, 1.15, 360.0),
}
"""The dances by name."""

_SPREAD_DEG: dict[str, tuple[float, float]] = {
    "pelvis": (1.0, 1.5),
    "spine": (1.0, 1.5),
    "chest": (1.0, 1.5),
    "shoulder": (3.0, 4.0),
    "elbow": (3.0, 4.0),
    "hip": (2.0, 3.0),
    "knee": (2.0, 4.0),
    "ankle": (2.0, 2.0),
}
"""Standard deviations of habit and of irregular deviation by joint, degrees; others do not vary.

docs/volume.md measures the tracker on them.
"""

_WANDER_S = 0.45
"""Correlation time of a joint's irregular deviation, seconds."""

_TIMING_BEATS = (0.12, 1.2)
"""Deviation of the timing from the beat: standard deviation in beats, correlation time in seconds."""

_TEMPO = (0.93, 1.07)
"""Slowest and fastest tempo of a performance relative to the dance's."""

_RANGE = 0.06
"""Standard deviation of the factor on each joint's range of movement."""


def perform(dance: str, seed: int, seconds: float, fps: float = 30.0, start_beat: float = 0.0) -> Clip:
    """Generate a performance of a dance.

    Parameters
    ----------
    dance : str
        A name of `DANCES`.
    seed : int
        Equal seeds give equal performances.
    seconds : float
        How long; the dance is repeated where it is shorter.
    fps : float
        Frames a second.
    start_beat : float
        Where in the dance it starts.

    Returns
    -------
    Clip
        Within joint limits, limbs outside the body, feet on the floor.
    """
    if dance not in DANCES:
        raise ConfigError(f"there is no dance {dance!r}; there are {', '.join(DANCES)}")
    found, rng = DANCES[dance], np.random.default_rng([seed, sorted(DANCES).index(dance)])
    t = np.arange(max(round(fps * seconds), 2)) / fps
    rate = rng.uniform(*_TEMPO)
    beats = (
        start_beat + rate * t / found.beat_s + _TIMING_BEATS[0] * _wander(rng, t, _TIMING_BEATS[1], 1)[:, 0]
    )
    angles = found.posture(np.maximum.accumulate(beats))
    habit, amount = _spreads()
    rest = angles.mean(axis=0)
    rest[ANGLE_INDEX["pelvis_twist"]] = 0.0
    gain = np.where(habit > 0, rng.normal(1.0, _RANGE, N_ANGLES), 1.0)
    gain[ANGLE_INDEX["pelvis_twist"]] = 1.0
    angles = rest + gain * (angles - rest) + habit * rng.normal(size=N_ANGLES)
    angles += amount * _wander(rng, t, _WANDER_S, N_ANGLES)
    return clip_from_motion(f"{dance} {seed}", still(angles), fps)


def _wander(rng: np.random.Generator, t: Array, seconds: float, columns: int) -> Array:
    """Smooth random processes of unit variance and a correlation time, (T, columns)."""
    step = float(t[1] - t[0])
    sigma = seconds / step
    margin = int(4 * sigma)
    noise = gaussian_filter1d(rng.normal(size=(len(t) + 2 * margin, columns)), sigma, axis=0)
    # the variance of white noise after a Gaussian of this width
    return np.asarray(noise[margin : margin + len(t)] * np.sqrt(2.0 * sigma * np.sqrt(np.pi)))


def _spreads() -> tuple[Array, Array]:
    habit, amount = np.zeros(N_ANGLES), np.zeros(N_ANGLES)
    for i, name in enumerate(ANGLES):
        joint = name.removeprefix("left_").removeprefix("right_").split("_")[0]
        if joint in _SPREAD_DEG:
            habit[i], amount[i] = _SPREAD_DEG[joint]
    return habit, amount
