"""Node: people's points and matches -> fitted bodies, ``/depth_pose/skeletons_refined``, and ``mesh``."""

from __future__ import annotations

import sys
import time
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

from depth_pose_msgs.msg import FittedArray, People, PoseMatchArray, SkeletonArray
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import Marker

from depth_pose.body.build_file import load_build
from depth_pose.core.config import PipelineConfig
from depth_pose.core.mount import check_turned, turn_forth
from depth_pose.refine.refine import Refiner
from depth_pose.ros.messages.basics import stamp_to_ns
from depth_pose.ros.messages.checks import check_people
from depth_pose.ros.messages.matches import msg_to_matches
from depth_pose.ros.messages.people import msgs_to_people
from depth_pose.ros.messages.skeletons import fitted_to_msg, msg_to_skeleton
from depth_pose.ros.nodes.bank_node import BankNode
from depth_pose.ros.nodes.node_base import Held, Input
from depth_pose.ros.nodes.parameters import REFINE
from depth_pose.ros.process.runner import run_node
from depth_pose.ros.process.warm_stages import make
from depth_pose.ros.transport.drawing import mesh_to_marker

PATIENCE_S = 2.0
"""How long a lossless node waits for what recovery made of the frame before."""


class RefineNode(BankNode):
    """Fits the body to the points, from the matched exemplars (Sec. 6).

    It hears what the recovery node makes of its skeletons: a recovered pose is one more start for
    the next frame. Live, that is taken if it comes in time. A lossless node begins a frame only
    when the one before is answered, so that a replay gives the same skeletons every time.
    """

    SECTIONS = ("mount", "refine", "match", "fit", "build", "cpd", "completion")
    SETTINGS = REFINE

    def __init__(self) -> None:
        self._next_mesh_s = 0.0
        self._held: deque[tuple[Any, ...]] = deque()
        self._awaited_ns: int | None = None
        self._awaited_since_s = 0.0
        super().__init__("refine")
        if self.lossless:
            self.create_timer(0.25 * PATIENCE_S, self._go_on, clock=self._steady)

    def make_stage(self, config: PipelineConfig) -> Refiner:
        """Make the refiner."""
        return make(Refiner, self.bank, config.refine, config.match, config.fitting)

    def check_config(self, config: PipelineConfig, changes: Mapping[str, Any]) -> None:
        """Refuse a build that cannot be read."""
        if changes.get("build"):
            load_build(config.build.file)

    def open_outputs(self) -> None:
        """Publish the fitted bodies, and their meshes while somebody listens."""
        self._fitted = self.publisher(FittedArray, "skeletons_refined")
        self._meshes = self.publisher(Marker, "mesh", reliable=True, counted=False)

    def inputs(self) -> Sequence[Input]:
        """Pair the points with their matches; hear the answers of the recovery node."""
        self._answers = self.listen(SkeletonArray, "skeletons", self._take_answer)
        return [Input(PointCloud2, "points"), Input(People, "people"), Input(PoseMatchArray, "match")]

    def forget(self) -> None:
        """Drop the frames that wait for the answer to the one before."""
        self._held.clear()
        self._awaited_ns = None

    def answer(self, points: PointCloud2, found: People, matches: PoseMatchArray) -> None:
        """Fit the people of one frame."""
        if self.lossless and self._awaited_ns is not None and self._answers.get_publisher_count():
            self._held.append((points, found, matches))
            raise Held
        people = msgs_to_people(points, found)
        check_turned(people.frame_id, self.config.mount)
        fitted = self.stage.refine(people, msg_to_matches(matches))
        self._awaited_ns, self._awaited_since_s = people.stamp_ns, time.monotonic()
        self._fitted.publish(fitted_to_msg(fitted, people))
        self.figures.values["people"] = len(fitted)
        for f in fitted[:1]:
            self.figures.values["confidence"] = f.skeleton.confidence
            self.figures.values["residual_m"] = f.skeleton.residual
        self._publish_meshes(people.stamp_ns, people.frame_id)

    def _take_answer(self, message: SkeletonArray) -> None:
        """Learn what became of the last frame; later frames' starts depend on it."""
        if not self.is_active or stamp_to_ns(message.header.stamp) != self._awaited_ns:
            return
        self._awaited_ns = None
        try:
            check_people("skeletons", [s.body_id for s in message.skeletons])
            answers = [turn_forth(msg_to_skeleton(s), self.config.mount) for s in message.skeletons]
            self.stage.take_answer(answers)
        finally:  # whatever the answer was, frames wait for it
            self._begin_held()

    def _go_on(self) -> None:
        """Do without an answer that does not come."""
        if self._awaited_ns is not None and time.monotonic() - self._awaited_since_s > PATIENCE_S:
            self._awaited_ns = None
            self.figures.counts["not answered by recovery"] += 1
            self._begin_held()

    def _begin_held(self) -> None:
        while self._held and self._awaited_ns is None:
            self.process(self._held.popleft())

    def _publish_meshes(self, stamp_ns: int, frame_id: str) -> None:
        rate, now = self.value("mesh_rate"), time.monotonic()
        if rate <= 0.0 or now < self._next_mesh_s or not self._meshes.get_subscription_count():
            return
        if self.stage.meshes:
            self._next_mesh_s = now + 1.0 / rate
        for number, vertices in enumerate(self.stage.meshes.values()):
            marker = mesh_to_marker(vertices, self.bank.body.faces, stamp_ns, frame_id, number)
            self._meshes.publish(marker)


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until it is asked to stop; gives the exit code."""
    return run_node(RefineNode, args)


if __name__ == "__main__":
    sys.exit(main())
