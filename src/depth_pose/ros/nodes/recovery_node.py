"""Node: people and fitted bodies -> ``/depth_pose/skeletons``, ``skeleton``, ``markers``."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from depth_pose_msgs.msg import Packed, Skeleton, SkeletonArray
from diagnostic_msgs.msg import DiagnosticStatus
from visualization_msgs.msg import MarkerArray

from depth_pose.core.config import PipelineConfig
from depth_pose.core.mount import check_upright, rotate_to_sensor, sensor_frame
from depth_pose.core.result import Skeleton as SkeletonData
from depth_pose.io.skeleton_cdr import write_people, write_skeleton
from depth_pose.recover.recover import FailureRecovery
from depth_pose.ros.messages.fits import msg_to_fitted
from depth_pose.ros.nodes.bank_node import BankNode
from depth_pose.ros.nodes.node_base import Input
from depth_pose.ros.nodes.parameters import RECOVERY
from depth_pose.ros.nodes.rep155_outputs import Rep155Outputs
from depth_pose.ros.nodes.standard_outputs import StandardOutputs
from depth_pose.ros.process.runner import run_node
from depth_pose.ros.transport.drawing import skeletons_to_markers
from depth_pose.ros.transport.tf import Transforms, skeletons_to_transforms
from depth_pose.stages import StageFactory
from depth_pose.track.follow import Follower
from depth_pose.track.nobody import NobodyWatch


class RecoveryNode(BankNode):
    """Finds failures, recovers from them over time, and smooths (Sec. 6, last part)."""

    LOGS_BUSY = False
    SECTIONS = ("mount", "recover", "smooth", "refine", "follow")
    SETTINGS = RECOVERY

    def __init__(self) -> None:
        self._is_doubt_told = False
        super().__init__("recovery")

    def make_stage(self, config: PipelineConfig) -> FailureRecovery:
        """Build the recoverer, and the selection of the followed person."""
        self._follower = Follower(config.follow)
        self._nobody = NobodyWatch()
        return StageFactory(self.bank, config).make_recoverer()

    def open_outputs(self) -> None:
        """Create the publishers for other programs: reliable, which suits every subscriber."""
        self._skeletons = self.publisher(SkeletonArray, "skeletons", reliable=True)
        self._followed = self.publisher(Skeleton, "skeleton", reliable=True, counted=False)
        self._markers = self.publisher(MarkerArray, "markers", reliable=True, counted=False)
        prefix = self.value("tf_prefix")
        self._transforms = Transforms(self, "the parameter tf") if self.value("tf") else None
        self._rep155 = Rep155Outputs(self, self.bank.body, prefix) if self.value("rep155") else None
        self._others = StandardOutputs(self, "detections")

    def inputs(self) -> Sequence[Input]:
        """Subscribe to the people with the bodies fitted to them."""
        return [Input(Packed, "skeletons_refined")]

    def answer(self, message: Packed) -> None:
        """Check, recover and smooth the people of one frame."""
        people, fitted = msg_to_fitted(message, len(self.bank.body.vertices))
        mount = self.config.mount
        check_upright(people.frame_id, mount)
        upright = self.stage.recover(people, fitted)
        skeletons = [rotate_to_sensor(s, mount) for s in upright]
        frame_id = sensor_frame(people.frame_id, mount)
        self._skeletons.publish(write_people(skeletons, people.stamp_ns, frame_id))
        followed = self._follower.choose(skeletons, people.stamp_ns, frame_id)
        self._followed.publish(write_skeleton(followed))
        if self._markers.get_subscription_count():
            self._markers.publish(skeletons_to_markers(skeletons, people.stamp_ns, frame_id))
        if self._transforms is not None and self._transforms.is_heard:
            self._transforms.publish(skeletons_to_transforms(skeletons, followed, self.value("tf_prefix")))
        if self._rep155 is not None:
            self._rep155.publish(skeletons, people.stamp_ns, frame_id, upright, people.camera)
        self._others.publish(skeletons, people.stamp_ns, frame_id)
        if people.persons:
            self._nobody.look(None, is_found=True, is_answered=bool(skeletons), rejected={})
        self._note(followed, len(skeletons))

    def judge(self) -> tuple[bytes, str]:
        """Return the level and the text of this second's diagnostics, with why nobody is answered."""
        level, words = super().judge()
        if level == DiagnosticStatus.OK and self.is_active and self._nobody.doubt:
            return DiagnosticStatus.WARN, self._nobody.doubt
        return level, words

    def _note(self, followed: SkeletonData, people: int) -> None:
        """Update the values for ``/diagnostics``, and log once why nobody is answered."""
        if self._nobody.doubt and not self._is_doubt_told:
            self._is_doubt_told = True
            self.get_logger().warning(self._nobody.doubt)
        self.statistics.counts[f"source {followed.source.name}"] += 1
        self.statistics.values["people"] = people
        self.statistics.values["confidence"] = followed.confidence
        self.statistics.values["residual_m"] = followed.residual
        self.statistics.values["recoveries"] = self.stage.recoveries
        self.statistics.values["found, pose doubtful"] = self.stage.doubtful
        for kind, count in self.stage.failures.items():
            self.statistics.values[f"failures {kind}"] = count


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until a stop signal; return the exit code."""
    return run_node(RecoveryNode, args)


if __name__ == "__main__":
    sys.exit(main())
