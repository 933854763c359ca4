"""Rig files, recordings of silhouettes, and the commands around them."""

import numpy as np
import pytest
import yaml

from depth_pose.cli import main
from depth_pose.core.errors import ConfigError, InputError
from depth_pose.core.rotations import quat_to_matrix
from depth_pose.core.types import Skeleton
from depth_pose.io._messages import read_image
from depth_pose.io._recording import Recording
from depth_pose.io.mcap_read import read_skeletons
from depth_pose.sim.roof_cameras import front_camera
from depth_pose.volume.config import LearnConfig, TrackConfig
from depth_pose.volume.pipeline import make_pipeline
from depth_pose.volume.recordings import (
    MomentWriter,
    decode_silhouette,
    in_world,
    process_silhouettes,
    read_moments,
    record_images,
)
from depth_pose.volume.rigfile import load_rig, save_rig, upright_from
from depth_pose.volume_learn.learning import learn_model
from depth_pose.volume_learn.training import default_wearers, simulate_views


@pytest.fixture(scope="module")
def recorded(rig, tmp_path_factory):
    from depth_pose.body.procedural import BodyShape
    from depth_pose.motion.procedural.dance import perform
    from depth_pose.volume_learn.performances import Wearer

    path = tmp_path_factory.mktemp("recorded") / "dance.mcap"
    record_images(path, perform("swing", 50, 0.5), Wearer(BodyShape()), rig, "silhouettes")
    return path


@pytest.mark.parametrize("up", ["y", "z"])
def test_a_rig_file_comes_back(rig, tmp_path, up):
    path = tmp_path / "rig.yaml"
    save_rig(path, rig, [f"/{c.name}" for c in rig], up)
    again = load_rig(path)
    assert again.up == up and again.topics == tuple(f"/{c.name}" for c in rig)
    for a, b in zip(again.cameras, rig, strict=True):
        assert a.camera == b.camera and a.name == b.name
        assert np.allclose(a.T_camera_world, b.T_camera_world, atol=1e-12)
    if up == "z":  # in the file, the camera hangs at its height along z
        T = np.array(yaml.safe_load(path.read_text())["cameras"][0]["T_camera_world"])
        assert (-T[:3, :3].T @ T[:3, 3])[2] == pytest.approx(rig[0].position[1])


def spoil(path, change):
    values = yaml.safe_load(path.read_text())
    change(values)
    path.write_text(yaml.safe_dump(values))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda v: v.pop("cameras"), "a list 'cameras'"),
        (lambda v: v.update(up="x"), "up axis is 'x'"),
        (lambda v: v["cameras"][1].pop("intrinsics"), r"cameras\[1\].intrinsics is missing"),
        (lambda v: v["cameras"][0].update(size=[3]), r"cameras\[0\].size has 1 numbers"),
        (lambda v: v["cameras"][0].update(size=[0, 5]), "must be positive"),
        (lambda v: v["cameras"][0].update(colour="red"), "unknown fields: colour"),
        (lambda v: v["cameras"][2].update(T_camera_world=[[2.0] * 4] * 4), "rotation"),
        (lambda v: v["cameras"][1].update(name="camera0"), "same name"),
        (lambda v: v["cameras"].__setitem__(0, 7), "must be a mapping"),
    ],
)
def test_rig_files_that_cannot_be_used(rig, tmp_path, change, says):
    path = tmp_path / "rig.yaml"
    save_rig(path, rig, [f"/{c.name}" for c in rig])
    spoil(path, change)
    with pytest.raises(ConfigError, match=says):
        load_rig(path)


def test_no_rig_file(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        load_rig(tmp_path / "none.yaml")
    (tmp_path / "odd.yaml").write_text("a: [")
    with pytest.raises(ConfigError, match="not YAML"):
        load_rig(tmp_path / "odd.yaml")


def test_silhouettes_are_decoded():
    pixels = np.arange(12, dtype=np.uint8).reshape(3, 4)
    padded = np.hstack([pixels, np.full((3, 2), 9, np.uint8)])
    assert np.array_equal(decode_silhouette(padded.tobytes(), 3, 4, 6, "mono8"), pixels)
    for encoding, step, data in (("bgr8", 6, b"0" * 18), ("mono8", 6, b"0" * 17), ("mono8", 2, b"0" * 18)):
        with pytest.raises(InputError):
            decode_silhouette(data, 3, 4, step, encoding)


def test_moments_of_a_recording(recorded, rig):
    cameras = load_rig(recorded.with_suffix(".yaml"))
    recording = Recording(recorded)
    moments = list(read_moments(recording, cameras.topics, depth=False))
    assert len(moments) == 15
    assert all(image is not None for _, images in moments for image in images)
    first = recording.first(cameras.topics[2])
    assert np.array_equal(moments[0][1][2].ravel(), np.frombuffer(read_image(first.data).data, np.uint8))
    some = list(read_moments(recording, (*cameras.topics[:3], "/no/such"), depth=False))
    assert all(images[3] is None and images[0] is not None for _, images in some)
    with pytest.raises(InputError, match="none of the rig's topics"):
        list(read_moments(recording, ("/no/such",), depth=False))


def test_a_run_is_repeatable_and_in_the_rigs_world(recorded, model, tmp_path):
    cameras = load_rig(recorded.with_suffix(".yaml"))
    from depth_pose.volume.config import SpaceConfig

    for name in ("a.mcap", "b.mcap"):
        pipeline = make_pipeline(model, cameras.cameras, SpaceConfig(voxel=0.03))
        done = []
        summary = process_silhouettes(recorded, tmp_path / name, pipeline, cameras, done.append)
        assert (summary.frames, summary.answered, summary.incomplete) == (15, 15, 0)
        assert done == list(range(1, 16))
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()
    skeletons = list(read_skeletons(tmp_path / "a.mcap"))
    assert len(skeletons) == 15
    assert 1.4 < skeletons[-1].positions[4, 2] < 1.8  # z is up: the head


def test_turning_a_skeleton_into_a_world_with_z_up(model, performance):
    from depth_pose.volume.pipeline import VolumePoseTracker

    skeleton = VolumePoseTracker(model, voxel=0.03).process(performance.volumes[0], 1).skeleton
    turned = in_world(skeleton, "z")
    back = upright_from("z")[:3, :3]
    assert np.allclose(turned.positions @ back.T, skeleton.positions)
    assert np.allclose(back @ quat_to_matrix(turned.quats_xyzw), quat_to_matrix(skeleton.quats_xyzw))
    assert in_world(skeleton, "y") is skeleton
    lost = Skeleton.lost(1, "world")
    assert in_world(lost, "z") is lost


@pytest.fixture(scope="module")
def depth_model(clips, space):
    """A small model of two performances, seen by one camera from all sides."""
    from depth_pose.body.procedural import BodyShape
    from depth_pose.volume_learn.performances import Wearer

    wearers = [Wearer(BodyShape(stature_m=1.7))]
    return learn_model(simulate_views(clips[:2], wearers, "depth", 6, space), LearnConfig(iterations=40))


def test_one_depth_camera_and_two(depth_model, space):
    """The same model from angles it was not made for, and with one camera more."""
    from depth_pose.body.procedural import BodyShape
    from depth_pose.motion.procedural.dance import perform
    from depth_pose.volume.hull import SurfaceVoxels
    from depth_pose.volume_learn.performances import Wearer, depth_eyes, watch
    from depth_pose.volume_learn.report import track_performance

    assert depth_model.views == 16 and depth_model.meta["input"] == "depth"
    reports = []
    for azimuths in ((1.8,), (1.8, 0.2)):
        eyes = depth_eyes([front_camera(azimuth=a) for a in azimuths], SurfaceVoxels(space))
        performance = watch(perform("swing", 50, 1.5), Wearer(BodyShape(stature_m=1.66)), eyes)
        reports.append(track_performance(depth_model, performance, voxel=0.03))
    one, two = reports
    assert one.fitted.angle_deg < 0.6 * one.mean_pose.angle_deg
    assert two.fitted.angle_deg < 0.95 * one.fitted.angle_deg
    assert len(one.poses[0].tracked.views) == 1 and len(two.poses[0].tracked.views) == 2
    for report in reports:
        assert report.stature_m == pytest.approx(1.66, rel=0.06)
        assert report.root_cm < 10.0


def test_a_depth_camera_that_fails(depth_model, space):
    """Of three cameras one brings nothing, shows nobody, or sees only a hand: the others go on."""
    from depth_pose.body.procedural import BodyShape
    from depth_pose.motion.procedural.dance import perform
    from depth_pose.sim.roof_cameras import RigRenderer, depth_ring
    from depth_pose.volume.scoring import score
    from depth_pose.volume_learn.performances import Wearer, dressed_frames

    rig = depth_ring(3)
    pipeline = make_pipeline(depth_model, rig, space, TrackConfig(stature=1.66))
    pipeline.warm_up()
    clip, renderer, found = perform("swing", 50, 0.5), RigRenderer(rig), []
    for i, (meshes, _) in enumerate(dressed_frames(Wearer(BodyShape(stature_m=1.66)), clip)):
        images = renderer.depths(meshes)
        images[1] = [images[1], None, np.zeros_like(images[1]), sliver(images[1])][i % 4]
        found.append(pipeline.process_frame(images, 1 + i * 33_000_000))
    assert [p.volume.views for p in found[:4]] == [3, 2, 2, 2]
    assert [p.disregarded for p in found[:4]] == [(), (), (1,), (1,)]
    assert score(np.array([p.rotations for p in found]), clip.rotations).angle_deg < 12.0
    nothing = [np.zeros((240, 320), np.float32)] * 3
    assert pipeline.process_frame(nothing, 10**9).skeleton.is_lost
    assert pipeline.process_frame([None] * 3, 2 * 10**9).skeleton.is_lost
    with pytest.raises(InputError, match="depth0 is 10 x 10"):
        pipeline.process_frame([np.zeros((10, 10), np.float32), None, None], 3 * 10**9)
    with pytest.raises(InputError, match="1 depth images for 3 cameras"):
        pipeline.process_frame([None], 3 * 10**9)
    with pytest.raises(ConfigError, match="at least one"):
        make_pipeline(depth_model, [])


def test_a_recording_of_two_depth_cameras(depth_model, space, tmp_path):
    from depth_pose.body.procedural import BodyShape
    from depth_pose.motion.procedural.dance import perform
    from depth_pose.sim.roof_cameras import depth_ring
    from depth_pose.volume_learn.performances import Wearer

    path = tmp_path / "dance.mcap"
    record_images(path, perform("swing", 50, 0.4), Wearer(BodyShape(stature_m=1.66)), depth_ring(2), "depth")
    rig = load_rig(path.with_suffix(".yaml"))
    assert rig.topics == ("/depth0/depth", "/depth1/depth")
    pipeline = make_pipeline(depth_model, rig.cameras, space, TrackConfig(stature=1.66))
    summary = process_silhouettes(path, tmp_path / "out.mcap", pipeline, rig)
    assert (summary.frames, summary.answered, summary.incomplete) == (12, 12, 0)
    heads = [s.positions[4, 2] for s in read_skeletons(tmp_path / "out.mcap")]
    assert np.ptp(heads) < 0.2 and 1.35 < np.mean(heads) < 1.75


def sliver(depth):
    """Give the topmost rows of a person only."""
    seen = depth.copy()
    seen[np.nonzero(depth.any(axis=1))[0][0] + 10 :] = 0.0
    return seen


def test_wearers():
    assert len(default_wearers()) == 5 and default_wearers()[-1].garment is None
    assert len(default_wearers(["robe"])) == 1
    with pytest.raises(ConfigError, match="no garment"):
        default_wearers(["armour"])


def call(monkeypatch, capsys, *arguments):
    monkeypatch.setattr("sys.argv", ["depth-pose", "volume", *map(str, arguments)])
    monkeypatch.setenv("COLUMNS", "160")
    capsys.readouterr()
    try:
        main()
    except SystemExit as end:
        return int(end.code or 0), capsys.readouterr()
    return 0, capsys.readouterr()


def test_commands(monkeypatch, capsys, tmp_path):
    """Learn, look, dance, record and run: as a user does, on little."""
    model, dance, found = tmp_path / "m.npz", tmp_path / "d.mcap", tmp_path / "s.mcap"
    code, said = call(
        monkeypatch, capsys, "train", "-o", model, "--performances", 2, "--every", 12, "--garment", "skirt",
        "--iterations", 20, "--voxel", 0.04, "--plot", tmp_path / "latent.png",
    )  # fmt: skip
    assert code == 0, said.err
    assert "2 performances" in said.out and (tmp_path / "latent.png").stat().st_size > 10_000
    code, said = call(monkeypatch, capsys, "info", model)
    assert code == 0 and "dance swing" in said.out
    picture = tmp_path / "demo.png"
    code, said = call(
        monkeypatch, capsys, "demo", "-m", model, "--seconds", 1, "-o", picture, "--record", dance
    )
    assert code == 0, said.err
    assert "best training pose" in said.out and picture.stat().st_size > 10_000
    rig = dance.with_suffix(".yaml")
    code, said = call(monkeypatch, capsys, "run", dance, "-o", found, "-m", model, "--rig", rig)
    assert code == 0, said.err
    assert len(list(read_skeletons(found))) == 30
    code, said = call(monkeypatch, capsys, "demo", "-m", model, "--seconds", 1, "-o", picture, "--cameras", 4)
    assert code == 0, said.err
    code, said = call(monkeypatch, capsys, "demo", "-m", model, "--input", "depth")
    assert code == 2 and "--input silhouettes" in said.err
    code, said = call(monkeypatch, capsys, "train", "-o", model, "--motion", rig)
    assert code == 2 and "is no .bvh file" in said.err


def test_images_of_several_cameras(tmp_path):
    with MomentWriter(tmp_path / "x.mcap") as writer:
        writer.write("/a", 5, "a", np.full((2, 3), 7, np.uint8))
        writer.write("/b", 5, "b", np.full((2, 3), 1.5, np.float32))
    recording = Recording(tmp_path / "x.mcap")
    assert read_image(recording.first("/a").data).encoding == "mono8"
    assert read_image(recording.first("/b").data).encoding == "32FC1"
