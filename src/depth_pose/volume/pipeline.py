"""The method as a whole: Hirai, Ukita, Kidode, from what the cameras see to joint angles.

`VolumePoseTracker` goes from volumes to poses, `SilhouettePipeline` and `DepthPipeline` from images.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.angles import angles_from_rotations
from depth_pose.body.procedural import make_body
from depth_pose.core.config import MAX_STAMP_GAP_NS
from depth_pose.core.errors import ConfigError, InputError
from depth_pose.core.rotations import matrix_to_quat
from depth_pose.core.skeleton import (
    ADULT_STATURE_M,
    JOINT_NODES,
    JOINTS,
    NODE_PARENTS,
    NODES,
    JointState,
    Source,
    forward_kinematics,
)
from depth_pose.core.types import Skeleton
from depth_pose.volume.config import SpaceConfig, TrackConfig
from depth_pose.volume.descriptor import heading_angle
from depth_pose.volume.fit import VolumeFitter
from depth_pose.volume.hull import LEAST_VIEWS, HullCarver, SurfaceVoxels, Volume
from depth_pose.volume.model import VolumeModel
from depth_pose.volume.rig import RigCamera
from depth_pose.volume.stature import StatureFinder
from depth_pose.volume.tracker import UNLIKELY, LatentTracker, Tracked, look
from depth_pose.volume_learn.performances import depth_points, turns

Array = NDArray[np.float64]

LEAST_SURFACE_VOXELS = 150
"""Volumes with a smaller surface, at voxels of 2 cm, are nobody: a person's has some 3,000."""


_SLIVER = 0.3
"""A depth camera whose surface is less than this share of the largest one's shows too little."""


@dataclass(frozen=True)
class VolumePose:
    """What was found in one frame.

    Attributes
    ----------
    volume : Volume
    tracked : Tracked or None
        Where the volume is in the latent space; None for an empty space.
    regressed : (21, 3, 3) float64
        Segment rotations that the latent point stands for, rest pose to world frame.
    rotations : (21, 3, 3) float64
        The same after the fit to the volume.
    stature : float
        Metres.
    skeleton : Skeleton
        World frame; source VOLUME, or LOST for an empty space.
    disregarded : tuple of int
        Cameras that showed nobody, or hardly anybody, while others saw somebody.
    """

    volume: Volume
    tracked: Tracked | None
    regressed: Array
    rotations: Array
    stature: float
    skeleton: Skeleton
    disregarded: tuple[int, ...] = ()

    @cached_property
    def angles_deg(self) -> Array:
        """Anatomical angles, (47,), in the order of `depth_pose.body.angles.ANGLES`."""
        return angles_from_rotations(self.rotations)


class VolumePoseTracker:
    """From volumes to poses; frames are given in their order.

    Parameters
    ----------
    model : VolumeModel
    config : TrackConfig
    voxel : float
        Edge of the volumes' voxels, metres.
    frame_id : str
        Name of the world frame.
    """

    def __init__(
        self,
        model: VolumeModel,
        config: TrackConfig | None = None,
        voxel: float = SpaceConfig().voxel,
        frame_id: str = "world",
    ) -> None:
        self.model, self.config, self.frame_id = model, config or TrackConfig(), frame_id
        self._least = round(LEAST_SURFACE_VOXELS * (SpaceConfig().voxel / voxel) ** 2)
        self._tracker = LatentTracker(model, self.config)
        self._size = StatureFinder(model, self.config)
        self._body = make_body()
        self._fitter = VolumeFitter(self._body, model.trust)
        self._joint_trust = _joint_trust(self._body.skin.influence[:, 0], model.trust)
        self.reset()

    def reset(self) -> None:
        """Forget the person."""
        self._tracker.reset()
        self._size.reset()
        self._stamp_ns: int | None = None
        self._person = 0
        self._absent = 0

    def process(self, volume: Volume, stamp_ns: int) -> VolumePose:
        """Find the pose in a volume."""
        seconds = self._since(stamp_ns)
        if len(volume.surface) < self._least:
            self._absent += 1
            if self._absent == self.config.lost_after:
                self._forget()
            return self._nobody(volume, stamp_ns)
        self._absent = 0
        stature = self._size.update(volume)
        # Sec. 4: the descriptor for all headings
        sights = look(volume, stature, self.model.bins)
        # Sec. 3: the particle filter in the latent space
        tracked = self._tracker.track(sights, seconds)
        # Sec. 5: from the latent point to the pose
        turn = turns(heading_angle(tracked.step, self.model.bins))
        components = [self.model.to_pose[view].predict(tracked.latent[None]) for view in tracked.views]
        rotations, offset = self.model.pose_space.decode(np.mean(components, axis=0))
        regressed = np.asarray(turn @ rotations[0])
        centre = np.mean([part.centroid for part in volume.sights], axis=0) * [1.0, 0.0, 1.0]
        root = centre + stature * (turn @ offset[0])
        fitted, residual = regressed, 0.0
        if self.config.refine:
            # what only the volume tells: the fit of a body to it
            found = self._fitter.fit(volume.surface, regressed, root, stature, volume.eyes)
            fitted, root, residual = found.rotations, found.root, found.residual
            self._size.follow(found.size)
        skeleton = self._skeleton(stamp_ns, fitted, root, stature, tracked.misfit, residual)
        return VolumePose(volume, tracked, regressed, fitted, stature, skeleton)

    def _since(self, stamp_ns: int) -> float:
        last, self._stamp_ns = self._stamp_ns, stamp_ns
        if last is None:
            return 1.0 / self.model.fps
        if stamp_ns <= last or stamp_ns - last > MAX_STAMP_GAP_NS:
            self._forget()
            return 1.0 / self.model.fps
        return (stamp_ns - last) * 1e-9

    def _forget(self) -> None:
        """Whoever comes next is somebody else."""
        self._tracker.reset()
        self._size.reset()
        self._person += 1

    def _nobody(self, volume: Volume, stamp_ns: int) -> VolumePose:
        unknown = np.tile(np.eye(3), (len(NODES), 1, 1))
        return VolumePose(volume, None, unknown, unknown, 0.0, Skeleton.lost(stamp_ns, self.frame_id))

    def _skeleton(
        self, stamp_ns: int, rotations: Array, root: Array, stature: float, misfit: float, residual: float
    ) -> Skeleton:
        scale = stature / self._body.stature
        nodes = forward_kinematics(rotations, root, self._body.nodes, scale)
        sure = np.float32(1.0 / (1.0 + (misfit / UNLIKELY) ** 2))
        return Skeleton(
            stamp_ns=stamp_ns,
            frame_id=self.frame_id,
            body_id=str(self._person),
            source=Source.VOLUME,
            confidence=float(sure),
            residual=float(np.float32(residual)),
            scale=float(np.float32(stature / ADULT_STATURE_M)),
            positions=nodes[JOINT_NODES],
            quats_xyzw=matrix_to_quat(rotations[JOINT_NODES]),
            joint_confidence=(sure * self._joint_trust).astype(np.float32),
            joint_states=np.full(len(JOINTS), JointState.SEEN, np.uint8),
        )

    def warm_up(self) -> None:
        """Compile every kernel on a made-up volume."""
        grid = np.stack(np.meshgrid(*[np.arange(0.0, 0.3, 0.02)] * 3), axis=-1).reshape(-1, 3)
        tall = np.concatenate([grid, grid + [0.0, 0.6, 0.0]])
        volume = Volume(tall, tall.mean(axis=0), len(tall), 8)
        other = VolumePoseTracker(self.model, self.config, frame_id=self.frame_id)
        for stamp_ns in (1, 30_000_000):
            other.process(volume, stamp_ns)


def _joint_trust(strongest: NDArray[np.int32], trust: Array) -> Array:
    """How far clothing lets each joint's surroundings be seen, (19,), 0 to 1."""
    segment = np.array([trust[strongest == n].mean() if (strongest == n).any() else np.nan
                        for n in range(len(NODES))])  # fmt: skip
    for n in range(1, len(NODES)):
        if np.isnan(segment[n]):
            segment[n] = segment[NODE_PARENTS[n]]
    # a joint is as well seen as the segments that meet in it
    joints = [(segment[n] + segment[max(int(NODE_PARENTS[n]), 0)]) / 2 for n in JOINT_NODES]
    return np.clip(np.array(joints), 0.0, 1.0)


class SilhouettePipeline:
    """From the silhouettes of a set of cameras to poses.

    Parameters
    ----------
    model : VolumeModel
        Learned from silhouettes.
    rig : sequence of RigCamera
    space : SpaceConfig
    config : TrackConfig
    frame_id : str
    """

    def __init__(
        self,
        model: VolumeModel,
        rig: Sequence[RigCamera],
        space: SpaceConfig | None = None,
        config: TrackConfig | None = None,
        frame_id: str = "world",
    ) -> None:
        _check_input(model, "silhouettes")
        space = space or SpaceConfig()
        self.carver = HullCarver(rig, space)
        self.tracker = VolumePoseTracker(model, config, space.voxel, frame_id)

    def process_frame(self, silhouettes: Sequence[NDArray[np.generic] | None], stamp_ns: int) -> VolumePose:
        """Find the pose in the silhouettes of one moment.

        Parameters
        ----------
        silhouettes : sequence of (H, W) arrays or None
            One per camera; None where it brought none. An empty one would empty the whole space; where
            most of the others show somebody, it is taken for a failure and has no say.
        stamp_ns : int
        """
        empty = [i for i, s in enumerate(silhouettes) if s is not None and not s.any()]
        showing = sum(s is not None for s in silhouettes) - len(empty)
        wrong = empty if showing >= max(LEAST_VIEWS, 2 * len(empty)) else []
        kept = [None if i in wrong else s for i, s in enumerate(silhouettes)]
        found = self.tracker.process(self.carver.carve(kept), stamp_ns)
        return replace(found, disregarded=tuple(wrong)) if wrong else found

    def reset(self) -> None:
        """Forget all earlier frames."""
        self.tracker.reset()

    def warm_up(self) -> None:
        """Compile every kernel, so that the first frame is not late."""
        images = [np.zeros((c.camera.height, c.camera.width), np.uint8) for c in self.carver.cameras]
        self.carver.carve(images)
        self.tracker.warm_up()


class DepthPipeline:
    """From the images of one or more depth cameras to poses.

    The images show the person only: everything else in the space is 0.

    Parameters
    ----------
    model : VolumeModel
        Learned from depth; it serves any number of cameras.
    rig : sequence of RigCamera
        At least one.
    space : SpaceConfig
    config : TrackConfig
    frame_id : str
    """

    def __init__(
        self,
        model: VolumeModel,
        rig: Sequence[RigCamera],
        space: SpaceConfig | None = None,
        config: TrackConfig | None = None,
        frame_id: str = "world",
    ) -> None:
        _check_input(model, "depth")
        if not rig:
            raise ConfigError("a model of depth needs at least one camera")
        space = space or SpaceConfig()
        self.rig, self._voxels = tuple(rig), SurfaceVoxels(space)
        self.tracker = VolumePoseTracker(model, config, space.voxel, frame_id)

    def process_frame(self, depths: Sequence[NDArray[np.generic] | None], stamp_ns: int) -> VolumePose:
        """Find the pose in the depth images of one moment, metres; None where a camera brought none."""
        if len(depths) != len(self.rig):
            raise InputError(f"{len(depths)} depth images for {len(self.rig)} cameras")
        points: list[Array | None] = []
        for depth, c in zip(depths, self.rig, strict=True):
            if depth is not None and depth.shape != (c.camera.height, c.camera.width):
                raise InputError(
                    f"the depth image of {c.name} is {depth.shape[1]} x {depth.shape[0]}; "
                    f"its camera's are {c.camera.width} x {c.camera.height}"
                )
            points.append(None if depth is None else c.to_world(depth_points(depth, c)))
        return self.process_points(points, stamp_ns)

    def process_points(self, points_world: Sequence[Array | None], stamp_ns: int) -> VolumePose:
        """Find the pose in the person's points.

        Parameters
        ----------
        points_world : sequence of (N, 3) arrays or None
            Of each camera, world frame, metres; None where it brought nothing. A camera that sees much
            less of the person than another does is hidden from them, or has failed, and has no say.
        stamp_ns : int
        """
        seen = {
            i: self._voxels.see(points, camera.position)
            for i, (points, camera) in enumerate(zip(points_world, self.rig, strict=True))
            if points is not None
        }
        most = max((v.voxels for v in seen.values()), default=0)
        wrong = tuple(i for i, v in seen.items() if v.voxels < _SLIVER * most)
        volume = self._voxels.join([v for i, v in seen.items() if i not in wrong])
        found = self.tracker.process(volume, stamp_ns)
        return replace(found, disregarded=wrong) if wrong else found

    def reset(self) -> None:
        """Forget all earlier frames."""
        self.tracker.reset()

    def warm_up(self) -> None:
        """Compile every kernel, so that the first frame is not late."""
        self._voxels.see(np.ones((1, 3)), np.zeros(3))
        self.tracker.warm_up()


def make_pipeline(
    model: VolumeModel,
    rig: Sequence[RigCamera],
    space: SpaceConfig | None = None,
    config: TrackConfig | None = None,
    frame_id: str = "world",
) -> SilhouettePipeline | DepthPipeline:
    """Make the pipeline for what a model was learned from."""
    if model.meta["input"] == "depth":
        return DepthPipeline(model, rig, space, config, frame_id)
    return SilhouettePipeline(model, rig, space, config, frame_id)


def _check_input(model: VolumeModel, kind: str) -> None:
    if model.meta["input"] != kind:
        raise ConfigError(
            f"the model was learned from {model.meta['input']}, not from {kind}; "
            f"make one with 'depth-pose volume train --input {kind}'"
        )
