"""Failures put into a real run of the pipeline: found, recovered, and not remembered."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

import synthetic as syn
from acted import empty_frame, frame_of, posed, the_bank, the_body
from depth_pose.body.build import BuildSpace
from depth_pose.body.pose import Fitted
from depth_pose.core.config import PersonalConfig, PipelineConfig, RecoverConfig, RefineConfig, SmoothConfig
from depth_pose.core.measurement import JointMeasurement
from depth_pose.core.result import Skeleton
from depth_pose.core.rotations import matrix_to_quat, rotvec_to_matrix
from depth_pose.core.skeleton import BONES, JOINT_NODES, JOINTS, NODE_INDEX, Source
from depth_pose.pipeline import FrameResult, PosePipeline
from depth_pose.recover.confidence import fit_confidence, report_joints, skeleton_confidence
from depth_pose.recover.failure import FailureCheck, bone_lengths, limit_excess
from depth_pose.recover.measurements import weigh_joints
from depth_pose.recover.recover import FailureRecovery
from depth_pose.recover.tuning import RecoverTuning
from depth_pose.sim.failures import KINDS, fail
from depth_pose.stages import StageFactory
from depth_pose.track.person_view import FramePeople
from depth_pose.track.state import PersonStates
from depth_pose.tuning import Tuning
from stages import make_recoverer, make_refiner

FRAMES = 12
BAD = range(4, 8)


@pytest.fixture(scope="module")
def run() -> list[FrameResult]:
    """Every stage's answers to the whole recording, through the real pipeline."""
    config = PipelineConfig(build=PersonalConfig(scale=1.0), smooth=SmoothConfig(enabled=False))
    pipeline = PosePipeline(the_bank(), config)
    return [pipeline.process_frame(frame_of(k)) for k in range(FRAMES)]


def recoverer(smooth: bool = False, tuning: Tuning = Tuning(), **settings) -> FailureRecovery:
    config = RecoverConfig(**settings)
    return make_recoverer(the_bank(), tuning, recover=config, smooth=SmoothConfig(enabled=smooth))


def recovered(stage: FailureRecovery, people: FramePeople, *fitted: Fitted) -> Skeleton | None:
    """The stage's answer for one person; None where they are lost."""
    answers = stage.recover(people, fitted)
    assert len(answers) <= 1
    return answers[0] if answers else None


def with_states() -> tuple[FailureRecovery, PersonStates]:
    """A stage, and the states of its people."""
    shared = StageFactory(the_bank(), PipelineConfig(smooth=SmoothConfig(enabled=False)))
    return shared.make_recoverer(), shared.states


def pretend(states: PersonStates, last: Fitted) -> None:
    """Change the answer for the frame before."""
    state = states["body_1"]
    states["body_1"] = state._replace(answer=state.answer._replace(last=last))


def error(answer: Skeleton | Fitted, k: int) -> float:
    joints = answer.joints if isinstance(answer, Fitted) else answer.positions
    return float(np.linalg.norm(joints - posed(k).nodes[JOINT_NODES], axis=1).mean())


def measured(result: FrameResult) -> np.ndarray:
    """The joints of a good fit, weighed against the proposals."""
    (person,), (fitted,) = result.people.persons, result.refined
    scale, score = fitted.pose.scale, fitted.score
    sure = report_joints(fitted.joints, scale, person, score, is_compared=False).confidence
    return weigh_joints(fitted.joints, score, sure, person.measured, fitted.mean_depth_error).joints


def moved(fitted: Fitted, nodes: np.ndarray, rotations: np.ndarray | None = None) -> Fitted:
    """With other nodes; the score stays."""
    pose = fitted.pose if rotations is None else replace(fitted.pose, rotations=rotations)
    return replace(fitted, body=replace(fitted.body, nodes=nodes, pose=pose))


def scattered(fitted: Fitted) -> Fitted:
    """Joints thrown about by 30 cm."""
    noise = np.random.default_rng(fitted.stamp_ns).normal(size=fitted.nodes.shape) * 0.3
    return moved(fitted, fitted.nodes + noise)


def knees_forward(fitted: Fitted) -> Fitted:
    """The left shank swung up to the front, by 80 degrees: no bone changes its length."""
    hip, knee, ankle, foot = (NODE_INDEX[f"left_{n}"] for n in ("hip", "knee", "ankle", "foot"))
    turn = rotvec_to_matrix(np.radians([-80.0, 0, 0]))
    nodes, rotations = fitted.nodes.copy(), fitted.pose.rotations.copy()
    assert (turn @ (nodes[ankle] - nodes[knee]))[2] < -0.3  # toward the camera, which the person faces
    nodes[[ankle, foot]] = nodes[knee] + (nodes[[ankle, foot]] - nodes[knee]) @ turn.T
    rotations[[knee, ankle, foot]] = turn @ rotations[[knee, ankle, foot]]
    assert np.linalg.norm(nodes[hip] - nodes[knee]) > 0.3
    return moved(fitted, nodes, rotations)


def unsure(fitted: Fitted) -> Fitted:
    """A pose that is wrong and known to be poor."""
    return replace(moved(fitted, fitted.nodes + (0.3, 0, 0)), score=0.63)


def no_pose(fitted: Fitted) -> Fitted:
    return Fitted.lost(fitted.stamp_ns, fitted.body_id)


def replay(stage: FailureRecovery, run, spoil=None, bad=BAD) -> list[Skeleton | None]:
    out = []
    for k, result in enumerate(run):
        (refined,) = result.refined
        out.append(recovered(stage, result.people, spoil(refined) if spoil and k in bad else refined))
    return out


def test_leaves_a_good_run_alone(run) -> None:
    stage = recoverer()
    for k, (result, answer) in enumerate(zip(run, replay(stage, run), strict=True)):
        assert answer.source == Source.REFINED
        np.testing.assert_array_equal(answer.positions, measured(result))
        rotations = result.refined[0].pose.rotations[JOINT_NODES]
        np.testing.assert_array_equal(answer.quats_xyzw, matrix_to_quat(rotations))
        assert answer.body_id == "body_1"
        assert error(answer, k) < 0.04
    assert stage.recoveries == 0
    assert sum(stage.failures.values()) == 0
    assert stage.last_reasons == {}


def told(people: FramePeople, probability: float) -> FramePeople:
    """The same people, of another probability."""
    persons = (replace(p, found=replace(p.found, probability=probability)) for p in people.persons)
    return replace(people, persons=tuple(persons))


def replay_misfit(
    stage: FailureRecovery, run, probability: float, spoil=lambda f: f
) -> list[Skeleton | None]:
    """Answers where no body fits what the finder detected, at one probability."""
    misfits = [replace(spoil(*r.refined), score=0.68) for r in run]
    return [recovered(stage, told(r.people, probability), f) for r, f in zip(run, misfits, strict=True)]


def test_a_thing_whose_body_takes_an_unusual_pose_is_vetoed(run) -> None:
    as_fitted = Tuning(recover=RecoverTuning(enabled=False))  # the last pose would replace it
    stage = recoverer(tuning=as_fitted)
    assert all(a is None for a in replay_misfit(stage, run, 0.35, knees_forward))
    assert stage.doubtful == FRAMES


def test_a_sure_person_is_answered_where_no_body_fits(run) -> None:
    """Their joints are those that the joint net proposes, for the most part, with less confidence."""
    stage = recoverer()
    answers = replay_misfit(stage, run, 0.95)
    assert None not in answers
    assert all(a.confidence < r.skeleton.confidence for a, r in zip(answers, run, strict=True))
    registered = [a.confidence for a in answers if a.source == Source.RECOVERED]
    assert max(registered) < 0.8 * run[-1].skeleton.confidence
    (person,) = run[-1].people.persons
    fitted = run[-1].refined[0]
    sure = report_joints(fitted.joints, fitted.pose.scale, person, 0.68, is_compared=False).confidence
    share = weigh_joints(fitted.joints, 0.68, sure, person.measured).share
    assert np.median(share) > 0.5


@pytest.mark.parametrize(
    ("spoil", "kind", "words"),
    [
        (scattered, "bone_length", "bone_change"),
        (knees_forward, "joint_angle", "left_hip_twist|left_knee"),
        (unsure, "low_confidence", "min_confidence"),
        (no_pose, "no_pose", "no pose"),
    ],
)
def test_recovers_from_injected_failures(run, spoil, kind, words) -> None:
    stage = recoverer()
    for k, result in enumerate(run):
        (refined,) = result.refined
        answer = recovered(stage, result.people, spoil(refined) if k in BAD else refined)
        if k in BAD:
            assert answer.source == Source.RECOVERED
            assert re.search(words, stage.last_reasons["body_1"])
            assert error(answer, k) < 0.06
            assert 0.3 < answer.confidence < 1.0
            assert answer.stamp_ns == result.people.stamp_ns
        else:
            assert answer.source == Source.REFINED
            np.testing.assert_array_equal(answer.positions, measured(result))
        assert answer.body_id == "body_1"
    assert stage.failures[kind] == stage.recoveries == len(BAD)


def test_recovered_bones_keep_their_lengths(run) -> None:
    """Those of the person's build, but for what proposals say; from chest to shoulder the clavicle turns."""
    space = BuildSpace(the_body())
    bones = [k for k, (_, end) in enumerate(BONES) if not JOINTS[end].endswith("shoulder")]
    for answer in replay(recoverer(), run, scattered):
        own = answer.scale * bone_lengths(space.body(answer.build).nodes[JOINT_NODES])
        np.testing.assert_allclose(bone_lengths(answer.positions)[bones], own[bones], atol=0.02)


def test_gives_up_after_some_time_and_finds_the_person_again(run) -> None:
    """Frames come every 40 ms: two are bridged, then the person is lost until a good detection."""
    stage = recoverer(max_time=0.1)
    doubted = [replace(r, people=told(r.people, 0.55)) for r in run]
    sources = [s.source if s else None for s in replay(stage, doubted, scattered)]
    expected = [Source.REFINED] * 4 + [Source.RECOVERED] * 2 + [None] * 2 + [Source.REFINED] * 4
    assert sources == expected


@pytest.mark.parametrize("kind", KINDS)
def test_finds_simulated_failures_and_recovers(run, kind) -> None:
    """What trackers from depth are known to do wrong, in the middle of a good run."""
    rng, stage, found = np.random.default_rng(2), recoverer(), 0
    for k, result in enumerate(run):
        (refined,) = right = result.refined
        if k in BAD:
            refined = fail(kind, refined, result.people.persons[0], the_bank(), rng)
            way = refined.joints - right[0].joints
            if np.linalg.norm(way, axis=1).max() < 0.2:
                continue  # an arm taken from the bank may lie where it was
            found += 1
        answer = recovered(stage, result.people, refined)
        assert ("body_1" in stage.last_reasons) == (k in BAD)
        assert error(answer, k) < 0.06
        assert answer.body_id == "body_1"
    assert found >= 1


def test_a_right_detection_wins_over_a_wrong_past(run) -> None:
    """A pose that comes suddenly, but agrees better than the one carried over, is taken."""
    stage, states = with_states()
    for k in range(3):
        recovered(stage, run[k].people, *run[k].refined)
    (person,) = run[2].people.persons
    wrong = fail("flip", run[2].refined[0], person, the_bank(), np.random.default_rng(0))
    pretend(states, wrong)
    answer = recovered(stage, run[3].people, *run[3].refined)
    assert "joint_speed" in stage.last_reasons["body_1"]
    assert answer.source == Source.REFINED
    assert error(answer, 3) < 0.04
    recovered(stage, run[4].people, *run[4].refined)
    assert stage.last_reasons == {}


def test_proposed_joints_speak_for_a_sudden_pose(run) -> None:
    """A carried pose that agrees better with the depth loses to one where the joints were proposed."""
    (jumped,) = run[3].refined
    jumped = moved(jumped, jumped.nodes + (0.0, 0.0, 0.4))
    skin = jumped.body.vertices + (0.0, 0.0, 0.03)  # agrees less with the depth than the last body
    jumped = replace(jumped, body=replace(jumped.body, vertices=skin))
    for sigma_m, source in ((10.0, Source.RECOVERED), (0.1, Source.REFINED)):
        stage, _ = with_states()
        for k in range(3):
            recovered(stage, run[k].people, *run[k].refined)
        (person,) = run[3].people.persons
        measured = JointMeasurement(
            places=jumped.joints.astype(np.float32),
            sigma=np.full((len(JOINTS), 2), sigma_m, np.float32),
            confidence=np.zeros(len(JOINTS), np.float32),  # does not pull the carried pose
        )
        found = replace(person.found, measured=measured)
        people = replace(run[3].people, persons=(replace(person, found=found),))
        answer = recovered(stage, people, jumped)
        assert "joint_speed" in stage.last_reasons["body_1"]
        assert answer.source == source


def test_disabled_passes_failures_on(run) -> None:
    answers = replay(recoverer(tuning=Tuning(recover=RecoverTuning(enabled=False))), run, scattered)
    assert all(a.source == Source.REFINED for a in answers)
    assert error(answers[5], 5) > 0.2


def test_keeps_a_doubtful_pose_that_agrees_better(run) -> None:
    stage, states = with_states()
    recovered(stage, run[0].people, *run[0].refined)
    stamp_ns = run[1].people.stamp_ns
    people = syn.restamped(run[9].people, stamp_ns)
    doubtful = replace(run[9].refined[0], stamp_ns=stamp_ns, score=0.53)
    assert fit_confidence(0.53) < RecoverConfig().min_confidence
    (wrong,) = run[0].refined
    pose = replace(wrong.pose, root=wrong.pose.root + (3.0, 0.0, 0.0))
    pretend(states, replace(wrong, body=replace(wrong.body, pose=pose)))
    answer = recovered(stage, people, doubtful)
    assert answer.source == Source.REFINED
    (person,) = people.persons
    sure = skeleton_confidence(person, answer.positions, answer.joint_states, answer.joint_confidence)
    assert answer.confidence == pytest.approx(sure)
    assert "min_confidence" in stage.last_reasons["body_1"]


@pytest.mark.parametrize("method", ["articulated", "cpd"])
def test_the_last_body_is_registered_by_the_method(run, method) -> None:
    """By the fit alone, or by the clouds first; both come to the person."""
    stage = make_recoverer(the_bank(), refine=RefineConfig(method=method))
    for k in range(3):
        recovered(stage, run[k].people, *run[k].refined)
    answer = recovered(stage, run[3].people, no_pose(*run[3].refined))
    assert answer.source == Source.RECOVERED
    assert error(answer, 3) < 0.04


def test_first_frame_is_given_even_if_doubtful_but_not_trusted(run) -> None:
    stage, states = with_states()
    first = recovered(stage, run[0].people, knees_forward(*run[0].refined))
    assert first.source == Source.REFINED
    assert states["body_1"].answer.good is None
    assert recovered(stage, run[1].people, *run[1].refined).source == Source.REFINED


def test_same_input_gives_the_same_bits(run) -> None:
    one, two = (replay(recoverer(smooth=True), run, scattered) for _ in range(2))
    for a, b in zip(one, two, strict=True):
        assert a.positions.tobytes() == b.positions.tobytes()
        assert a.quats_xyzw.tobytes() == b.quats_xyzw.tobytes()
        assert a.confidence == b.confidence


def test_who_is_hidden_for_a_frame_is_remembered_and_a_jump_in_time_starts_anew(run) -> None:
    stage = recoverer()
    recovered(stage, run[0].people, *run[0].refined)
    nobody = PosePipeline(the_bank()).perception.perceive(empty_frame(1))
    assert stage.recover(nobody, ()) == ()
    again = recovered(stage, run[2].people, scattered(*run[2].refined))
    assert again.source == Source.RECOVERED
    assert error(again, 2) < 0.06
    late = 5_000_000_000
    answer = recovered(
        stage, syn.restamped(run[3].people, late), scattered(replace(*run[3].refined, stamp_ns=late))
    )
    assert answer.source == Source.REFINED  # nothing before it to recover from


def test_paper_s_method_fits_the_run(run) -> None:
    refiner = make_refiner(the_bank(), refine=RefineConfig(method="cpd"))
    for k in (0, 1, 2):
        (refined,) = refiner.refine(run[k].people, run[k].matches)
        assert error(refined, k) < 0.045
        assert refined.body.vertices.shape == the_body().vertices.shape


def test_limits_allow_every_fit_and_name_the_joint(run) -> None:
    for result in run:
        assert limit_excess(the_body(), result.refined[0]).max() < 20
    check, (right,) = FailureCheck(the_body(), RecoverConfig().min_confidence), run[0].refined
    assert check.find(right, None, None) is None
    longer = right.nodes.copy()
    longer[NODE_INDEX["right_wrist"]] += 0.3
    found = check.find(moved(right, longer), right, None)
    assert found.kind == "bone_length"
    assert "right_elbow to right_wrist" in found.reason
    worse = check.find(replace(right, score=right.score + 0.3), right, None)
    assert worse.kind == "worse_fit"
