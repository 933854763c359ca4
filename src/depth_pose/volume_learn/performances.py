"""Performances with known poses: what the tracker is taught with, and tried on.

A performance is a motion on a body in a garment, as simulated cameras see it: for each frame the
volume and the true rotations of the body's segments. The same motion on several bodies and in
several garments shares its frames.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.procedural import BodyShape
from depth_pose.motion.clip import Clip
from depth_pose.sim.roof_cameras import RigRenderer
from depth_pose.sim.sensor import Mesh
from depth_pose.sim.wearers import Wearer, dressed_frames
from depth_pose.volume.hull import HullCarver, SurfaceVoxels, Volume
from depth_pose.volume.rig import RigCamera

Array = NDArray[np.float64]

Eyes = Callable[[Sequence[Mesh]], Volume]
"""Gives the volume of a scene in the world frame."""


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
"""Builds of the three test dancers; none of them is taught."""


@dataclass(frozen=True, eq=False)
class Performance:
    """What was seen of one performance, and the truth.

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


def hull_eyes(rig: Sequence[RigCamera], carver: HullCarver) -> Eyes:
    """See through silhouettes."""
    renderer = RigRenderer(rig)
    return lambda meshes: carver.carve(renderer.silhouettes(meshes))


def depth_eyes(rig: Sequence[RigCamera], voxels: SurfaceVoxels) -> Eyes:
    """See through depth cameras."""
    renderer = RigRenderer(rig)

    def see(meshes: Sequence[Mesh]) -> Volume:
        images = renderer.depths(meshes)
        return voxels.join(
            [voxels.see(c.points_world(d), c.position) for c, d in zip(rig, images, strict=True)]
        )

    return see


def watch(
    clip: Clip,
    wearer: Wearer,
    eyes: Eyes,
    every: int = 1,
    progress: Callable[[int], None] | None = None,
) -> Performance:
    """Let somebody perform a motion before the eyes, which see every so manyth frame."""
    volumes, pelvis = [], []
    for i, (meshes, posed) in enumerate(dressed_frames(wearer, clip)):
        if i % every == 0:
            volumes.append(eyes(meshes))
            pelvis.append(posed.nodes[0])
        if progress is not None:
            progress(i + 1)
    return Performance(
        clip.name,
        clip.fps / every,
        wearer.shape.stature_m,
        tuple(volumes),
        clip.rotations[::every],
        np.array(pelvis),
    )
