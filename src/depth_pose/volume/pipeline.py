"""The method of Hirai, Ukita and Kidode as a whole, from images to joint angles.

`VolumePoseTracker` goes from volumes to poses, `VolumePipeline` from images.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import ThreadpoolController

from depth_pose.body.angles import angles_from_rotations
from depth_pose.body.procedural import make_body
from depth_pose.core.config import MAX_STAMP_GAP_NS
from depth_pose.core.result import Skeleton
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
from depth_pose.rooms.rigfile import Rig, upright_from
from depth_pose.volume.config import VolumeConfig
from depth_pose.volume.descriptor import heading_angle
from depth_pose.volume.eyes import make_eyes
from depth_pose.volume.fit import VolumeFitter
from depth_pose.volume.headings import turns
from depth_pose.volume.hull import Volume
from depth_pose.volume.model import VolumeModel
from depth_pose.volume.stature import StatureFinder
from depth_pose.volume.synchroniser import ViewSet
from depth_pose.volume.tracker import UNLIKELY, LatentTracker, Tracked, describe_headings
from depth_pose.volume.tuning import VolumeTuning

Array = NDArray[np.float64]

_one_thread = ThreadpoolController().wrap(limits=1)
"""Threads for linear algebra, as in `depth_pose.pipeline`: small systems gain nothing from more, and the
order of sums stays fixed."""

LEAST_SURFACE_M2 = 0.06
"""Minimum surface of a person (m^2): 150 voxels of 2 cm; a person has 3,000. Set by hand."""


@dataclass(frozen=True)
class VolumePose:
    """Result of one frame.

    Attributes
    ----------
    volume : Volume
    tracked : Tracked or None
        The volume's position in the latent space; None for an empty space.
    regressed : (21, 3, 3) float64
        Segment rotations of the latent point, rest pose to world frame.
    rotations : (21, 3, 3) float64
        The same after the fit to the volume.
    stature : float
        Metres.
    skeleton : Skeleton
        World frame; source VOLUME, or LOST for an empty space.
    disregarded : tuple of int
        Cameras that showed little or nothing of the person while others did.
    """

    volume: Volume
    tracked: Tracked | None
    regressed: Array
    rotations: Array
    stature: float
    skeleton: Skeleton
    disregarded: tuple[int, ...] = ()

    @property
    def skeletons(self) -> tuple[Skeleton, ...]:
        """The skeletons: one, or none."""
        return () if self.skeleton.is_lost else (self.skeleton,)

    @cached_property
    def angles_deg(self) -> Array:
        """Anatomical angles, (47,), in the order of `depth_pose.body.angles.ANGLES`."""
        return angles_from_rotations(self.rotations)


class VolumePoseTracker:
    """The pipeline from volumes to poses; frames must be passed in order.

    Parameters
    ----------
    model : VolumeModel
    config : VolumeConfig
    frame_id : str
        Name of the world frame.
    tuning : VolumeTuning
    """

    def __init__(
        self,
        model: VolumeModel,
        config: VolumeConfig | None = None,
        frame_id: str = "world",
        tuning: VolumeTuning = VolumeTuning(),
    ) -> None:
        self.model, self.frame_id = model, frame_id
        self._config, self.tuning = config or VolumeConfig(), tuning
        self.config = self._config.track
        self._least = round(LEAST_SURFACE_M2 / self._config.space.voxel**2)
        self._tracker = LatentTracker(model, self.config, tuning.track)
        self._size = StatureFinder(model, self.config, tuning.track)
        self._body = make_body()
        self._fitter = VolumeFitter(self._body, model.trust, tuning.fit)
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
            if self._absent == self.tuning.track.lost_after:
                self._forget()
            return self._nobody(volume, stamp_ns)
        self._absent = 0
        stature = self._size.update(volume)
        # Sec. 4: the descriptor for all headings
        sights = describe_headings(volume, stature, self.model.bins)
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
            # details that only the volume shows: the fit of a body to it
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
        """Forget the person, before another one enters."""
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
        """Compile every kernel with a synthetic volume."""
        grid = np.stack(np.meshgrid(*[np.arange(0.0, 0.3, 0.02)] * 3), axis=-1).reshape(-1, 3)
        tall = np.concatenate([grid, grid + [0.0, 0.6, 0.0]])
        volume = Volume(tall, tall.mean(axis=0), len(tall), 8)
        other = VolumePoseTracker(self.model, self._config, self.frame_id, self.tuning)
        for stamp_ns in (1, 30_000_000):
            other.process(volume, stamp_ns)


def _joint_trust(strongest: NDArray[np.int32], trust: Array) -> Array:
    """Visibility of each joint's surroundings under the clothing, (19,), 0 to 1."""
    segment = np.array([trust[strongest == n].mean() if (strongest == n).any() else np.nan
                        for n in range(len(NODES))])  # fmt: skip
    for n in range(1, len(NODES)):
        if np.isnan(segment[n]):
            segment[n] = segment[NODE_PARENTS[n]]
    # a joint is as visible as the segments that meet in it
    joints = [(segment[n] + segment[max(int(NODE_PARENTS[n]), 0)]) / 2 for n in JOINT_NODES]
    return np.clip(np.array(joints), 0.0, 1.0)


class VolumePipeline:
    """The pipeline from the images of several cameras to poses: silhouettes or depth, as the model requires.

    Parameters
    ----------
    model : VolumeModel
        A depth model serves any number of cameras.
    rig : Rig
    config : VolumeConfig
    frame_id : str
        Name of the rig's world frame.
    """

    @_one_thread
    def __init__(
        self, model: VolumeModel, rig: Rig, config: VolumeConfig | None = None, frame_id: str = "world"
    ) -> None:
        self.rig, config = rig, config or VolumeConfig()
        self.eyes = make_eyes(model.meta["input"], rig.cameras, config)
        self.tracker = VolumePoseTracker(model, config, frame_id)
        self._disregarded: Counter[int] = Counter()

    @_one_thread
    def process_frame(self, views: ViewSet) -> VolumePose:
        """Find the pose in the views of one time; the skeleton is in the rig's world frame.

        Parameters
        ----------
        views : ViewSet
            One image per camera (silhouettes: nonzero on the person; depth: metres); None if there is
            none. A camera that shows little or nothing of the person while others do is ignored.

        Raises
        ------
        InputError
            Where there is not one image per camera, or their sizes differ from the cameras'.
        """
        volume, disregarded = self.eyes.see(views)
        self._disregarded.update(disregarded)
        found = self.tracker.process(volume, views.stamp_ns)
        return replace(found, skeleton=in_world(found.skeleton, self.rig.up), disregarded=disregarded)

    def reset(self) -> None:
        """Forget all earlier frames."""
        self.eyes.reset()
        self.tracker.reset()
        self._disregarded.clear()

    @property
    def warnings(self) -> tuple[str, ...]:
        """Cameras that showed nobody while others did, since the last reset, one line each."""
        return tuple(
            f"{self.rig.topics[camera]} shows nobody in {count} frames in which others do"
            for camera, count in self._disregarded.items()
        )

    def warm_up(self) -> None:
        """Compile every kernel, so that the first frame is not late."""
        self.eyes.warm_up()
        self.tracker.warm_up()


def in_world(skeleton: Skeleton, up: str) -> Skeleton:
    """Convert a skeleton from the tracker's world frame to one with another up axis."""
    if up == "y" or skeleton.is_lost:
        return skeleton
    return skeleton.turned(upright_from(up)[:3, :3].T, np.zeros(3), skeleton.frame_id)
