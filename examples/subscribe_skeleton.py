"""Listen to everybody's skeletons: needs rclpy and depth_pose_msgs, nothing else of depth_pose.

python examples/subscribe_skeleton.py
"""

import rclpy
from depth_pose_msgs.msg import Joint, SkeletonArray
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data


class Listener(Node):
    def __init__(self):
        super().__init__("skeleton_listener")
        self.create_subscription(SkeletonArray, "/depth_pose/skeletons", self.listen, qos_profile_sensor_data)

    def listen(self, frame):
        if not frame.skeletons:
            print("nobody", flush=True)
        for skeleton in frame.skeletons:
            joints = {joint.name: joint for joint in skeleton.joints}
            hand = joints["right_wrist"]
            if hand.confidence < 0.5 or hand.state == Joint.OUTSIDE_IMAGE:
                print(f"{skeleton.body_id}: right hand not seen", flush=True)
                continue
            at = hand.position  # metres; x right, y down, z away from the camera, in frame.header.frame_id
            print(f"{skeleton.body_id}: right hand at {at.x:.2f} {at.y:.2f} {at.z:.2f}", flush=True)


def main():
    rclpy.init()
    try:
        rclpy.spin(Listener())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass


if __name__ == "__main__":
    main()
