"""A person's shape as it is learned, frame by frame."""

from __future__ import annotations

from depth_pose.body.build import BuildSpace
from depth_pose.body.build_file import KnownBuild
from depth_pose.refine.personal import PersonalBuilds
from depth_pose.refine.tuning import BuildTuning
from depth_pose.track.state import Shape


class Learned:
    """Keeps the shape from call to call."""

    def __init__(self, tuning: BuildTuning, space: BuildSpace, known: KnownBuild | None = None) -> None:
        self.builds, self.shape = PersonalBuilds(tuning, space, known), Shape()

    def take_size(self, scale: float, is_given: bool) -> None:
        self.shape = self.builds.take_size(self.shape, scale, is_given)

    def add(self, *evidence) -> None:
        self.shape = self.builds.add(self.shape, *evidence)

    def known(self) -> KnownBuild:
        return self.builds.known(self.shape)

    @property
    def scale(self) -> float:
        return self.shape.scale

    @property
    def build(self):
        return self.shape.build
