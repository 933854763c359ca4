"""The messages of one frame, as the stages make them: what tests of nodes send, and change."""

import scene
from test_denoise_node import image_msg, info_msg

from depth_pose.pipeline import PosePipeline
from depth_pose.ros.transport.conversions import (
    fitted_to_msg,
    matches_to_msg,
    people_to_msgs,
    skeletons_to_msg,
)


def frame_messages(bank):
    """Give the messages of the last of four frames, by topic; ``image`` and ``info`` are the sensor's."""
    stages = PosePipeline(bank)
    for frame in scene.frames(4):
        people = stages.extractor.extract(frame)
        matches = stages.matcher.match(people)
        fitted = stages.refiner.refine(people, matches)
        skeletons = stages.recoverer.recover(people, fitted)
    assert skeletons
    points, found = people_to_msgs(people)
    return {
        "image": image_msg(frame),
        "info": info_msg(frame),
        "points": points,
        "people": found,
        "match": matches_to_msg(matches, people),
        "skeletons_refined": fitted_to_msg(fitted, people),
        "skeletons": skeletons_to_msg(skeletons, frame.stamp_ns, frame.frame_id),
    }
