"""The result of one camera's pipeline for one frame, as the fusion of several cameras needs it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from depth_pose.body.pose import BodyPose
from depth_pose.core.result import Skeleton
from depth_pose.pipeline import FrameResult
from depth_pose.track.packed_people import PackedPeople, pack_people


@dataclass(frozen=True)
class CameraFrame:
    """One frame of one camera; its people are packed, to keep files small.

    Attributes
    ----------
    stamp_ns : int
        In the camera's own clock.
    size : tuple of int
        Width and height of the depth image, pixels.
    people : PackedPeople
    poses : mapping of str to BodyPose
        The fitted pose of each, camera frame, by the camera's body id.
    skeletons : tuple of Skeleton
        The camera's answers.
    """

    stamp_ns: int
    size: tuple[int, int]
    people: PackedPeople
    poses: Mapping[str, BodyPose]
    skeletons: tuple[Skeleton, ...]

    @classmethod
    def of(cls, result: FrameResult, size: tuple[int, int]) -> CameraFrame:
        """Make one from a pipeline's result."""
        return cls(
            result.people.stamp_ns,
            size,
            pack_people(result.people),
            {f.body_id: f.pose for f in result.refined if not f.is_lost},
            result.skeletons,
        )
