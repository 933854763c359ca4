"""Send everybody's joints as OSC, for Unity, TouchDesigner, Max and friends: needs python-osc.

pip install python-osc
python examples/osc_sender.py --host 127.0.0.1 --port 9000

For every person of every frame one bundle of messages:

    /depth_pose/BODY/JOINT   x y z confidence      metres; x right, y up, z away from the sensor (as in Unity)

and for every frame, so that a receiver knows who has left:

    /depth_pose/people       BODY BODY ...
"""

import argparse

import rclpy
from depth_pose_msgs.msg import SkeletonArray
from pythonosc.osc_bundle_builder import IMMEDIATELY, OscBundleBuilder
from pythonosc.osc_message_builder import OscMessageBuilder
from pythonosc.udp_client import UDPClient
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data


def message(address, *values):
    built = OscMessageBuilder(address)
    for value in values:
        built.add_arg(value)
    return built.build()


def bundle(messages):
    built = OscBundleBuilder(IMMEDIATELY)
    for one in messages:
        built.add_content(one)
    return built.build()


class Sender(Node):
    def __init__(self, client):
        super().__init__("osc_sender")
        self.client = client
        self.create_subscription(SkeletonArray, "/depth_pose/skeletons", self.send, qos_profile_sensor_data)

    def send(self, frame):
        self.client.send(message("/depth_pose/people", *[s.body_id for s in frame.skeletons]))
        for skeleton in frame.skeletons:
            self.client.send(
                bundle(
                    message(
                        f"/depth_pose/{skeleton.body_id}/{joint.name}",
                        joint.position.x,
                        -joint.position.y,  # y down in the optical frame, up in Unity's
                        joint.position.z,
                        joint.confidence,
                    )
                    for joint in skeleton.joints
                )
            )


def main():
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    options.add_argument("--host", default="127.0.0.1")
    options.add_argument("--port", type=int, default=9000)
    chosen = options.parse_args()
    rclpy.init()
    try:
        rclpy.spin(Sender(UDPClient(chosen.host, chosen.port)))
    except (KeyboardInterrupt, ExternalShutdownException):
        pass


if __name__ == "__main__":
    main()
