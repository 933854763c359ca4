"""Performances with known poses, for training and testing the tracker.

A performance is a motion of a body in a garment, seen by simulated cameras: for each frame the
volume and the true rotations of the body's segments. The same motion of several bodies and in
several garments shares its frames.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.procedural import BodyShape
from depth_pose.motion.clip import Clip
from depth_pose.rooms.rig import RigCamera, look_at
from depth_pose.sim.roof_cameras import MIDDLE_M, RigRenderer
from depth_pose.sim.sensor import Mesh
from depth_pose.sim.wearers import Wearer, dressed_frames
from depth_pose.volume.config import SpaceConfig, ViewsConfig, VolumeConfig
from depth_pose.volume.eyes import make_eyes
from depth_pose.volume.headings import headings_of
from depth_pose.volume.hull import SurfaceVoxels, Volume
from depth_pose.volume.synchroniser import ViewSet

Array = NDArray[np.float64]

Eyes = Callable[[Sequence[Mesh]], Volume]
"""Return the volume of a scene in the world frame."""


TRAINING_SHAPES: tuple[BodyShape, ...] = (
    BodyShape(stature_m=1.70),
    BodyShape(stature_m=1.62, girth=0.92, shoulder_width=0.95, hip_width=1.06, leg_length=1.02),
    BodyShape(stature_m=1.79, girth=1.10, shoulder_width=1.06, arm_length=1.03, trunk_depth=1.08),
)
"""Builds of the training's wearers."""

TEST_SHAPES: tuple[BodyShape, ...] = (
    BodyShape(stature_m=1.58, girth=0.96, hip_width=1.10, arm_length=0.97),
    BodyShape(stature_m=1.74, girth=1.16, shoulder_width=0.98, leg_length=0.97, trunk_depth=1.1),
    BodyShape(stature_m=1.86, girth=1.02, shoulder_width=1.05, arm_length=1.04, leg_length=1.03),
)
"""Builds of the three test dancers; none of them is used in training."""


@dataclass(frozen=True, eq=False)
class Performance:
    """Observations of one performance, and the truth.

    Attributes
    ----------
    name : str
    fps : float
    stature : float
        Of the performer, metres.
    volumes : tuple of Volume
        One for each of T frames.
    rotations : (T, 21, 3, 3) float64
        Segment rotations, rest pose to world frame.
    pelvis : (T, 3) float64
        World frame, metres.
    """

    name: str
    fps: float
    stature: float
    volumes: tuple[Volume, ...]
    rotations: Array
    pelvis: Array

    def __len__(self) -> int:
        return len(self.volumes)


def rig_eyes(kind: str, rig: Sequence[RigCamera], space: SpaceConfig | None = None) -> Eyes:
    """Observe the person as the pipeline does: ``silhouettes``, or ``depth`` of the person alone."""
    config = VolumeConfig(space=space or SpaceConfig(), views=ViewsConfig(cut_out=False))
    eyes, renderer = make_eyes(kind, rig, config), RigRenderer(rig)
    return lambda meshes: eyes.see(ViewSet(0, renderer.images(meshes, kind)))[0]


def watch(
    clip: Clip,
    wearer: Wearer,
    eyes: Eyes,
    every: int = 1,
    progress: Callable[[int], None] | None = None,
) -> Performance:
    """Simulate a performance in front of the eyes, which see every n-th frame."""
    return watch_with(clip, wearer, lambda meshes, nodes, heading: [eyes(meshes)], every, progress)[0]


def watch_around(
    clip: Clip,
    wearer: Wearer,
    camera: RigCamera,
    voxels: SurfaceVoxels,
    views: int,
    every: int = 1,
    progress: Callable[[int], None] | None = None,
) -> list[Performance]:
    """Simulate a performance in front of a depth camera at one azimuth after the other.

    In view v the camera is ``2 pi v / views`` to the left of where the pelvis faces, as high and as far
    as the one given.
    """
    x, height, z = camera.position
    distance = float(np.hypot(x, z))

    def see(meshes: Sequence[Mesh], nodes: Array, heading: float) -> list[Volume]:
        spot, seen = nodes[0] * [1.0, 0.0, 1.0], []
        for azimuth in heading + 2 * np.pi * np.arange(views) / views:
            eye = spot + [distance * np.sin(azimuth), height, distance * np.cos(azimuth)]
            placed = RigCamera("depth", camera.camera, look_at(eye, spot + MIDDLE_M))
            depth = RigRenderer([placed]).depths(meshes)[0]
            seen.append(voxels.see(placed.points_world(depth), eye))
        return seen

    return watch_with(clip, wearer, see, every, progress)


def watch_with(
    clip: Clip,
    wearer: Wearer,
    see: Callable[[Sequence[Mesh], Array, float], list[Volume]],
    every: int,
    progress: Callable[[int], None] | None,
) -> list[Performance]:
    """Return a performance for each view; ``see`` maps meshes, nodes and heading to its volume."""
    frames: list[list[Volume]] = []
    pelvis = []
    headings = headings_of(clip.rotations)
    for i, (meshes, posed) in enumerate(dressed_frames(wearer, clip)):
        if i % every == 0:
            frames.append(see(meshes, posed.nodes, float(headings[i])))
            pelvis.append(posed.nodes[0])
        if progress is not None:
            progress(i + 1)
    stature, rotations = wearer.shape.stature_m, clip.rotations[::every]
    return [
        Performance(clip.name, clip.fps / every, stature, volumes, rotations, np.array(pelvis))
        for volumes in zip(*frames, strict=True)
    ]
