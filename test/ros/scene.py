"""A person waving before a wall, as depth frames of a small camera; rendered, nothing random."""

import itertools

import numpy as np

from depth_pose.body.procedural import make_body
from depth_pose.body.rendered_depth import render_depth
from depth_pose.core.camera import Camera
from depth_pose.core.frame import DepthFrame
from depth_pose.core.rotations import R_CAMERA_FACING_MODEL as FACING
from depth_pose.core.rotations import rotation_z
from depth_pose.core.skeleton import NODE_INDEX
from depth_pose.io.mcap_write import DepthWriter

CAMERA = Camera(176, 144, 170.0, 170.0, 87.5, 71.5)
START_NS = 1_700_000_000_000_000_000
STEP_NS = 40_000_000


def frames(count, start_ns=START_NS):
    """Yield `count` frames at 25 a second, in whole millimetres."""
    body = make_body()
    for i in range(count):
        rotations = np.tile(FACING, (21, 1, 1))
        lift = 0.6 + 0.5 * np.sin(0.25 * i)
        for side, sign in (("left", 1.0), ("right", -1.0)):
            for node in ("shoulder", "elbow", "wrist"):
                rotations[NODE_INDEX[f"{side}_{node}"]] = FACING @ rotation_z(sign * lift)
        posed = body.pose(rotations, np.array([0.05 * np.sin(0.1 * i), 0.0, 3.2]))
        depth = render_depth(posed.vertices, body.faces, CAMERA)
        depth = np.where(np.isfinite(depth), depth, 4.8)
        depth = np.round(depth * 1000.0).astype(np.float32) / np.float32(1000.0)
        yield DepthFrame(start_ns + i * STEP_NS, "optical", depth, CAMERA)


def write_recording(path, count):
    """Write so many of the `frames` as a depth camera's recording; gives the path."""
    with DepthWriter(path, CAMERA, "optical") as writer:
        for frame in frames(count):
            writer.write_frame(frame)
    return path


def turns(stamps):
    """How often stamps have begun anew, the first time included."""
    return 1 + sum(b < a for a, b in itertools.pairwise(stamps))


def frame_messages(bank):
    """Return the last of four frames, and its messages by topic as the stages make them."""
    from depth_pose_msgs.msg import SkeletonArray
    from rclpy.serialization import deserialize_message

    from depth_pose.io.skeleton_cdr import write_people
    from depth_pose.pipeline import PosePipeline
    from depth_pose.ros.messages.fits import fitted_to_msg
    from depth_pose.ros.messages.matches import matches_to_msg
    from depth_pose.ros.messages.people import people_to_cloud, people_to_msg

    stages = PosePipeline(bank)
    for frame in frames(4):
        people = stages.perception.perceive(frame)
        matches = stages.matcher.match(people)
        fitted = stages.refiner.refine(people, matches)
        skeletons = stages.recoverer.recover(people, fitted)
    assert skeletons
    data = write_people(skeletons, frame.stamp_ns, frame.frame_id)
    return frame, {
        "points": people_to_cloud(people),
        "people": people_to_msg(people),
        "match": matches_to_msg(matches, people),
        "skeletons_refined": fitted_to_msg(fitted, people),
        "skeletons": deserialize_message(data, SkeletonArray),
    }
