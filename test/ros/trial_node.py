"""A node on the real base whose stage is simple: for tests of queues and parameters.

An image on ``a`` gives a Header on ``answer``: the stamp, and the reduced
height that `segment.working_height` asks for. A width of 13 raises, as a bug would. Heights from 900 take
half a second to be set.
"""

import sys
import time

from sensor_msgs.msg import Image
from std_msgs.msg import Header

from depth_pose.ros.messages.basics import ns_to_stamp
from depth_pose.ros.nodes.node_base import Input, StageNode
from depth_pose.ros.process.runner import run_node
from depth_pose.ros.setting import Setting


class Halver:
    def __init__(self, config):
        self.height = config.working_height
        time.sleep(0.5 * (self.height >= 900))
        self.resets = 0

    def warm_up(self):
        time.sleep(0.2)

    def reset(self):
        self.resets += 1


class TrialNode(StageNode):
    SECTIONS = ("segment",)
    SETTINGS = (Setting("bank", "", "seconds that a frame takes"),)

    def __init__(self):
        super().__init__("trial")

    def make_stage(self, config):
        return Halver(config.segment)

    def open_outputs(self):
        self.out = self.publisher(Header, "answer")

    def inputs(self):
        return [Input(Image, "a", sensor=True)]

    def answer(self, a):
        if a.width == 13:
            raise RuntimeError("thirteen")
        time.sleep(float(self.value("bank") or 0))
        stamp = ns_to_stamp(a.header.stamp.sec * 10**9 + a.header.stamp.nanosec)
        self.out.publish(Header(stamp=stamp, frame_id=f"{self.stage.height} {self.stage.resets}"))


if __name__ == "__main__":
    print("imports done", flush=True)
    sys.exit(run_node(TrialNode))
