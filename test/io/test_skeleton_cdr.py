"""Encoding of skeletons: the same bytes as an encoder of any message writes."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from depth_pose.core.result import Skeleton
from depth_pose.io import schemas
from depth_pose.io.messages import read_message, write_message
from depth_pose.io.skeleton_cdr import write_people, write_skeleton
from skeletons import random_skeleton


def encoded_again(data: bytes, kind: str, stamp_ns: int, frame_id: str) -> bytes:
    message = read_message(data, kind)
    values = {f.name: getattr(message, f.name) for f in fields(message) if f.name != "header"}
    return write_message(kind, stamp_ns, frame_id, **{k: v for k, v in values.items() if k[0] != "_"})


@pytest.mark.parametrize("frame_id", ["", "a", "optical", "camera", "ümläut"])
def test_fields_are_at_their_places_with_names_of_any_length(frame_id):
    one = random_skeleton(np.random.default_rng(0), frame_id=frame_id, stamp_ns=5_000_000_001)
    lost = Skeleton.lost(7, frame_id)
    for skeleton in (one, replace(one, body_id="body_123"), lost):
        data = write_skeleton(skeleton)
        assert data == encoded_again(data, schemas.SKELETON, skeleton.stamp_ns, frame_id)
    data = write_people([one, lost, replace(one, body_id="x")], 9, frame_id)
    assert data == encoded_again(data, schemas.SKELETON_ARRAY, 9, frame_id)
