"""People who perform a motion in a garment: their meshes, and recordings of cameras around them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.body import PosedBody
from depth_pose.body.procedural import BodyShape, make_body
from depth_pose.io.mcap_write import RecordingWriter
from depth_pose.io.messages import write_image
from depth_pose.io.schemas import IMAGE
from depth_pose.motion.clip import Clip
from depth_pose.rooms.rig import RigCamera
from depth_pose.rooms.rigfile import save_rig
from depth_pose.sim.clothing import Clothes, Garment
from depth_pose.sim.roof_cameras import RigRenderer
from depth_pose.sim.sensor import Mesh
from depth_pose.sim.simulate import START_NS, root_scale


@dataclass(frozen=True)
class Wearer:
    """A performer.

    Attributes
    ----------
    shape : BodyShape
    garment : Garment or None
    """

    shape: BodyShape
    garment: Garment | None = None


def dressed_frames(wearer: Wearer, clip: Clip) -> Iterator[tuple[list[Mesh], PosedBody]]:
    """Meshes of every frame of a motion on a wearer, world frame, and the posed body."""
    body = make_body(wearer.shape)
    clothes = Clothes(wearer.garment, body) if wearer.garment is not None else None
    for rotations, root in zip(clip.rotations, clip.roots * root_scale(body), strict=True):
        posed = body.pose(rotations, root)
        meshes: list[Mesh] = [(posed.vertices, body.faces)]
        if clothes is not None:
            meshes.append((clothes.step(posed.nodes, rotations, 1.0 / clip.fps), clothes.faces))
        yield meshes, posed


class ViewWriter(RecordingWriter):
    """Writer of the images of several cameras."""

    def write(self, topic: str, stamp_ns: int, frame_id: str, image: NDArray[np.generic]) -> None:
        """Add one image: uint8 for a silhouette, float32 for depth in metres."""
        self.write_message(topic, IMAGE, stamp_ns, write_image(stamp_ns, frame_id, image))


def record_views(
    path: Path,
    clip: Clip,
    wearer: Wearer,
    cameras: Sequence[RigCamera],
    kind: str,
    progress: Callable[[int], None] | None = None,
) -> None:
    """Record a performance with several cameras, and write the cameras to a rig file beside it.

    ``kind`` is ``silhouettes`` or ``depth``.
    """
    topics = [f"/{c.name}/{'silhouette' if kind == 'silhouettes' else 'depth'}" for c in cameras]
    renderer = RigRenderer(cameras)
    with ViewWriter(path, only_whole=True) as writer:
        for i, (meshes, _) in enumerate(dressed_frames(wearer, clip)):
            stamp_ns = START_NS + round(i * 1e9 / clip.fps)
            for camera, topic, image in zip(cameras, topics, renderer.images(meshes, kind), strict=True):
                writer.write(topic, stamp_ns, camera.name, image)
            if progress is not None:
                progress(i + 1)
    save_rig(path.with_suffix(".yaml"), cameras, topics)
