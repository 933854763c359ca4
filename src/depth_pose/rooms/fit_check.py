r"""Check that the cameras of a rig fit each other, from people whom two of them see.

Somebody who walks gives each camera a path of joints in the room. Two paths of one person have one shape:
after the best rigid motion and shift in time they agree to `_SAME_M`. If they lie more than `OFF_M` apart in
the room, the rig does not fit; if a shift in time makes them agree, the clocks differ.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.result import Skeleton
from depth_pose.core.skeleton import JOINT_INDEX, JointState

Array = NDArray[np.float64]

OFF_M = 0.15
"""Distance (m) between two cameras' views of a person above which the rig does not fit; views of one person
differ by a few centimetres. Set by hand."""

_JOINTS = [JOINT_INDEX[name] for name in ("pelvis", "chest", "neck", "left_hip", "right_hip")]
"""Joints of the paths: they tell place and direction."""

_KNOWN = 0.3
"""Minimum confidence of these joints; set by hand."""

_KEPT, _ENOUGH = 450, 40
"""Maximum number of kept sightings of a person by a camera, and the minimum to compare; set by hand."""

_MOST_PATHS = 40
"""Maximum number of kept paths, the newest."""

_COMPARED, _THINNED = 3, 100
"""Number of a camera's paths that are compared after a rigid motion, the longest, and of sightings of each:
a check takes at most 40 ms. Set by hand."""

_ROUND_S = 2.0
"""Maximum time (s) in which all pairs of cameras are judged live; set by hand."""

_SAME_M = 0.1
"""Root mean square distance (m) of two paths of one person after a rigid motion; set by hand."""

_WALKED_M, _TURNED_M = 0.8, 0.25
"""Minimum extent (m) of a path along its longest direction and across it: straight ways all look the same.
Set by hand."""

_STEP_NS = 300_000_000
"""Maximum distance (ns) of sightings between which a place is interpolated; set by hand."""

_SHIFTS_S = np.linspace(-1.0, 1.0, 21)
"""Differences of clocks that are tried, seconds."""

_CLEARER = 0.6
"""A shift in time counts if it makes the distance after the rigid motion this much smaller; set by hand."""


@dataclass(frozen=True)
class Misfit:
    """Two cameras that do not fit.

    Attributes
    ----------
    camera, other : int
    off_m : float
        Median distance of a person as both see them.
    turned_deg : float
        Angle of the rotation that makes them agree.
    shift_s : float
        How much later the stamps of `camera` are; 0 where that is not the reason.
    """

    camera: int
    other: int
    off_m: float
    turned_deg: float
    shift_s: float


class FitCheck:
    """Collects what the cameras see, and judges them.

    Parameters
    ----------
    names : sequence of str
        Of the cameras.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._names = tuple(names)
        self._pairs = list(combinations(range(len(self._names)), 2))
        self._next = 0
        self.reset()

    def __len__(self) -> int:
        """Return the number of kept paths."""
        return len(self._paths)

    def reset(self) -> None:
        """Forget all sightings."""
        self._paths: dict[tuple[int, str], deque[tuple[int, Array]]] = {}
        self._found: dict[tuple[int, int], Misfit | None] = {}

    def forget(self, camera: int) -> None:
        """Forget the sightings of a camera; it was moved, or its clock was set."""
        self._paths = {key: path for key, path in self._paths.items() if key[0] != camera}
        self._found = {pair: found for pair, found in self._found.items() if camera not in pair}

    def add(self, camera: int, stamp_ns: int, skeletons: Iterable[Skeleton]) -> None:
        """Add the people of a frame, in the room's frame and clock."""
        for s in skeletons:
            if len(s.positions) and _are_known(s):
                path = self._paths.pop((camera, s.body_id), None) or deque(maxlen=_KEPT)
                path.append((stamp_ns, s.positions[_JOINTS]))
                self._paths[camera, s.body_id] = path  # the newest last
        while len(self._paths) > _MOST_PATHS:
            del self._paths[next(iter(self._paths))]

    def judge_all(self) -> dict[int, str]:
        """Judge all cameras; return a line for each that does not fit the others.

        Where only two cameras disagree and no third one decides, both have the same line, which names both.
        """
        self._found = {pair: self._judge(*pair) for pair in self._pairs}
        return self._lines()

    def judge_next(self) -> dict[int, str] | None:
        """Judge the next pair of cameras, as there is time for live; return the lines after the last pair."""
        if not self._pairs:
            return None
        pair = self._pairs[self._next]
        self._found[pair] = self._judge(*pair)
        self._next = (self._next + 1) % len(self._pairs)
        return None if self._next else self._lines()

    @property
    def period_s(self) -> float:
        """Time between two calls of `judge_next`."""
        return min(1.0, _ROUND_S / max(1, len(self._pairs)))

    def _lines(self) -> dict[int, str]:
        misfits = sorted((m for m in self._found.values() if m is not None), key=lambda m: -m.off_m)
        blamed = Counter(c for m in misfits for c in (m.camera, m.other))
        lines = {}
        while misfits:
            bad = max({c for m in misfits for c in (m.camera, m.other)}, key=lambda c: (blamed[c], c))
            worst = next(m for m in misfits if bad in (m.camera, m.other))
            if blamed[worst.camera] == blamed[worst.other] and not worst.shift_s:
                lines[worst.camera] = lines[worst.other] = self._line_of_both(worst)
            else:
                lines[bad] = self._line(worst, bad)
            misfits = [m for m in misfits if bad not in (m.camera, m.other)]
        return lines

    def _line(self, m: Misfit, bad: int) -> str:
        name, other = self._names[bad], self._names[m.other if bad == m.camera else m.camera]
        if m.shift_s:
            later = m.shift_s if bad == m.camera else -m.shift_s
            return (
                f"the clock of {name} is about {abs(later):.1f} s {'ahead of' if later > 0 else 'behind'} "
                f"that of {other}: synchronise them, or correct clock_offset in the rig file"
            )
        return f"{name} does not fit {other}: {_amount(m)}; calibrate again"

    def _line_of_both(self, m: Misfit) -> str:
        first, second = (self._names[c] for c in sorted((m.camera, m.other)))
        return f"{first} and {second} do not agree: {_amount(m)}; calibrate again"

    def _judge(self, a: int, b: int) -> Misfit | None:
        """Compare two cameras by the pair of paths that agree best after a rigid motion."""
        firsts, seconds = (
            [_arrays(p) for (camera, _), p in self._paths.items() if camera == c and len(p) >= _ENOUGH]
            for c in (a, b)
        )
        if any(_do_fit(first, second) for first in firsts for second in seconds):
            return None
        firsts, seconds = (sorted(paths, key=lambda p: -len(p[0]))[:_COMPARED] for paths in (firsts, seconds))
        found = [
            result
            for first in firsts
            for second in map(_thinned, seconds)
            if (result := _compare(first, second, a, b)) is not None
        ]
        return min(found, key=lambda one: one[0])[1] if found else None


def _amount(m: Misfit) -> str:
    turned = f" and turned by {m.turned_deg:.0f} degrees" if m.turned_deg > 5.0 else ""
    return f"off by about {m.off_m:.2g} m{turned}"


def _are_known(skeleton: Skeleton) -> bool:
    states, confidence = skeleton.joint_states[_JOINTS], skeleton.joint_confidence[_JOINTS]
    return bool((states != JointState.LOST).all() and (confidence >= _KNOWN).all())


def _arrays(path: Iterable[tuple[int, Array]]) -> tuple[NDArray[np.int64], Array]:
    stamps, joints = zip(*path, strict=True)
    return np.array(stamps, np.int64), np.array(joints)


def _thinned(path: tuple[NDArray[np.int64], Array]) -> tuple[NDArray[np.int64], Array]:
    """Return `_THINNED` sightings of a path, or nearly twice as many."""
    step = max(1, len(path[0]) // _THINNED)
    return path[0][::step], path[1][::step]


def _compare(
    first: tuple[NDArray[np.int64], Array], second: tuple[NDArray[np.int64], Array], a: int, b: int
) -> tuple[float, Misfit] | None:
    """Return the rms distance of two paths after a rigid motion, and their misfit; None if not comparable."""
    best_rms, best_shift, at_zero = np.inf, 0.0, None
    for shift in _SHIFTS_S.tolist():
        pair = _aligned(first, second, round(shift * 1e9))
        if pair is None:
            continue
        rms, turned_deg = _rigid(*pair)
        if abs(shift) < 1e-9:
            at_zero = rms, turned_deg, _off(*pair)
        if rms < best_rms:
            best_rms, best_shift = rms, shift
    if at_zero is None or best_rms > _SAME_M:
        return None
    rms, turned_deg, off_m = at_zero
    is_shifted = abs(best_shift) > 0.05 and best_rms < _CLEARER * rms
    return best_rms, Misfit(b, a, off_m, turned_deg, best_shift if is_shifted else 0.0)


def _do_fit(first: tuple[NDArray[np.int64], Array], second: tuple[NDArray[np.int64], Array]) -> bool:
    """Check whether two paths are those of one person at one place."""
    pair = _aligned(first, second, 0)
    return pair is not None and _off(*pair) <= OFF_M


def _off(own: Array, other: Array) -> float:
    """Return the median distance (m) of the joints' mean."""
    return float(np.median(np.linalg.norm((other - own).mean(axis=1), axis=1)))


def _aligned(
    first: tuple[NDArray[np.int64], Array], second: tuple[NDArray[np.int64], Array], shift_ns: int
) -> tuple[Array, Array] | None:
    """Return the joints (n, 5, 3) of the first at the moved stamps of the second, and of the second."""
    stamps, joints = first
    wanted = second[0] - shift_ns
    at = np.searchsorted(stamps, wanted).clip(1, len(stamps) - 1)
    before, after = stamps[at - 1], stamps[at]
    is_inside = (wanted >= before) & (wanted <= after) & (after - before <= _STEP_NS) & (after > before)
    if is_inside.sum() < _ENOUGH:
        return None
    at, wanted = at[is_inside], wanted[is_inside]
    share = ((wanted - stamps[at - 1]) / (stamps[at] - stamps[at - 1]))[:, None, None]
    own = (1.0 - share) * joints[at - 1] + share * joints[at]
    ways = own.mean(axis=1) - own.mean(axis=(0, 1))
    spread = np.linalg.svd(ways[:, :3], compute_uv=False)[:2] / np.sqrt(len(ways)) * np.sqrt(12.0)
    return (own, second[1][is_inside]) if spread[0] >= _WALKED_M and spread[1] >= _TURNED_M else None


def _rigid(own: Array, other: Array) -> tuple[float, float]:
    """Return the rms distance after the best rigid motion (Kabsch), metres, and its angle, degrees."""
    p, q = own.reshape(-1, 3), other.reshape(-1, 3)
    p0, q0 = p - p.mean(axis=0), q - q.mean(axis=0)
    u, _, vt = np.linalg.svd(p0.T @ q0)
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt)) or 1.0])
    R = u @ flip @ vt
    rest = p0 @ R - q0
    angle = np.degrees(np.arccos(np.clip(0.5 * (np.trace(R) - 1.0), -1.0, 1.0)))
    return float(np.sqrt((rest**2).sum(axis=1).mean())), float(angle)
