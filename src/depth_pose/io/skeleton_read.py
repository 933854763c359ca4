"""Reading of skeletons from recordings."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

from depth_pose.core.errors import InputError
from depth_pose.core.result import Skeleton
from depth_pose.io import schemas
from depth_pose.io.damage import tell_damage
from depth_pose.io.depth_topics import describe_topics
from depth_pose.io.messages import SkeletonsMessage, read_skeleton
from depth_pose.io.messages import read_people as read_people_message
from depth_pose.io.recording import Recording
from depth_pose.io.schemas import PEOPLE_TOPIC, SKELETON_TOPIC

_Read = TypeVar("_Read")


def read_skeletons(path: Path | str, topic: str = SKELETON_TOPIC) -> Iterator[Skeleton]:
    """Yield the skeletons of a recording, in order.

    Parameters
    ----------
    path : Path or str
        An MCAP file, or a folder of them.
    topic : str
        The topic's name.

    Raises
    ------
    InputError
        If the recording has no such topic.
    """
    recording = Recording(path)
    _require(recording, topic, schemas.SKELETON)
    definition = recording.topics[topic].definition
    return _decoded(recording, topic, lambda data: read_skeleton(data, definition))


def read_people(path: Path | str, topic: str = PEOPLE_TOPIC) -> Iterator[SkeletonsMessage]:
    """Yield the skeletons of all people, frame by frame, in order.

    For a recording with only `SKELETON_TOPIC`, yields that one person.

    Parameters
    ----------
    path : Path or str
        An MCAP file, or a folder of them.
    topic : str
        The topic's name.

    Raises
    ------
    InputError
        If the recording has neither topic.
    """
    recording = Recording(path)
    found = recording.topics.get(topic)
    if found is not None and found.kind == schemas.SKELETON:
        text = found.definition
        return _decoded(recording, topic, lambda data: _alone(read_skeleton(data, text)))
    if topic == PEOPLE_TOPIC and found is None and SKELETON_TOPIC in recording.topics:
        return read_people(path, SKELETON_TOPIC)
    _require(recording, topic, schemas.SKELETON_ARRAY)
    definition = recording.topics[topic].definition
    return _decoded(recording, topic, lambda data: read_people_message(data, definition))


def _alone(skeleton: Skeleton) -> SkeletonsMessage:
    shown = () if skeleton.is_lost else (skeleton,)
    return SkeletonsMessage(skeleton.stamp_ns, skeleton.frame_id, shown)


def _require(recording: Recording, topic: str, kind: str) -> None:
    found = recording.topics.get(topic)
    if found is None or found.kind != kind:
        others = [t.name for t in recording.topics.values() if t.kind == kind]
        raise InputError(
            f"{recording.path} has no skeletons on {topic}"
            + (f"; it has {', '.join(others)}" if others else f"; {describe_topics(recording)}")
        )


def _decoded(recording: Recording, topic: str, read: Callable[[bytes], _Read]) -> Iterator[_Read]:
    """Yield a topic's messages; an error names the recording."""
    for message in recording.messages(topic):
        try:
            found = read(message.data)
        except InputError as error:
            raise InputError(f"{recording.path}: {topic}: {error}") from error
        yield found
    tell_damage(recording.damage)
