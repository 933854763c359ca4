"""People as few bytes: nothing is lost."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np

import synthetic as syn
from depth_pose.core.measurement import JointMeasurement
from depth_pose.track.packed_people import pack_people, unpack_people
from depth_pose.track.person_view import see_people


def test_unpacked_people_are_the_same_bit_for_bit():
    two = [syn.draw(syn.mesh(syn.posed(syn.arms_down(), aside=aside))) for aside in (-0.6, 0.6)]
    seen = syn.to_people(*two)
    rng = np.random.default_rng(0)
    found = [
        replace(
            person.found,
            measured=JointMeasurement(
                places=rng.normal(size=(19, 3)).astype(np.float32),
                sigma=rng.random((19, 2)).astype(np.float32),
                confidence=rng.random(19).astype(np.float32),
                heels=rng.random((2, 5)).astype(np.float32),
            ),
        )
        for person in seen.persons
    ]
    floor = np.array([0.0, -0.8, -0.6, 1.25])
    people = see_people(7, "optical", seen.camera, seen.depth, seen.labels, found, floor)
    packed = pickle.dumps(pack_people(people))
    back = unpack_people(pickle.loads(packed))
    assert len(packed) < 0.35 * people.points.nbytes
    assert (back.stamp_ns, back.frame_id, back.camera) == (7, "optical", people.camera)
    np.testing.assert_array_equal(back.floor, people.floor)
    for a, b in zip(back.persons, people.persons, strict=True):
        assert a.body_id == b.body_id
        for name in ("places", "sigma", "confidence", "heels"):
            np.testing.assert_array_equal(getattr(a.measured, name), getattr(b.measured, name))
        np.testing.assert_array_equal(a.points, b.points)
        for own, other in ((a.full, b.full), (a.coarse, b.coarse)):
            assert own.camera == other.camera
            np.testing.assert_array_equal(own.depth, other.depth)
            np.testing.assert_array_equal(own.labels, other.labels)
        assert (a.is_cut_below, a.is_cut_beside) == (b.is_cut_below, b.is_cut_beside)
        np.testing.assert_array_equal(a.target(100).floor, floor)
