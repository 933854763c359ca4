"""No frame waits for a compiler: nodes have all their kernels before the first one."""

import json
import pickle
import struct

import numpy as np
import pytest
import scene
from depth_pose_msgs.msg import Packed
from peer import HERE, LIMIT_S
from rclpy.serialization import serialize_message
from sensor_msgs.msg import CompressedImage, Image, PointCloud2, PointField
from test_denoise_node import image_msg, info_msg

from depth_pose.core.frame import DepthFrame
from depth_pose.pipeline import PosePipeline
from depth_pose.ros.messages.basics import make_header
from depth_pose.ros.messages.fits import fitted_to_msg
from depth_pose.ros.messages.matches import matches_to_msg
from depth_pose.ros.messages.people import people_to_msg

FRAMES = 12
"""Of which the last few are those of a person whose legs are outside of the image."""

DOWN = 40
"""Rows by which these are moved."""


def lowered(frame):
    """The frame of a sensor that looks up: the legs are below the image."""
    depth = np.roll(frame.depth, DOWN, axis=0)
    depth[:DOWN] = frame.depth[0]
    return DepthFrame(frame.stamp_ns, frame.frame_id, depth, frame.camera)


def rvl_msg(frame):
    """The frame as RVL; each pixel of it has a depth."""
    header = make_header(frame.stamp_ns, frame.frame_id)
    pixels = np.round(frame.depth * 1000).astype(int).ravel()
    steps = np.diff(pixels, prepend=0)
    nibbles = []
    for number in [0, len(pixels), *np.where(steps < 0, -2 * steps - 1, 2 * steps).tolist()]:
        while number > 7:
            nibbles.append(8 | (number & 7))
            number >>= 3
        nibbles.append(number)
    nibbles += [0] * (-len(nibbles) % 8)
    words = np.array(nibbles, np.uint32).reshape(-1, 8) << np.arange(28, -4, -4, dtype=np.uint32)
    height, width = frame.depth.shape
    data = struct.pack("<iffII", 0, 0.0, 0.0, width, height) + words.sum(axis=1).astype("<u4").tobytes()
    return CompressedImage(header=header, format="16UC1; compressedDepth rvl", data=data)


def cloud_msg(frame):
    height, width = frame.depth.shape
    points = frame.camera.back_project(frame.depth).astype("<f4")
    return PointCloud2(
        header=make_header(frame.stamp_ns, frame.frame_id),
        height=height,
        width=width,
        point_step=12,
        row_step=12 * width,
        fields=[PointField(name=n, offset=4 * i, datatype=7, count=1) for i, n in enumerate("xyz")],
        data=points.tobytes(),
    )


@pytest.fixture(scope="module")
def messages(bank):
    """What each node takes, frame by frame."""
    pipeline = PosePipeline(bank)
    taken = {name: [] for name in ("denoise", "compressed", "cloud", "matcher", "refine", "recovery")}
    infos = []
    for number, whole in enumerate(scene.frames(FRAMES)):
        frame = whole if number < FRAMES - 4 else lowered(whole)
        result = pipeline.process_frame(frame)
        assert result.skeletons
        matches = matches_to_msg(result.matches, result.people)
        fitted = fitted_to_msg(result.refined, result.people)
        infos.append(info_msg(frame))
        taken["denoise"].append([(Image, image_msg(frame))])
        taken["compressed"].append([(CompressedImage, rvl_msg(frame))])
        taken["cloud"].append([(PointCloud2, cloud_msg(frame))])
        taken["matcher"].append([(Packed, people_to_msg(result.people))])
        taken["refine"].append([(Packed, matches)])
        taken["recovery"].append([(Packed, fitted)])
    return infos, taken


@pytest.mark.parametrize("name", ["denoise", "compressed", "cloud", "matcher", "refine", "recovery"])
def test_first_frames_load_no_kernel(start, bank_path, tmp_path, messages, name):
    infos, taken = messages
    frames = [[(kind, serialize_message(message)) for kind, message in frame] for frame in taken[name]]
    (tmp_path / "frames.pickle").write_bytes(pickle.dumps(([serialize_message(i) for i in infos], frames)))
    arguments = {
        "denoise": [],
        "compressed": ["-p", "image_topic:=/camera/depth/image_raw/compressedDepth"],
        "cloud": ["-p", "cloud_topic:=/camera/points"],
    }.get(name, ["-p", f"bank:={bank_path}"])
    node = name if name in ("matcher", "refine", "recovery") else "denoise"
    process = start(HERE / "node_alone.py", node, tmp_path / "frames.pickle", *arguments)
    assert process.process.wait(LIMIT_S) == 0, process.output
    said = json.loads(process.output.splitlines()[-1])
    assert said["answered"] == FRAMES and said["known"] > 3
    assert said["news"] == [[]] * FRAMES
