"""Recordings of a virtual sensor that sees a moving person, with known joints.

The truth file beside a recording holds ``joints`` (T, 19, 3) float32 in the optical frame,
metres; ``quats_xyzw`` (T, 19, 4) float32, rotation of the segment that begins at each joint, rest pose to
optical frame; ``names``; ``stamps_ns`` (T,); ``seen`` (T, 19), whether the joint is on the side of the
body that the camera sees; ``K`` (3, 3); ``box`` (6,), least and greatest x, y, z of the
body over the whole clip.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.errors import ConfigError
from depth_pose.core.outputs import new_file
from depth_pose.core.rotations import matrix_to_quat
from depth_pose.core.skeleton import ADULT_STATURE_M, JOINT_NODES, JOINTS, NODE_INDEX, rest_nodes
from depth_pose.io.mcap_write import DepthWriter
from depth_pose.sim.config import Placement, Room
from depth_pose.sim.placement import camera_pose, room_mesh
from depth_pose.sim.sensor import SENSORS, Mesh, SensorModel, VirtualSensor

if TYPE_CHECKING:
    from depth_pose.body.body import Body
    from depth_pose.motion.clip import Clip

FRAME_ID = "camera_depth_optical_frame"
START_NS = 1_700_000_000_000_000_000
"""Stamp of the first frame of every simulated recording."""
_JOINT_DEPTH_M = 0.2
"""A joint lies at most this far below the visible skin in front of it, metres."""


@dataclass(frozen=True)
class Truth:
    """The known joints of a simulated recording, as its truth file holds them.

    Attributes
    ----------
    joints : (T, 19, 3) float32
        Optical frame, metres.
    quats_xyzw : (T, 19, 4) float32
        Rotation of the segment that begins at each joint, rest pose to optical frame.
    stamps_ns : (T,) int64
    seen : (T, 19) bool
    K : (3, 3) float64
    box : (6,) float64
        Least and greatest x, y, z of the body, metres.
    """

    joints: NDArray[np.float32]
    quats_xyzw: NDArray[np.float32]
    stamps_ns: NDArray[np.int64]
    seen: NDArray[np.bool_]
    K: NDArray[np.float64]
    box: NDArray[np.float64]

    def save(self, stream: BinaryIO) -> None:
        """Write the truth file."""
        np.savez_compressed(
            stream,
            joints=self.joints,
            quats_xyzw=self.quats_xyzw,
            stamps_ns=self.stamps_ns,
            names=np.array(JOINTS),
            seen=self.seen,
            K=self.K,
            box=self.box,
        )


@dataclass(frozen=True)
class Stage:
    """Recording setup: sensor, camera placement and room."""

    sensor: SensorModel = field(default_factory=lambda: SENSORS["tof"])
    placement: Placement = field(default_factory=Placement)
    room: Room = field(default_factory=Room)


def simulate(
    path: Path | str,
    body: Body,
    clip: Clip,
    stage: Stage | None = None,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> Truth:
    """Record a virtual sensor that watches a body move.

    Parameters
    ----------
    path : Path or str
        The recording, ``NAME.mcap``; the truth goes to ``NAME.npz`` beside it.
    body : Body
        The person's body.
    clip : Clip
        The person's motion; its frames are the sensor's frames.
    stage : Stage, optional
        Sensor, camera placement and room; the time-of-flight sensor in front of a wall.
    seed : int
        Of the noise.
    progress : callable, optional
        Called with the number of frames done and of all.

    Returns
    -------
    Truth
        The content of ``NAME.npz``.
    """
    path = Path(path)
    if path.suffix != ".mcap":
        raise ConfigError(f"{path} must be a recording: its name must end in .mcap")
    stage = stage or Stage()
    sensor = VirtualSensor(stage.sensor, seed)
    roots = clip.roots * root_scale(body)
    target = 0.5 * (roots.min(axis=0) + roots.max(axis=0))
    T_camera_model = camera_pose(stage.placement, target)
    room_vertices, room_faces = room_mesh(stage.room, stage.placement, target)
    room: Mesh = (transform(T_camera_model, room_vertices), room_faces)
    frames = len(roots)
    stamps = START_NS + np.rint(np.arange(frames) * 1e9 / stage.sensor.fps).astype(np.int64)
    joints = np.zeros((frames, len(JOINTS), 3))
    quats = matrix_to_quat(T_camera_model[:3, :3] @ clip.rotations[:, JOINT_NODES])
    seen = np.zeros((frames, len(JOINTS)), bool)
    box = np.array([[np.inf] * 3, [-np.inf] * 3])
    camera = stage.sensor.camera
    with new_file(path.with_suffix(".npz")) as beside, DepthWriter(path, camera, FRAME_ID) as writer:
        for i in range(frames):
            posed = body.pose(clip.rotations[i], roots[i])
            vertices = transform(T_camera_model, posed.vertices)
            meshes = [(vertices, body.faces), room]
            writer.write(int(stamps[i]), sensor.render(meshes))
            joints[i] = transform(T_camera_model, posed.nodes[JOINT_NODES])
            seen[i] = sensor.sees(joints[i], meshes, _JOINT_DEPTH_M)
            box = np.array(
                [np.minimum(box[0], vertices.min(axis=0)), np.maximum(box[1], vertices.max(axis=0))]
            )
            if progress:
                progress(i + 1, frames)
        truth = Truth(
            joints=joints.astype(np.float32),
            quats_xyzw=quats.astype(np.float32),
            stamps_ns=stamps,
            seen=seen,
            K=camera.matrix(),
            box=box.ravel(),
        )
        truth.save(beside)
    return truth


def root_scale(body: Body) -> float:
    """Return the scale from a clip's root path, made for the reference adult, to a body's own."""
    pelvis = NODE_INDEX["pelvis"]
    return float(body.nodes[pelvis, 1] / (rest_nodes()[pelvis, 1] * ADULT_STATURE_M))


def transform(T: NDArray[np.float64], points: NDArray[np.floating]) -> NDArray[np.float64]:
    """Apply a rigid transform (4, 4) to points (..., 3)."""
    moved: NDArray[np.float64] = points.astype(np.float64) @ T[:3, :3].T + T[:3, 3]
    return moved
