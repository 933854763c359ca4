"""A camera driver that knows nothing of depth_pose: plain rclpy, Fast DDS's own settings.

``stock_driver.py reliable|best_effort COUNT``
"""

import array
import sys
import time

import rclpy
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo, Image

RATE_HZ, WIDTH, HEIGHT, FRAME_ID = 30.0, 640, 480, "camera"


def main(reliability, count):
    rclpy.init()
    node = rclpy.create_node("driver")
    qos = QoSProfile(depth=5, reliability=ReliabilityPolicy[reliability.upper()])
    images = node.create_publisher(Image, "/camera/depth/image_raw", qos)
    infos = node.create_publisher(CameraInfo, "/camera/depth/camera_info", qos)
    info = CameraInfo(width=WIDTH, height=HEIGHT, k=[525.0, 0.0, 319.5, 0.0, 525.0, 239.5, 0.0, 0.0, 1.0])
    image = Image(width=WIDTH, height=HEIGHT, encoding="16UC1", step=2 * WIDTH)
    image.data = array.array("B", (2500).to_bytes(2, "little") * (WIDTH * HEIGHT))
    image.header.frame_id = info.header.frame_id = FRAME_ID
    while not (images.get_subscription_count() and infos.get_subscription_count()):
        time.sleep(0.05)
    time.sleep(2.0)
    began = time.monotonic()
    for i in range(count):
        image.header.stamp = info.header.stamp = node.get_clock().now().to_msg()
        infos.publish(info)
        images.publish(image)
        time.sleep(max(0.0, began + (i + 1) / RATE_HZ - time.monotonic()))
    time.sleep(2.0)
    print("sent", count, flush=True)
    rclpy.shutdown()


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
