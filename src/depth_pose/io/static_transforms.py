"""Transforms of ``/tf_static`` in recordings."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from depth_pose.core.errors import InputError
from depth_pose.io import schemas
from depth_pose.io.messages import read_message
from depth_pose.io.recording import Recording

TOPIC = "/tf_static"
"""The topic's name."""


@dataclass(frozen=True)
class StaticTransform:
    """One transform: ``pose`` is x, y, z, qx, qy, qz, qw of the child frame in its parent, metres."""

    parent: str
    child: str
    pose: tuple[float, ...]


def read_static_transforms(path: Path | str) -> tuple[StaticTransform, ...]:
    """Return the transforms of ``/tf_static`` in a recording, in order; none where it has no such topic.

    Raises
    ------
    InputError
        If the recording cannot be read, or a message is damaged.
    """
    recording = Recording(path)
    topic = recording.topics.get(TOPIC)
    if topic is None:
        return ()
    if topic.kind != schemas.TRANSFORMS:
        raise InputError(f"{path}: {TOPIC} is of type {topic.kind}; it must be {schemas.TRANSFORMS}")
    found = []
    for raw in recording.messages(TOPIC):
        for t in read_message(raw.data, schemas.TRANSFORMS).transforms:
            p, q = t.transform.translation, t.transform.rotation
            pose = tuple(map(float, (p.x, p.y, p.z, q.x, q.y, q.z, q.w)))
            found.append(StaticTransform(t.header.frame_id, t.child_frame_id, pose))
    return tuple(found)
