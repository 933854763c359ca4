"""The whole method on a simulated person in a room."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import synthetic as syn
from crowd import person, seen
from depth_pose.core.camera import Camera
from depth_pose.core.config import MatchConfig, PersonalConfig, PipelineConfig
from depth_pose.core.skeleton import JOINT_NODES, Source
from depth_pose.core.stamps import LONGEST_SILENCE_NS
from depth_pose.match.tuning import MatchTuning
from depth_pose.motion.procedural.generator import make_clip
from depth_pose.pipeline import PosePipeline
from depth_pose.recover.confidence import report_joints, skeleton_confidence
from depth_pose.recover.measurements import weigh_joints
from depth_pose.tuning import Tuning

FRAMES = 10


@pytest.fixture(scope="module")
def clip():
    """Frames of somebody walking before a wall, with noise and true joints."""
    motion = make_clip("walk", 25.0, FRAMES / 25.0, 3)
    frames, joints = [], []
    for i in range(FRAMES):
        root = syn.FACING @ (motion.roots[i] - [0.0, 0.9, 0.0]) + [0.0, 0.0, 3.3]
        posed = syn.default_body().pose(syn.FACING @ motion.rotations[i], root)
        depth = np.minimum(syn.draw(syn.mesh(posed)), syn.room())
        frames.append(syn.to_frame(depth, syn.START_NS + i * syn.STEP_NS, noise=0.008, seed=i))
        joints.append(posed.nodes[JOINT_NODES])
    return frames, np.array(joints)


@pytest.fixture(scope="module")
def results(bank, clip):
    pipeline = PosePipeline(bank)
    return [pipeline.process_frame(frame) for frame in clip[0]]


def test_the_papers_way_uses_no_learned_joints(bank, clip):
    """`match.method: exemplars`: no stage is given proposed joints, and the person is found and answered."""
    pipeline = PosePipeline(bank, PipelineConfig(match=MatchConfig(method="exemplars")))
    answers = [pipeline.process_frame(frame) for frame in clip[0]]
    assert all(p.measured is None for a in answers for p in a.people.persons)
    assert all(a.people.persons for a in answers)
    errors = np.linalg.norm(np.array([a.skeleton.positions for a in answers]) - clip[1], axis=-1)
    assert errors.mean() < 0.05


def empty_room(stamp_ns):
    return syn.to_frame(syn.room(), stamp_ns)


def test_the_joints_are_found(clip, results):
    found = np.array([r.skeleton.positions for r in results])
    errors = np.linalg.norm(found - clip[1], axis=-1)
    assert errors.mean() < 0.04
    assert np.mean(errors < 0.1) > 0.95


def test_every_stage_speaks_of_the_same_frame_and_person(clip, results, bank):
    for frame, r in zip(clip[0], results, strict=True):
        (person,), (match,), (refined,), (skeleton,) = r.people.persons, r.matches, r.refined, r.skeletons
        assert skeleton is r.skeleton
        for told in (r.people, person, skeleton):
            assert (told.stamp_ns, told.frame_id) == (frame.stamp_ns, "optical")
        assert refined.stamp_ns == frame.stamp_ns
        assert {person.body_id, match.body_id, refined.body_id, skeleton.body_id} == {"body_1"}
        assert match.bank_id == bank.bank_id
        assert refined.source == Source.REFINED
        assert len(person.points) > 1000
        scale, score = refined.pose.scale, refined.score
        fit = report_joints(refined.joints, scale, person, score, is_compared=False)
        fused = weigh_joints(refined.joints, score, fit.confidence, person.measured, refined.mean_depth_error)
        joints = fused.joints
        sure = skeleton_confidence(person, joints, skeleton.joint_states, skeleton.joint_confidence)
        assert skeleton.confidence == pytest.approx(sure)
        assert sure > 0.6
        assert 0.9 < skeleton.scale < 1.1


def test_twice_the_same(bank, clip, results):
    """A new pipeline, a reset one, and a warmed-up one all repeat it bit for bit."""
    pipeline = PosePipeline(bank)
    pipeline.warm_up()
    for _ in range(2):
        for frame, before in zip(clip[0][:5], results, strict=False):
            again = pipeline.process_frame(frame).skeleton
            np.testing.assert_array_equal(again.positions, before.skeleton.positions)
            np.testing.assert_array_equal(again.joint_confidence, before.skeleton.joint_confidence)
            assert again.scale == before.skeleton.scale
        pipeline.reset()


def test_stamps_that_jump_back_start_afresh(bank, clip, results):
    """The same recording once more, as a loop plays it, gives the same answers again."""
    pipeline = PosePipeline(bank)
    for _ in range(2):
        for frame, before in zip(clip[0][:4], results, strict=False):
            again = pipeline.process_frame(frame).skeleton
            np.testing.assert_array_equal(again.positions, before.skeleton.positions)


def test_a_long_gap_starts_afresh(bank, clip):
    frames = clip[0]
    fresh = PosePipeline(bank).process_frame(frames[5]).skeleton
    pipeline = PosePipeline(bank)
    late = frames[5].stamp_ns - LONGEST_SILENCE_NS - 1
    pipeline.process_frame(syn.DepthFrame(late, "optical", frames[0].depth, frames[0].camera))
    after = pipeline.process_frame(frames[5]).skeleton
    np.testing.assert_array_equal(after.positions, fresh.positions)


def test_after_a_silence_of_a_second_people_are_the_same(bank, clip):
    frames, joints = clip
    pipeline = PosePipeline(bank)
    ids = {pipeline.process_frame(frame).skeleton.body_id for frame in frames[:4]}
    late = [replace(frame, stamp_ns=frame.stamp_ns + 1_000_000_000) for frame in frames[4:7]]
    after = [pipeline.process_frame(frame).skeleton for frame in late]
    assert {s.body_id for s in after} == ids and len(ids) == 1
    assert max(syn.joint_error(s.positions, at) for s, at in zip(after, joints[4:7], strict=True)) < 0.06


def test_somebody_leaves_and_comes_back(bank, clip):
    frames = clip[0]
    pipeline = PosePipeline(bank)
    ids = [pipeline.process_frame(f).skeleton.body_id for f in frames[:2]]
    for i in (2, 3):
        gone = pipeline.process_frame(empty_room(frames[i].stamp_ns))
        assert gone.skeleton.is_lost
        assert (gone.people.persons, gone.matches, gone.refined, gone.skeletons) == ((), (), (), ())
        assert not gone.people.labels.any()
        assert (gone.skeleton.stamp_ns, len(gone.skeleton.positions)) == (frames[i].stamp_ns, 0)
    back = pipeline.process_frame(frames[4]).skeleton
    assert not back.is_lost
    assert syn.joint_error(back.positions, clip[1][4]) < 0.09  # from a single frame
    assert {back.body_id} == set(ids)  # so soon at the same place it is the same person
    late = replace(frames[5], stamp_ns=frames[5].stamp_ns + 3_000_000_000)
    assert pipeline.process_frame(late).skeleton.body_id not in ids


def test_frames_without_anything_do_no_harm(bank):
    pipeline = PosePipeline(bank)
    for i, value in enumerate((0.0, np.nan, np.inf, -1.0, 1e30)):
        depth = np.full((144, 176), value, np.float32)
        frame = syn.DepthFrame(i * syn.STEP_NS, "optical", depth, syn.CAMERA)
        assert pipeline.process_frame(frame).skeleton.is_lost


def test_settings_reach_their_steps(bank, clip):
    config = PipelineConfig.from_mapping(
        {"segment": {"far": 2.0}, "build": {"scale": 0.8}, "smooth": {"enabled": False}}
    )
    assert PosePipeline(bank, config).process_frame(clip[0][0]).skeleton.is_lost
    near = PipelineConfig.from_mapping({"build": {"scale": 0.8}})
    few = Tuning(match=MatchTuning(keep=2))
    (match,) = PosePipeline(bank, near, few).process_frame(clip[0][0]).matches
    assert match.scale == 0.8


# --- two people, found by hand


def two_people(k):
    """Two who stand apart at frame ``k``, moving an arm each: posed bodies and their images."""
    lifts = (-38.0 + 4.0 * k, 10.0)
    places = ({"aside": -0.65, "distance": 3.0}, {"aside": 0.7, "distance": 3.6, "turn": 25.0})
    bodies = [
        syn.posed(
            syn.upright(left_shoulder=syn.rotation("z", a), right_shoulder=syn.rotation("z", 38.0)), **p
        )
        for a, p in zip(lifts, places, strict=True)
    ]
    return bodies, [syn.draw(syn.mesh(b)) for b in bodies]


def answer(pipeline, people):
    """The fitted bodies and the skeletons, as `PosePipeline.process_frame` finds them after extraction."""
    refined = pipeline.refiner.refine(people, pipeline.matcher.match(people))
    return refined, pipeline.recoverer.recover(people, refined)


def test_two_people_each_as_if_alone(bank):
    """Everybody's pose is right, has their own id, and is what it would be without the other."""
    config = PipelineConfig(build=PersonalConfig(scale=1.0))
    together, alone = PosePipeline(bank, config), [PosePipeline(bank, config) for _ in range(2)]
    for k in range(5):
        bodies, depths = two_people(k)
        stamp_ns = syn.START_NS + k * syn.STEP_NS
        refined, both = answer(together, syn.to_people(*depths, stamp_ns=stamp_ns))
        assert [s.body_id for s in both] == ["body_1", "body_2"]
        assert [f.body_id for f in refined] == ["body_1", "body_2"]
        for i, (skeleton, body) in enumerate(zip(both, bodies, strict=True)):
            joints = body.nodes[JOINT_NODES]
            assert syn.joint_error(skeleton.positions, joints) < 0.04
            assert np.linalg.norm(refined[i].body.vertices - body.vertices, axis=1).mean() < 0.065
            empty = np.full(depths[i].shape, np.inf)
            only = [empty, empty]
            only[i] = depths[i]
            _, (own,) = answer(alone[i], syn.to_people(*only, stamp_ns=stamp_ns))
            assert own.body_id == skeleton.body_id
            np.testing.assert_allclose(skeleton.positions, own.positions, atol=0.01)


def test_two_threads_answer_as_one(bank):
    """To the bit: also what is measured anew, and who comes later."""
    results = []
    for threads in (1, 2):
        pipeline = PosePipeline(bank, threads=threads)
        frames = [
            seen(k, [person(k, -0.9, 3.2), person(k, 0.1, 3.0, 2.0), person(k, 1.0, 3.4, 4.0)][: 2 + (k > 2)])
            for k in range(8)
        ]
        results.append([pipeline.process_frame(frame).skeletons for frame in frames])
    assert len(results[0][-1]) >= 2
    for one, two in zip(*results, strict=True):
        assert [s.body_id for s in one] == [s.body_id for s in two]
        for a, b in zip(one, two, strict=True):
            np.testing.assert_array_equal(a.positions, b.positions)
            np.testing.assert_array_equal(a.joint_confidence, b.joint_confidence)
            assert a.confidence == b.confidence


def test_the_order_of_people_does_not_matter(bank):
    config = PipelineConfig(build=PersonalConfig(scale=1.0))
    plain, turned = PosePipeline(bank, config), PosePipeline(bank, config)
    for k in range(3):
        people = syn.to_people(*two_people(k)[1], stamp_ns=syn.START_NS + k * syn.STEP_NS)
        _, a = answer(plain, people)
        _, b = answer(turned, replace(people, persons=people.persons[::-1]))
        for one, same in zip(a, b[::-1], strict=True):
            assert one.body_id == same.body_id
            np.testing.assert_array_equal(one.positions, same.positions)


def test_one_leaves_and_the_other_stays(bank):
    """Whoever is not seen has no answer, and is picked up again under the same id; nobody is mixed up."""
    pipeline = PosePipeline(bank, PipelineConfig(build=PersonalConfig(scale=1.0)))
    for k in range(8):
        bodies, depths = two_people(k)
        if 3 <= k < 6:
            depths[0] = np.full(depths[0].shape, np.inf)
        people = syn.to_people(*depths, stamp_ns=syn.START_NS + k * syn.STEP_NS)
        found = {s.body_id: s for s in answer(pipeline, people)[1]}
        assert set(found) == ({"body_2"} if 3 <= k < 6 else {"body_1", "body_2"})
        for body_id, skeleton in found.items():
            joints = bodies[int(body_id[-1]) - 1].nodes[JOINT_NODES]
            assert syn.joint_error(skeleton.positions, joints) < 0.05


def test_sizes_are_each_person_s_own(bank):
    """An adult and a child."""
    pipeline = PosePipeline(bank)
    for k in range(5):
        depths = [
            syn.draw(syn.mesh(syn.posed(syn.arms_down(), aside=x, distance=3.0, scale=scale, turn=5.0 * k)))
            for x, scale in ((-0.6, 1.05), (0.6, 0.75))
        ]
        _, skeletons = answer(pipeline, syn.to_people(*depths, stamp_ns=syn.START_NS + k * syn.STEP_NS))
    assert [s.scale for s in skeletons] == pytest.approx([1.05, 0.75], rel=0.06)


def test_tracks_are_kept_when_the_camera_changes_its_resolution(clip, bank):
    pipeline, ids = PosePipeline(bank), set()
    for i, frame in enumerate(clip[0]):
        if i >= FRAMES // 2:
            c = frame.camera
            half = Camera(
                (c.width + 1) // 2,
                (c.height + 1) // 2,
                c.fx / 2,
                c.fy / 2,
                (c.cx - 0.5) / 2,
                (c.cy - 0.5) / 2,
            )
            frame = replace(frame, depth=np.ascontiguousarray(frame.depth[::2, ::2]), camera=half)
        (skeleton,) = pipeline.process_frame(frame).skeletons
        ids.add(skeleton.body_id)
        assert np.linalg.norm(skeleton.positions - clip[1][i], axis=-1).mean() < 0.06
    assert ids == {"body_1"}
