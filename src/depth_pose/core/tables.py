"""Skeletons as tables: one vocabulary for data frames and CSV files."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from depth_pose.core.extras import require
from depth_pose.core.skeleton import JOINTS, JointState, Source

COLUMNS = (
    *("frame", "stamp_ns", "time_s", "body_id", "joint", "x", "y", "z", "qx", "qy", "qz", "qw"),
    *("joint_confidence", "joint_state", "confidence", "source", "scale", "frame_id"),
)
"""Columns of a CSV file; lengths in metres, in the frame ``frame_id``; quaternions as in the messages."""


def to_pandas(skeletons: Sequence[Any]) -> Any:
    """Return a ``pandas.DataFrame`` of skeletons: a row for each joint of each.

    Its columns are `COLUMNS` without ``frame``, which numbers the frames of a recording; ``time_s`` is the
    stamp in seconds.

    Raises
    ------
    ConfigError
        Where pandas is not installed.
    """
    require("pandas", "to_pandas")
    import pandas

    known = [s for s in skeletons if not s.is_lost]
    each = len(JOINTS)

    def repeated(values: list[Any]) -> Any:
        return np.repeat(np.array(values), each)

    def stacked(name: str, *shape: int) -> Any:
        return np.concatenate([getattr(s, name) for s in known] or [np.zeros((0, *shape))])

    x, y, z = stacked("positions", 3).T
    qx, qy, qz, qw = stacked("quats_xyzw", 4).T
    columns = {
        "stamp_ns": repeated([s.stamp_ns for s in known]),
        "time_s": repeated([s.time for s in known]),
        "body_id": repeated([s.body_id for s in known]),
        "joint": list(JOINTS) * len(known),
        **dict(zip("xyz", (x, y, z), strict=True)),
        **dict(zip(("qx", "qy", "qz", "qw"), (qx, qy, qz, qw), strict=True)),
        "joint_confidence": stacked("joint_confidence"),
        "joint_state": [JointState(state).name for state in stacked("joint_states").astype(int)],
        "confidence": repeated([s.confidence for s in known]),
        "source": repeated([Source(s.source).name for s in known]),
        "scale": repeated([s.scale for s in known]),
        "frame_id": repeated([s.frame_id for s in known]),
    }
    return pandas.DataFrame({name: columns[name] for name in COLUMNS if name in columns})
