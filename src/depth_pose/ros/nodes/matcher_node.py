"""Node: people -> exemplars with similar poses, ``/depth_pose/match``."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from depth_pose_msgs.msg import Packed

from depth_pose.core.config import PipelineConfig
from depth_pose.match.match import Matcher, match_confidence
from depth_pose.ros.messages.matches import matches_to_msg
from depth_pose.ros.messages.people import msg_to_people
from depth_pose.ros.nodes.bank_node import BankNode
from depth_pose.ros.nodes.node_base import Input
from depth_pose.ros.nodes.parameters import MATCHER
from depth_pose.ros.process.runner import run_node
from depth_pose.stages import StageFactory


class MatcherNode(BankNode):
    """Finds similar exemplars in the bank (Sec. 5)."""

    LOGS_BUSY = False
    SECTIONS = ("build",)
    SETTINGS = MATCHER
    needs_views = True

    def __init__(self) -> None:
        super().__init__("matcher")

    def make_stage(self, config: PipelineConfig) -> Matcher:
        """Build the matcher; live, its time is limited."""
        matcher = StageFactory(self.bank, config).make_matcher()
        matcher.time_budget.limit_s = 0.0 if self.lossless else self.value("time_budget")
        return matcher

    def open_outputs(self) -> None:
        """Create the publisher of the matches."""
        self._matches = self.publisher(Packed, "match")

    def inputs(self) -> Sequence[Input]:
        """Subscribe to the people."""
        return [Input(Packed, "people")]

    def answer(self, message: Packed) -> None:
        """Match the people of one frame."""
        people = msg_to_people(message)
        matches = self.stage.match(people)
        self._matches.publish(matches_to_msg(matches, people))
        self.statistics.values["people"] = len(matches)
        self.statistics.values["people skipped for lack of time"] = self.stage.time_budget.left_out
        best = [m for m in matches if m.candidates][:1]
        for match in best:
            self.statistics.values["match_score"] = match.candidates[0].score
            self.statistics.values["match_confidence"] = match_confidence(match.candidates[0].score)
            self.statistics.values["match_scale"] = match.scale


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until a stop signal; return the exit code."""
    return run_node(MatcherNode, args)


if __name__ == "__main__":
    sys.exit(main())
