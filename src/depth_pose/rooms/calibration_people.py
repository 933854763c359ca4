"""People seen by two cameras at the same time, as terms of the room's least-squares problem."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.rotations import unit_vectors
from depth_pose.core.skeleton import JOINT_INDEX, JOINTS
from depth_pose.rooms.calibration_input import BodyTrack
from depth_pose.rooms.calibration_state import NEAR, OFFSET, SIZE, CameraState, Normal, motion_rows

Array = NDArray[np.float64]

_TRUNK = [JOINT_INDEX[name] for name in ("pelvis", "spine", "chest", "neck", "head")]
_SAME_TRACK_M, _SAME_TRACK_S = 0.35, 1.0
"""Maximum distance of the trunks of two tracks of one person (m), and the minimum time for which it holds
(s). Set by hand."""

_ERRORS = {
    "pelvis": (1.0, 0.03, 0.025),
    "spine": (1.6, 0.05, 0.025),
    "chest": (1.9, 0.05, 0.025),
    "neck": (1.1, 0.03, 0.025),
    "head": (0.6, 0.02, 0.03),
    "shoulder": (1.3, 0.045, 0.035),
    "elbow": (2.5, 0.08, 0.07),
    "wrist": (3.0, 0.1, 0.1),
    "hip": (0.9, 0.03, 0.03),
    "knee": (0.25, 0.02, 0.035),
    "ankle": (0.15, 0.015, 0.04),
    "foot": (0.4, 0.03, 0.06),
}
"""Errors of visible joints (m): bias towards the camera relative to the pelvis; deviation along the ray and
across it. Measured on simulated pairs of cameras against the truth."""
_NEAR_SHARE, _ALONG_M, _ACROSS_M = np.array([_ERRORS[name.rpartition("_")[2]] for name in JOINTS]).T
_ALIKE_S = 0.7
"""Correlation time of a joint's error (s). Set by hand."""
_MOST_S = 150.0
"""Maximum weight of a pair of cameras' joints (s, summed over joints), since systematic errors do not average
out. Chosen on simulated pairs."""
_LEAST_SURE = 0.1
"""Minimum confidence of a joint that is used. Set by hand."""
_MEDIAN_CHI2 = 2.366
"""Median of the chi-squared distribution with three degrees of freedom."""
_ALIKE_JOINTS = 4.0
"""Number of joints with a common error. Set by hand."""
_FAR_M = 0.12
"""Residual (m) at which a joint has a quarter of its weight. Set by hand."""


class PeopleTerm(NamedTuple):
    """One person in two cameras: a track of camera ``a`` and one of camera ``b``.

    ``agrees`` (N,) marks the frames of track a in which both agree, since either may switch to another
    person.
    """

    a: int
    b: int
    track_a: BodyTrack
    track_b: BodyTrack
    agrees: NDArray[np.bool_]

    @property
    def seconds(self) -> float:
        """Time in which both tracks agree, seconds."""
        return float(self.track_a.seconds[self.agrees].sum())


class _Seen(NamedTuple):
    """Joints (N, 3) in both cameras' frames, velocities by b, joint indices, confidences, times (s)."""

    pa: Array
    pb: Array
    vb: Array
    joint: NDArray[np.int64]
    sure: Array
    seconds: Array


def add_people(normal: Normal, states: Sequence[CameraState], terms: Sequence[PeopleTerm]) -> Array:
    """Add the joints that both cameras see at one time; return the norms (N,) of the residuals (m)."""
    pairs: defaultdict[tuple[int, int], list[PeopleTerm]] = defaultdict(list)
    for term in terms:
        pairs[term.a, term.b].append(term)
    lengths = [np.zeros(0)]
    for (a, b), some in pairs.items():
        seen = _Seen(*map(np.concatenate, zip(*(_see(term, states) for term in some), strict=True)))
        if len(seen.joint):
            lengths.append(_add_pair(normal, states, a, b, seen))
    return np.concatenate(lengths)


def _see(term: PeopleTerm, states: Sequence[CameraState]) -> _Seen:
    first, second = term.track_a, term.track_b
    at = second.at(first.times - states[term.a].offset + states[term.b].offset)
    sure = np.sqrt(first.confidence * at.confidence) * term.agrees[:, None]
    frame, joint = np.nonzero(sure > _LEAST_SURE)
    return _Seen(
        first.joints[frame, joint],
        at.joints[frame, joint],
        at.velocities[frame, joint],
        joint,
        sure[frame, joint],
        first.seconds[frame],
    )


def _add_pair(normal: Normal, states: Sequence[CameraState], a: int, b: int, seen: _Seen) -> Array:
    first, second = states[a], states[b]
    Ra, Rb = first.T_room_camera[:3, :3], second.T_room_camera[:3, :3]
    share = _NEAR_SHARE[seen.joint, None]
    ua, ub = unit_vectors(seen.pa), unit_vectors(seen.pb)
    qa = first.to_room(seen.pa + first.near * share * ua)
    qb = second.to_room(seen.pb + second.near * share * ub)
    ua, ub, vb = ua @ Ra.T, ub @ Rb.T, seen.vb @ Rb.T
    residual = qa - qb
    length = np.linalg.norm(residual, axis=1)
    Ja, Jb = motion_rows(qa), -motion_rows(qb)
    Ja[:, :, OFFSET], Jb[:, :, OFFSET] = vb, -vb
    Ja[:, :, NEAR], Jb[:, :, NEAR] = share * ua, -share * ub
    along, across = (deviation[seen.joint, None, None] ** 2 for deviation in (_ALONG_M, _ACROSS_M))
    spread = (along - across) * (ua[:, :, None] * ua[:, None] + ub[:, :, None] * ub[:, None])
    spread += 2.0 * across * np.eye(3)
    root = np.swapaxes(np.linalg.cholesky(np.linalg.inv(spread)), 1, 2)
    white = np.einsum("nij,nj->ni", root, residual)
    excess = max(1.0, float(np.median(np.sum(white**2, axis=1))) / _MEDIAN_CHI2)
    trust = min(1.0, _MOST_S / float(seen.sure @ seen.seconds)) / excess / (1.0 + (length / _FAR_M) ** 2) ** 2
    weight = trust * seen.sure * seen.seconds / (_ALIKE_S * _ALIKE_JOINTS)
    rows = [(a, (root @ Ja).reshape(-1, SIZE)), (b, (root @ Jb).reshape(-1, SIZE))]
    normal.add(rows, white.ravel(), np.repeat(weight, 3))
    return length


def pair_tracks(tracks: Sequence[Sequence[BodyTrack]], states: Sequence[CameraState]) -> list[PeopleTerm]:
    """Find the pairs of tracks of two cameras that are one person."""
    terms = []
    for a, b in combinations(range(len(states)), 2):
        for first in tracks[a]:
            for second in tracks[b]:
                seen = second.at(first.times - states[a].offset + states[b].offset)
                here = states[a].to_room(first.joints[:, _TRUNK]).mean(axis=1)
                there = states[b].to_room(seen.joints[:, _TRUNK]).mean(axis=1)
                agrees = seen.present & (np.linalg.norm(here - there, axis=1) < _SAME_TRACK_M)
                term = PeopleTerm(a, b, first, second, agrees)
                if term.seconds > _SAME_TRACK_S:
                    terms.append(term)
    return terms
