"""Node: the person's points -> the exemplars that may show the pose, ``/depth_pose/match``."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from depth_pose_msgs.msg import PoseMatch
from sensor_msgs.msg import PointCloud2

from depth_pose.core.config import PipelineConfig
from depth_pose.ros.nodes.bank_node import BankNode
from depth_pose.ros.nodes.node_base import Input
from depth_pose.ros.nodes.parameters import BANK
from depth_pose.ros.nodes.warm_stages import make
from depth_pose.ros.process.runner import run_node
from depth_pose.ros.transport.conversions import match_to_msg, msg_to_cloud
from depth_pose.steps.match import Matcher, match_confidence


class MatcherNode(BankNode):
    """Finds similar exemplars in the bank (Sec. 5)."""

    SECTIONS = ("match", "fit")
    SETTINGS = (BANK,)

    def __init__(self) -> None:
        super().__init__("matcher")

    def make_stage(self, config: PipelineConfig) -> Matcher:
        """Make the matcher."""
        return make(Matcher, self.bank, config.match, config.fit)

    def open_outputs(self) -> None:
        """Publish the match."""
        self._matches = self.publisher(PoseMatch, "match")

    def inputs(self) -> Sequence[Input]:
        """Listen to the person's points."""
        return [Input(PointCloud2, "points")]

    def answer(self, points: PointCloud2) -> None:
        """Match one frame."""
        match = self.stage.match(msg_to_cloud(points))
        self._matches.publish(match_to_msg(match))
        self.figures.values["match_candidates"] = len(match.candidates)
        if match.candidates:
            self.figures.values["match_score"] = match.candidates[0].score
            self.figures.values["match_confidence"] = match_confidence(match.candidates[0].score)
            self.figures.values["match_scale"] = match.scale


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until it is asked to stop; gives the exit code."""
    return run_node(MatcherNode, args)


if __name__ == "__main__":
    sys.exit(main())
