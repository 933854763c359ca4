"""Skeletons as tables, rows and plain values: one vocabulary for data frames, CSV and JSON."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.extras import require
from depth_pose.core.skeleton import JOINTS, JointState, Source, Tracking

COLUMNS = (
    *("frame", "stamp_ns", "time_s", "body_id", "joint", "x", "y", "z", "qx", "qy", "qz", "qw"),
    *("joint_confidence", "joint_state", "confidence", "source", "scale", "frame_id"),
)
"""Columns of a CSV file; lengths in metres, in the frame ``frame_id``; quaternions as in the messages."""


RECORD = np.dtype(
    [
        ("stamp_ns", "i8"),
        ("body_id", "U32"),
        ("source", "U9"),
        ("confidence", "f4"),
        ("residual", "f4"),
        ("scale", "f4"),
        ("positions", "f8", (len(JOINTS), 3)),
        ("quats_xyzw", "f8", (len(JOINTS), 4)),
        ("joint_confidence", "f4", (len(JOINTS),)),
        ("joint_states", "u1", (len(JOINTS),)),
        ("velocities", "f4", (len(JOINTS), 3)),
        ("covariances", "f4", (len(JOINTS), 3, 3)),
    ]
)
"""Type of `to_record`; rows of ``positions`` and the like are in the order of `JOINTS`."""


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


def to_dict(skeleton: Any) -> dict[str, Any]:
    """Return a skeleton as plain numbers, strings and lists, suitable for JSON; what is unknown is None."""
    return {
        "body_id": skeleton.body_id,
        "time_s": skeleton.time,
        "stamp_ns": skeleton.stamp_ns,
        "frame_id": skeleton.frame_id,
        "source": Source(skeleton.source).name,
        "tracking": Tracking(skeleton.tracking).name,
        "confidence": float(skeleton.confidence),
        "residual": float(skeleton.residual),
        "scale": float(skeleton.scale),
        "centre": _known(skeleton.centre),
        "velocity": _known(skeleton.velocity),
        "box": _known(skeleton.box),
        "joints": {
            joint.name: {
                "position": joint.position.tolist(),
                "quat_xyzw": joint.quat_xyzw.tolist(),
                "confidence": joint.confidence,
                "state": joint.state.name,
                "velocity": _known(joint.velocity),
                "covariance": _known(joint.covariance),
            }
            for joint in skeleton.joints
        },
    }


def to_record(skeleton: Any) -> NDArray[np.void]:
    """Return a skeleton as one row of type `RECORD`; NaN where something is unknown."""
    record = np.zeros((), RECORD)
    for name in ("stamp_ns", "body_id", "confidence", "residual", "scale"):
        record[name] = getattr(skeleton, name)
    record["source"] = Source(skeleton.source).name
    record["joint_states"] = JointState.LOST if skeleton.is_lost else skeleton.joint_states
    for name in ("positions", "quats_xyzw", "joint_confidence", "velocities", "covariances"):
        values = getattr(skeleton, name)
        record[name] = values if len(values) else np.nan
    return record


def _known(values: NDArray[np.float64]) -> list[Any] | None:
    """Return an array as lists, None where it is NaN: JSON has no NaN."""
    return values.tolist() if np.isfinite(values).all() else None
