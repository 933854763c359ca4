"""Resolve left and right between cameras, one of which confused front and back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.result import Skeleton
from depth_pose.core.skeleton import JOINTS, MIRROR_JOINTS
from depth_pose.rooms.merge import PlacedSkeleton

Array = NDArray[np.float64]

_SIDED = np.flatnonzero(np.arange(len(JOINTS)) != MIRROR_JOINTS)
"""Joints that have a left and a right one."""

_CLEARLY, _CLEARLY_M = 0.7, 0.05
"""Maximum distance of the mirror image, as a share of the skeleton's own, and the minimum gain (m), for a
skeleton to be mirrored; set by hand."""

_MEMORY = 0.5
"""Weight of the last merged skeleton, in units of confidence; set by hand."""

_MIRRORED_TRUST = 0.5
"""Factor on the confidence of joints whose sides were exchanged; set by hand."""


def agree_on_sides(seen: Sequence[PlacedSkeleton], before: Array | None) -> list[PlacedSkeleton]:
    """Exchange left and right of the skeletons that contradict the others.

    Parameters
    ----------
    seen : sequence of PlacedSkeleton
        Of one person, by different cameras.
    before : (19, 3) float64 or None
        The person's last merged joints, moved to the common time; metres.
    """
    trust = np.array([s.skeleton.confidence for s in seen])
    first = seen[int(np.argmax(trust))]
    reference = first.skeleton.positions + first.offset if before is None else before
    mirrored = np.array([_is_mirrored(s.skeleton.positions + s.offset, reference) for s in seen])
    if mirrored.all() or not mirrored.any():
        return list(seen)
    against = trust[mirrored].sum() > trust[~mirrored].sum() + (_MEMORY if before is not None else 0.0)
    wrong = ~mirrored if against else mirrored
    return [
        replace(s, skeleton=exchange_sides(s.skeleton)) if w else s for s, w in zip(seen, wrong, strict=True)
    ]


def exchange_sides(skeleton: Skeleton) -> Skeleton:
    """Return the skeleton with left and right exchanged: the same positions, facing the other way."""
    x, y, z, w = skeleton.quats_xyzw[MIRROR_JOINTS].T
    return replace(
        skeleton,
        positions=skeleton.positions[MIRROR_JOINTS],
        quats_xyzw=np.stack([-z, w, x, -y], axis=1),  # half a turn about the body's own y axis
        joint_confidence=skeleton.joint_confidence[MIRROR_JOINTS] * np.float32(_MIRRORED_TRUST),
        joint_states=skeleton.joint_states[MIRROR_JOINTS],
    )


def _is_mirrored(positions: Array, reference: Array) -> bool:
    """Whether the mirror image of joints (19, 3) is clearly nearer to others than they are."""
    as_is = float(np.linalg.norm((positions - reference)[_SIDED], axis=1).mean())
    exchanged = float(np.linalg.norm((positions[MIRROR_JOINTS] - reference)[_SIDED], axis=1).mean())
    return exchanged < _CLEARLY * as_is and as_is - exchanged > _CLEARLY_M
