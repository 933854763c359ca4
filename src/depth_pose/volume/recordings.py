"""Offline runs of the volume tracker: recorded silhouettes or depth images to skeletons."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.errors import InputError
from depth_pose.core.rotations import matrix_to_quat, quat_to_matrix
from depth_pose.core.types import Skeleton
from depth_pose.io._messages import read_image, write_image
from depth_pose.io._recording import Recording
from depth_pose.io.decode import decode_depth
from depth_pose.io.mcap_write import SkeletonWriter, _RecordingWriter
from depth_pose.io.schemas import IMAGE
from depth_pose.motion.clip import Clip
from depth_pose.sim.roof_cameras import RigRenderer
from depth_pose.sim.simulate import START_NS
from depth_pose.volume.pipeline import DepthPipeline, SilhouettePipeline
from depth_pose.volume.rig import RigCamera
from depth_pose.volume.rigfile import Rig, save_rig, upright_from
from depth_pose.volume_learn.performances import Wearer, dressed_frames

Image = NDArray[np.generic]

LATE_S = 0.005
"""Images of one moment carry stamps that differ by at most this."""


def decode_silhouette(
    data: bytes | memoryview, height: int, width: int, step: int, encoding: str
) -> NDArray[np.uint8]:
    """Read a silhouette image: ``mono8`` or ``8UC1``, not 0 where the person is.

    Raises
    ------
    InputError
        Where the encoding is another, or the data are too short.
    """
    if encoding not in ("mono8", "8UC1"):
        raise InputError(f"the silhouette's encoding is {encoding!r}; it must be mono8 or 8UC1")
    if min(height, width) < 1 or step < width or len(data) < height * step:
        raise InputError(
            f"the silhouette is {width} x {height} with rows of {step} bytes, but has {len(data)} bytes"
        )
    return np.frombuffer(data, np.uint8, height * step).reshape(height, step)[:, :width]


def read_moments(
    recording: Recording, topics: Sequence[str], depth: bool
) -> Iterator[tuple[int, list[Image | None]]]:
    """Give the images of each moment, None for a camera that brought none; in the order of stamps."""
    missing = [t for t in topics if t not in recording.topics]
    if len(missing) == len(topics):
        there = ", ".join(sorted(recording.topics)) or "none"
        raise InputError(f"{recording.path} has none of the rig's topics; its topics are {there}")
    index = {topic: i for i, topic in enumerate(topics)}
    held: dict[int, list[Image | None]] = {}
    newest = -1
    for message in recording.messages(*(t for t in topics if t not in missing)):
        image = read_image(message.data)
        size = (image.height, image.width, image.step, image.encoding)
        pixels: Image = decode_depth(image.data, *size) if depth else decode_silhouette(image.data, *size)
        near = [s for s in held if abs(s - image.stamp_ns) <= LATE_S * 1e9]
        stamp = near[0] if near else image.stamp_ns
        held.setdefault(stamp, [None] * len(topics))[index[message.topic]] = pixels
        newest = max(newest, stamp)
        for done in sorted(s for s in held if newest - s > 0.2e9):
            yield done, held.pop(done)
    for stamp in sorted(held):
        yield stamp, held[stamp]


@dataclass(frozen=True)
class VolumeRun:
    """What an offline run did.

    Attributes
    ----------
    frames, answered : int
        Moments of the recording, and those with somebody in them.
    incomplete : int
        Moments in which a camera was missing.
    median_ms, p95_ms : float
        Time per frame from images to pose, milliseconds.
    refused : mapping of str to int
        Frames that could not be used, by reason.
    """

    frames: int
    answered: int
    incomplete: int
    median_ms: float
    p95_ms: float
    refused: dict[str, int]


def process_silhouettes(
    path: Path,
    output: Path,
    pipeline: SilhouettePipeline | DepthPipeline,
    rig: Rig,
    progress: Callable[[int], None] | None = None,
) -> VolumeRun:
    """Run a pipeline over a recording and write its skeletons, in the rig's world frame."""
    recording = Recording(path)
    pipeline.reset()
    times, counts, refused = [], Counter[str](), Counter[str]()
    with SkeletonWriter(output) as writer:
        for stamp_ns, images in read_moments(recording, rig.topics, isinstance(pipeline, DepthPipeline)):
            start = time.perf_counter()
            try:
                skeleton = pipeline.process_frame(images, stamp_ns).skeleton
            except InputError as error:
                refused[str(error)] += 1
                continue
            times.append((time.perf_counter() - start) * 1e3)
            writer.write(in_world(skeleton, rig.up))
            counts["frames"] += 1
            counts["answered"] += not skeleton.is_lost
            counts["incomplete"] += any(i is None for i in images)
            if progress is not None:
                progress(counts["frames"] + refused.total())
    if not times:
        reason = next(iter(refused), "no images")
        raise InputError(f"{path}: no frame can be used: {reason}")
    return VolumeRun(
        counts["frames"] + refused.total(), counts["answered"], counts["incomplete"],
        float(np.median(times)), float(np.percentile(times, 95)), dict(refused),
    )  # fmt: skip


def in_world(skeleton: Skeleton, up: str) -> Skeleton:
    """Give a skeleton of the tracker's world frame in one with another axis up."""
    if up == "y" or skeleton.is_lost:
        return skeleton
    turn = upright_from(up)[:3, :3].T
    rotations = turn @ quat_to_matrix(skeleton.quats_xyzw)
    return replace(skeleton, positions=skeleton.positions @ turn.T, quats_xyzw=matrix_to_quat(rotations))


class MomentWriter(_RecordingWriter):
    """Writes the images of several cameras."""

    def write(self, topic: str, stamp_ns: int, frame_id: str, image: Image) -> None:
        """Add one image: uint8 for a silhouette, float32 for depth in metres."""
        self._write(topic, IMAGE, stamp_ns, write_image(stamp_ns, frame_id, image))


def record_images(
    path: Path,
    clip: Clip,
    wearer: Wearer,
    cameras: Sequence[RigCamera],
    kind: str,
    progress: Callable[[int], None] | None = None,
) -> None:
    """Record what cameras see of a performance, and write the cameras to a rig file beside it."""
    topics = [f"/{c.name}/{'silhouette' if kind == 'silhouettes' else 'depth'}" for c in cameras]
    renderer = RigRenderer(cameras)
    with MomentWriter(path) as writer:
        for i, (meshes, _) in enumerate(dressed_frames(wearer, clip)):
            seen = renderer.silhouettes(meshes) if kind == "silhouettes" else renderer.depths(meshes)
            stamp_ns = START_NS + round(i * 1e9 / clip.fps)
            for camera, topic, image in zip(cameras, topics, seen, strict=True):
                writer.write(topic, stamp_ns, camera.name, np.asarray(image))
            if progress is not None:
                progress(i + 1)
    save_rig(path.with_suffix(".yaml"), cameras, topics)
