"""From volumes to poses: a performance that was never taught, and everything that may go wrong."""

import dataclasses
import json

import numpy as np
import pytest

from depth_pose.body.procedural import BodyShape
from depth_pose.core.errors import ConfigError, InputError
from depth_pose.core.rotations import quat_to_matrix, rotvec_to_matrix
from depth_pose.core.skeleton import JOINT_NODES, Source
from depth_pose.motion.procedural.dance import perform
from depth_pose.rooms.rigfile import Rig
from depth_pose.sim.roof_cameras import RigRenderer
from depth_pose.sim.wearers import Wearer, dressed_frames
from depth_pose.volume.config import SpaceConfig, TrackConfig, VolumeConfig
from depth_pose.volume.descriptor import describe
from depth_pose.volume.fit import VolumeFitter
from depth_pose.volume.headings import turns
from depth_pose.volume.hull import Volume, empty_volume
from depth_pose.volume.learn.learning import learn_model
from depth_pose.volume.learn.report import report_rows, track_performance
from depth_pose.volume.model import VolumeModel
from depth_pose.volume.pipeline import VolumePipeline, VolumePoseTracker
from depth_pose.volume.scoring import joint_positions, score
from depth_pose.volume.synchroniser import ViewSet
from depth_pose.volume.tracker import UNLIKELY, LatentTracker, Sight
from depth_pose.volume.tuning import TrackTuning, VolumeTuning

CONFIG = VolumeConfig(space=SpaceConfig(voxel=0.03))


def tracking(**track):
    return dataclasses.replace(CONFIG, track=TrackConfig(**track))


@pytest.fixture(scope="module")
def report(model, performance):
    return track_performance(model, performance, CONFIG)


def test_a_performance_that_was_never_taught(report):
    assert report.mean_pose.angle_deg > 1.8 * report.fitted.angle_deg
    assert report.fitted.angle_deg < 1.2 * report.best_training.angle_deg
    assert report.fitted.angle_deg < report.regressed.angle_deg
    assert report.fitted.joint_cm < 5.0 and report.root_cm < 5.0
    assert report.stature_m == pytest.approx(report.true_stature_m, rel=0.05)
    rows = report_rows([report, report])
    assert len(rows) == 4 and len({len(r) for r in rows}) == 1
    assert rows[1][4] == f"{report.fitted.angle_deg:.2f}°"


def test_the_papers_likelihood(model, performance):
    found = track_performance(model, performance, tracking(likelihood="latent", refine=False))
    assert found.regressed.angle_deg < 0.75 * found.mean_pose.angle_deg
    assert found.fitted.angle_deg == found.regressed.angle_deg  # nothing is fitted


def test_the_same_frames_give_the_same_poses(model, performance, report):
    tracker = VolumePoseTracker(model, CONFIG)
    for _ in range(2):
        poses = [tracker.process(v, 1 + round(i * 1e9 / 30)) for i, v in enumerate(performance.volumes[:12])]
        for pose, before in zip(poses, report.poses, strict=False):
            assert np.array_equal(pose.rotations, before.rotations)
        tracker.reset()


def test_a_turned_and_moved_room_turns_and_moves_the_answer(model, performance):
    """The fine azimuth has 128 steps; a turn by one of them changes nothing but the frame."""
    turn, shift = turns(2 * np.pi * 24 / 128), np.array([0.3, 0.0, -0.2])
    a, b = (VolumePoseTracker(model, tracking(stature=performance.stature)) for _ in range(2))
    for i, v in enumerate(performance.volumes[:5]):
        moved = dataclasses.replace(v, surface=v.surface @ turn.T + shift, centroid=turn @ v.centroid + shift)
        here, there = a.process(v, 1 + i * 33_000_000), b.process(moved, 1 + i * 33_000_000)
        assert score(turn @ here.rotations[None], there.rotations[None]).angle_deg < 0.5
        apart = here.skeleton.positions @ turn.T + shift - there.skeleton.positions
        assert np.abs(apart).max() < 0.02


def test_the_skeleton(model, report):
    skeleton = report.poses[30].skeleton
    assert skeleton.source == Source.VOLUME and skeleton.frame_id == "world"
    assert 0.3 < np.mean([p.skeleton.confidence for p in report.poses]) <= 1.0
    assert np.allclose(quat_to_matrix(skeleton.quats_xyzw), report.poses[30].rotations[JOINT_NODES])
    assert skeleton.scale == pytest.approx(report.stature_m / 1.75, rel=1e-3)
    # a skirt hides hips more than elbows
    assert skeleton.joint_confidence[11] < skeleton.joint_confidence[6]
    assert report.poses[30].angles_deg.shape == (47,)


def test_nobody_and_somebody_else(model, performance):
    tracker = VolumePoseTracker(model, CONFIG, tuning=VolumeTuning(track=TrackTuning(lost_after=3)))
    at = iter(range(1, 10**12, 33_000_000))
    first = [tracker.process(v, next(at)) for v in performance.volumes[:4]]
    gap = [tracker.process(empty_volume(6), next(at)) for _ in range(2)]
    assert all(p.skeleton.is_lost and p.tracked is None for p in gap)
    back = tracker.process(performance.volumes[6], next(at))
    assert back.skeleton.body_id == first[0].skeleton.body_id
    for _ in range(3):
        tracker.process(empty_volume(6), next(at))
    other = tracker.process(performance.volumes[7], next(at))
    assert other.skeleton.body_id != back.skeleton.body_id
    late = tracker.process(performance.volumes[8], next(at) + 2_000_000_000)
    assert late.skeleton.body_id != other.skeleton.body_id


def test_it_recovers_from_a_wrong_heading(model, performance):
    """Turned about by half within one frame, the filter is lost, says so, and searches again."""
    tracker = LatentTracker(model, tuning=TrackTuning(lost_after=3))
    rows = [describe(v, performance.stature, model.bins) for v in performance.volumes[:20]]
    for d in rows[:8]:
        good = tracker.track([Sight(d)], 1 / 30)
    turned = [np.roll(d, 64, axis=0) for d in rows[8:]]
    misfits = [tracker.track([Sight(d)], 1 / 30).misfit for d in turned]
    assert misfits[0] > 3 * good.misfit and misfits[0] > UNLIKELY
    assert min(misfits[4:]) < 2 * good.misfit


def test_the_fit_finds_a_bent_arm(model, performance, body):
    """From a pose whose left forearm points 20 degrees wrong, the hand comes back."""
    fitter = VolumeFitter(body, model.trust)
    i, stature = 10, performance.stature
    truth, wrong = performance.rotations[i], performance.rotations[i].copy()
    wrong[[7, 8]] = rotvec_to_matrix(truth[6] @ np.array([0.0, 0.0, 0.35])) @ wrong[[7, 8]]
    found = fitter.fit(performance.volumes[i].surface, wrong, performance.pelvis[i], stature)

    def wrist(rotations):
        return joint_positions(rotations, stature)[7]

    before = np.linalg.norm(wrist(wrong) - wrist(truth))
    assert before > 0.05
    assert np.linalg.norm(wrist(found.rotations) - wrist(truth)) < 0.65 * before
    assert found.residual < 0.03
    small = fitter.fit(performance.volumes[i].surface, truth, performance.pelvis[i], 0.9 * stature)
    large = fitter.fit(performance.volumes[i].surface, truth, performance.pelvis[i], 1.1 * stature)
    assert small.size > 1.01 and large.size < 0.99


def test_pipeline_from_silhouettes(model, rig):
    pipeline = VolumePipeline(model, Rig(rig), tracking(stature=1.64))
    pipeline.warm_up()
    renderer, clip = RigRenderer(rig), perform("swing", 50, 0.5)
    found = []
    for i, (meshes, _) in enumerate(dressed_frames(Wearer(BodyShape(stature_m=1.64)), clip)):
        images = renderer.silhouettes(meshes)
        images[i % 6] = None  # another camera fails every time
        found.append(pipeline.process_frame(ViewSet(1 + i * 33_000_000, tuple(images))))
    assert all(p.volume.views == 5 for p in found)
    got = score(np.array([p.rotations for p in found]), clip.rotations)
    assert got.angle_deg < 10.0
    assert all(p.disregarded == () for p in found)
    images[i % 6] = np.zeros((120, 160), np.uint8)  # this one sees nobody where the others do
    odd = pipeline.process_frame(ViewSet(600_000_000, tuple(images)))
    assert odd.disregarded == (i % 6,) and odd.volume.views == 5 and not odd.skeleton.is_lost
    nobody = pipeline.process_frame(ViewSet(10**9, (np.zeros((120, 160), np.uint8),) * 6))
    assert nobody.skeleton.is_lost


def test_the_model_file(model, tmp_path):
    path = tmp_path / "some" / "model.npz"
    model.save(path)
    again = VolumeModel.load(path)
    assert again.meta == json.loads(json.dumps(model.meta)) and again.meta["about"] == "a test"
    x = model.latent[:4]
    assert np.array_equal(again.to_pose[0].predict(x), model.to_pose[0].predict(x))
    other = tmp_path / "again.npz"
    model.save(other)
    assert other.read_bytes() == path.read_bytes()


def test_files_that_cannot_be_used(model, tmp_path):
    path = tmp_path / "model.npz"
    with pytest.raises(InputError, match="cannot be read"):
        VolumeModel.load(path)
    path.write_bytes(b"PK nothing")
    with pytest.raises(InputError, match="cannot be read"):
        VolumeModel.load(path)
    np.savez(path, a=np.zeros(3))
    with pytest.raises(InputError, match="not a volume model"):
        VolumeModel.load(path)
    np.savez(path, a=np.array([{"x": 1}], dtype=object))
    with pytest.raises(InputError, match="not plain numbers"):
        VolumeModel.load(path)
    dataclasses.replace(model, meta=model.meta | {"version": 99}).save(path)
    with pytest.raises(InputError, match="version 99"):
        VolumeModel.load(path)
    dataclasses.replace(model, poses=model.poses[:, :-1]).save(path)
    with pytest.raises(InputError, match="poses"):
        VolumeModel.load(path)
    dataclasses.replace(model, trust=model.trust * np.nan).save(path)
    with pytest.raises(InputError, match="trust has values that are not numbers"):
        VolumeModel.load(path)


def test_wearers_must_perform_the_same(views):
    first = views[0][0]
    other = [dataclasses.replace(p, rotations=p.rotations[::-1]) for p in first]
    with pytest.raises(ConfigError, match="same motions"):
        learn_model([[first, other]])
    holes = [dataclasses.replace(p, volumes=(empty_volume(6), *p.volumes[1:])) for p in first]
    with pytest.raises(ConfigError, match="1 frames without a volume"):
        learn_model([[holes]])


def test_small_things_are_nobody(model):
    ball = np.random.default_rng(0).normal(size=(100, 3)) * 0.1 + [0, 0.3, 0]
    tracker = VolumePoseTracker(model)
    assert tracker.process(Volume(ball, ball.mean(axis=0), 100, 6), 1).skeleton.is_lost
