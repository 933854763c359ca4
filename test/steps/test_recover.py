"""Failures put into a real run of the pipeline: found, recovered, and not remembered."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from acted import empty_frame, frame_of, posed, the_bank, the_body

from depth_pose.core.config import MatchConfig, PipelineConfig, RecoverConfig, SmoothConfig
from depth_pose.core.rotations import matrix_to_quat, quat_to_matrix, rotvec_to_matrix
from depth_pose.core.skeleton import JOINT_INDEX, JOINT_NODES, Source
from depth_pose.core.types import Skeleton
from depth_pose.people.person import view_person
from depth_pose.pipeline import FrameResult, PosePipeline
from depth_pose.sim.failures import KINDS, fail
from depth_pose.steps.failure import FailureCheck, bone_lengths, limit_excess
from depth_pose.steps.recover import Recoverer

FRAMES = 12
BAD = range(4, 8)


@pytest.fixture(scope="module")
def run() -> list[FrameResult]:
    """Every stage's answers to the whole recording, through the real pipeline."""
    config = PipelineConfig(match=MatchConfig(scale=1.0), smooth=SmoothConfig(enabled=False))
    pipeline = PosePipeline(the_bank(), config)
    return [pipeline.process_frame(frame_of(k)) for k in range(FRAMES)]


def recoverer(smooth: bool = False, **settings) -> Recoverer:
    return Recoverer(the_bank(), RecoverConfig(**settings), SmoothConfig(enabled=smooth))


def error(skeleton: Skeleton, k: int) -> float:
    return float(np.linalg.norm(skeleton.positions - posed(k).nodes[JOINT_NODES], axis=1).mean())


def scattered(skeleton: Skeleton) -> Skeleton:
    """Joints thrown about by 30 cm."""
    noise = np.random.default_rng(skeleton.stamp_ns).normal(size=(19, 3)) * 0.3
    return replace(skeleton, positions=skeleton.positions + noise)


def knees_forward(skeleton: Skeleton) -> Skeleton:
    """The left shank swung up to the front, by 80 degrees: no bone changes its length."""
    hip, knee, ankle = (skeleton.positions[JOINT_INDEX[f"left_{n}"]] for n in ("hip", "knee", "ankle"))
    turn = rotvec_to_matrix(np.radians([-80.0, 0, 0]))
    assert (turn @ (ankle - knee))[2] < -0.3  # toward the camera, which the person faces
    positions, quats = skeleton.positions.copy(), skeleton.quats_xyzw.copy()
    for name in ("left_ankle", "left_foot"):
        positions[JOINT_INDEX[name]] = knee + turn @ (skeleton.positions[JOINT_INDEX[name]] - knee)
    for name in ("left_knee", "left_ankle", "left_foot"):
        j = JOINT_INDEX[name]
        quats[j] = matrix_to_quat(turn @ quat_to_matrix(skeleton.quats_xyzw[j]))
    assert np.linalg.norm(hip - knee) > 0.3
    return replace(skeleton, positions=positions, quats_xyzw=quats)


def unsure(skeleton: Skeleton) -> Skeleton:
    """A pose that is wrong and known to be poor."""
    return replace(skeleton, positions=skeleton.positions + (0.3, 0, 0), confidence=0.05)


def replay(stage: Recoverer, run, spoil=None, bad=BAD) -> list[Skeleton]:
    out = []
    for k, result in enumerate(run):
        refined = spoil(result.refined) if spoil and k in bad else result.refined
        out.append(stage.recover(result.cloud, refined))
    return out


def test_leaves_a_good_run_alone(run) -> None:
    stage = recoverer()
    for k, (result, answer) in enumerate(zip(run, replay(stage, run), strict=True)):
        assert answer.source == Source.REFINED
        np.testing.assert_array_equal(answer.positions, result.refined.positions)
        np.testing.assert_array_equal(answer.quats_xyzw, result.refined.quats_xyzw)
        assert answer.body_id == "body_1"
        assert error(answer, k) < 0.04
    assert stage.recoveries == 0
    assert sum(stage.failures.values()) == 0
    assert stage.last_reason == ""


@pytest.mark.parametrize(
    ("spoil", "kind", "words"),
    [
        (scattered, "bone_length", "bone_change"),
        (knees_forward, "joint_angle", "left_hip_twist|left_knee"),
        (unsure, "low_confidence", "min_confidence"),
        (lambda s: Skeleton.lost(s.stamp_ns, s.frame_id), "no_pose", "no pose"),
    ],
)
def test_recovers_from_injected_failures(run, spoil, kind, words) -> None:
    import re

    stage = recoverer()
    for k, result in enumerate(run):
        answer = stage.recover(result.cloud, spoil(result.refined) if k in BAD else result.refined)
        if k in BAD:
            assert answer.source == Source.RECOVERED
            assert re.search(words, stage.last_reason)
            assert error(answer, k) < 0.06
            assert 0.5 < answer.confidence < run[k].refined.confidence
            assert answer.stamp_ns == result.cloud.stamp_ns
        else:
            assert answer.source == Source.REFINED
            np.testing.assert_array_equal(answer.positions, result.refined.positions)
        assert answer.body_id == "body_1"
    assert stage.failures[kind] == stage.recoveries == len(BAD)


def test_recovered_bones_keep_their_lengths(run) -> None:
    for answer in replay(recoverer(), run, scattered):
        np.testing.assert_allclose(
            bone_lengths(answer.positions), bone_lengths(run[0].refined.positions), rtol=0.03
        )


def test_gives_up_after_some_time_and_finds_the_person_again(run) -> None:
    """Frames come every 40 ms: two are bridged, then the person is lost until a good detection."""
    stage = recoverer(max_time=0.1)
    sources = [s.source for s in replay(stage, run, scattered)]
    expected = [Source.REFINED] * 4 + [Source.RECOVERED] * 2 + [Source.LOST] * 2 + [Source.REFINED] * 4
    assert sources == expected
    answers = replay(recoverer(max_time=0.1), run, scattered)
    assert [a.body_id for a in answers[3:9]] == ["body_1", "body_1", "body_1", "", "", "body_1"]


@pytest.mark.parametrize("kind", KINDS)
def test_finds_simulated_failures_and_recovers(run, kind) -> None:
    """What trackers from depth are known to do wrong, in the middle of a good run."""
    rng, stage, found = np.random.default_rng(2), recoverer(), 0
    for k, result in enumerate(run):
        refined = result.refined
        if k in BAD:
            refined = fail(kind, refined, view_person(result.cloud), the_bank(), rng)
            if np.linalg.norm(refined.positions - result.refined.positions, axis=1).max() < 0.2:
                continue  # an arm taken from the bank may lie where it was
            found += 1
        answer = stage.recover(result.cloud, refined)
        assert (stage.last_reason != "") == (k in BAD)
        assert error(answer, k) < 0.06
        assert answer.body_id == "body_1"
    assert found >= 1


def test_a_right_detection_wins_over_a_wrong_past(run) -> None:
    """A pose that comes suddenly, but agrees better than the one carried over, is taken."""
    stage = recoverer()
    for k in range(3):
        stage.recover(run[k].cloud, run[k].refined)
    wrong = fail("flip", run[2].refined, view_person(run[2].cloud), the_bank(), np.random.default_rng(0))
    stage._past = replace(stage._past, skeleton=wrong)
    answer = stage.recover(run[3].cloud, run[3].refined)
    assert "joint_speed" in stage.last_reason
    assert answer.source == Source.REFINED
    assert error(answer, 3) < 0.04
    stage.recover(run[4].cloud, run[4].refined)
    assert stage.last_reason == ""


def test_the_refiner_starts_from_a_recovered_pose_too(run) -> None:
    """Without candidates near the pose and without tracking, the recovered pose is what helps."""
    from depth_pose.core.config import RefineConfig
    from depth_pose.steps.refine import Refiner

    refiner = Refiner(the_bank(), RefineConfig(track=False), MatchConfig())
    aside = [replace(c, translation=c.translation + (0.7, 0, 0)) for c in run[5].match.candidates]
    match = replace(run[5].match, candidates=tuple(aside))
    assert error(refiner.refine(run[5].cloud, match), 5) > 0.1
    refiner.reset()
    recovered = replace(run[4].refined, source=Source.RECOVERED)
    refiner.take_answer(recovered)
    assert error(refiner.refine(run[5].cloud, match), 5) < 0.05
    assert error(refiner.refine(run[5].cloud, match), 5) > 0.1  # it is a start for one frame


def test_disabled_passes_failures_on(run) -> None:
    answers = replay(recoverer(enabled=False), run, scattered)
    assert all(a.source == Source.REFINED for a in answers)
    assert error(answers[5], 5) > 0.2


def test_keeps_a_doubtful_pose_that_agrees_better(run) -> None:
    def doubtful(skeleton):
        return replace(skeleton, confidence=0.2)

    stage = recoverer()
    stage.recover(run[0].cloud, run[0].refined)
    far = replace(run[9].refined, stamp_ns=run[1].refined.stamp_ns)
    cloud = replace(run[9].cloud, stamp_ns=run[1].cloud.stamp_ns)
    stage._past = replace(stage._past, skeleton=scattered(run[0].refined))  # nothing good to carry over
    answer = stage.recover(cloud, doubtful(far))
    assert answer.source == Source.REFINED
    assert answer.confidence == pytest.approx(0.2)
    assert "min_confidence" in stage.last_reason


def test_first_frame_is_given_even_if_doubtful_but_not_trusted(run) -> None:
    stage = recoverer()
    first = stage.recover(run[0].cloud, knees_forward(run[0].refined))
    assert first.source == Source.REFINED
    assert first.confidence < run[0].refined.confidence
    assert stage.recover(run[1].cloud, run[1].refined).source == Source.REFINED


def test_same_input_gives_the_same_bits(run) -> None:
    one, two = (replay(recoverer(smooth=True), run, scattered) for _ in range(2))
    for a, b in zip(one, two, strict=True):
        assert a.positions.tobytes() == b.positions.tobytes()
        assert a.quats_xyzw.tobytes() == b.quats_xyzw.tobytes()
        assert a.confidence == b.confidence


def test_nobody_in_view_is_lost_and_a_jump_in_time_starts_anew(run) -> None:
    stage = recoverer()
    assert stage.recover(run[0].cloud, run[0].refined).body_id == "body_1"
    pipeline = PosePipeline(the_bank(), PipelineConfig(match=MatchConfig(scale=1.0)))
    nobody = pipeline.extractor.extract(empty_frame(1))
    assert stage.recover(nobody, Skeleton.lost(nobody.stamp_ns, "camera")).is_lost
    again = stage.recover(run[2].cloud, run[2].refined)
    assert again.body_id == "body_1"  # so soon at the same place it is the same person
    late = 5_000_000_000
    answer = stage.recover(
        replace(run[3].cloud, stamp_ns=late), scattered(replace(run[3].refined, stamp_ns=late))
    )
    assert answer.body_id == "body_2"
    assert answer.source == Source.REFINED  # nothing before it to recover from


def test_paper_s_method_fits_the_run(run) -> None:
    from depth_pose.core.config import RefineConfig
    from depth_pose.steps.refine import Refiner

    refiner = Refiner(the_bank(), RefineConfig(method="cpd"), MatchConfig())
    for k in (0, 1, 2):
        refined = refiner.refine(run[k].cloud, run[k].match)
        assert error(refined, k) < 0.045
        assert refiner.mesh.shape == the_body().vertices.shape


def test_limits_allow_every_fit_and_name_the_joint(run) -> None:
    for result in run:
        assert limit_excess(the_body(), result.refined).max() < 20
    check = FailureCheck(the_body(), RecoverConfig())
    assert check.find(run[0].refined, None, None) is None
    longer = run[0].refined.positions.copy()
    longer[JOINT_INDEX["right_wrist"]] += 0.3
    found = check.find(replace(run[0].refined, positions=longer), run[0].refined, None)
    assert found.kind == "bone_length"
    assert "right_elbow to right_wrist" in found.reason
