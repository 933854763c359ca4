"""Rig files, recordings of silhouettes, and the commands around them."""

from dataclasses import replace

import numpy as np
import pytest
import yaml

from depth_pose.body.procedural import BodyShape
from depth_pose.cli import main
from depth_pose.core.errors import ConfigError, InputError
from depth_pose.core.result import Skeleton
from depth_pose.core.rotations import quat_to_matrix
from depth_pose.io.messages import read_image, write_image, write_message
from depth_pose.io.recording import Recording
from depth_pose.io.schemas import IMAGE
from depth_pose.io.skeleton_read import read_skeletons
from depth_pose.motion.procedural.dance import perform
from depth_pose.offline import process_recording
from depth_pose.rooms.rigfile import Rig, load_rig, save_rig, upright_from
from depth_pose.sim.roof_cameras import RigRenderer, depth_ring, front_camera
from depth_pose.sim.wearers import ViewWriter, Wearer, dressed_frames, record_views
from depth_pose.volume.config import LearnConfig, SpaceConfig, TrackConfig, ViewsConfig, VolumeConfig
from depth_pose.volume.decode import decode_silhouette
from depth_pose.volume.learn.learning import learn_model
from depth_pose.volume.learn.performances import rig_eyes, watch
from depth_pose.volume.learn.report import track_performance
from depth_pose.volume.learn.training import default_wearers, simulate_views
from depth_pose.volume.pipeline import VolumePipeline, VolumePoseTracker, in_world
from depth_pose.volume.recordings import ViewReader
from depth_pose.volume.scoring import score
from depth_pose.volume.synchroniser import ViewSet


@pytest.fixture(scope="module")
def recorded(rig, tmp_path_factory):
    path = tmp_path_factory.mktemp("recorded") / "dance.mcap"
    record_views(path, perform("swing", 50, 0.5), Wearer(BodyShape()), rig, "silhouettes")
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
        (lambda v: v["cameras"][2].update(T_camera_world=[[2.0] * 4] * 4), "last row"),
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


def test_views_of_a_recording(recorded, rig):
    cameras = load_rig(recorded.with_suffix(".yaml"))
    reader = ViewReader(recorded, cameras, "silhouettes")
    sets = list(reader)
    assert len(sets) == 15 and reader.incomplete == reader.dropped == 0 and not reader.warnings
    assert all(image is not None for views in sets for image in views.images)
    first = Recording(recorded).first(cameras.topics[2])
    assert np.array_equal(sets[0].images[2].ravel(), np.frombuffer(read_image(first.data).data, np.uint8))
    some = replace(cameras, topics=(*cameras.topics[:3], *["/no/such"] * (len(rig) - 3)))
    reader = ViewReader(recorded, some, "silhouettes")
    assert all(v.images[3] is None and v.images[0] is not None for v in reader) and reader.incomplete == 15
    with pytest.raises(InputError, match="none of the rig's topics"):
        ViewReader(recorded, replace(cameras, topics=("/no/such",) * len(rig)), "silhouettes")
    with pytest.raises(InputError, match=r"no frame can be used: /camera0/silhouette: .*mono8"):
        list(ViewReader(recorded, cameras, "depth"))


def test_recorded_views_that_are_late_odd_or_few(rig, tmp_path):
    """Skewed stamps are one set; a late image, one of another size, and a set of one camera are counted."""
    small, good = np.ones((5, 5), np.uint8), np.ones((120, 160), np.uint8)
    cameras = Rig(rig[:3], ("/a", "/b", "/c"))
    with ViewWriter(tmp_path / "x.mcap") as writer:
        for k in range(30):
            for i, topic in enumerate(cameras.topics):
                if (k, i) not in ((20, 0), (20, 1)):
                    image = small if (k, i) == (3, 1) else good
                    writer.write(topic, 10**9 + k * 33_000_000 + i * 1_500_000, topic, image)
    reader = ViewReader(tmp_path / "x.mcap", cameras, "silhouettes")
    sets = list(reader)
    assert len(sets) == 29 and reader.dropped == 1 and reader.incomplete == 1
    assert sets[3].images[1] is None
    assert any("/b: the image of camera1 is 5 x 5" in line for line in reader.warnings)
    assert any("1 times: a frame was dropped: only 1 of 3 live cameras" in line for line in reader.warnings)


@pytest.mark.parametrize(
    ("wrong", "images", "says"),
    [
        (lambda k, i: (k, i) == (9, 1), 59, "/b: its stamp is 3600 s ahead of the others"),
        (lambda k, i: i == 1, 40, "/b: its stamp is 3600 s ahead of the others"),
        (lambda k, i: k >= 9, 60, None),  # the cameras' common clock was set
    ],
)
def test_a_stamp_an_hour_ahead_breaks_no_other_set(rig, tmp_path, wrong, images, says):
    good, path = np.ones((120, 160), np.uint8), tmp_path / "x.mcap"
    cameras = Rig(rig[:3], ("/a", "/b", "/c"))
    with ViewWriter(path) as writer:
        for k in range(20):
            for i, topic in enumerate(cameras.topics):
                stamp_ns = 10**9 + k * 33_000_000 + i * 100_000
                told_ns = stamp_ns + 3_600_000_000_000 * wrong(k, i)
                writer.write_message(topic, IMAGE, stamp_ns, write_image(told_ns, topic, good))
    reader = ViewReader(path, cameras, "silhouettes")
    sets = list(reader)
    assert len(sets) == 20
    assert sum(image is not None for views in sets for image in views.images) == images
    assert any(says in line for line in reader.warnings) if says else not reader.warnings


def test_images_of_the_other_byte_order(rig, tmp_path):
    depth, path = np.full((120, 160), 3.0, np.float32), tmp_path / "x.mcap"
    millimetres = (depth * 1000).astype(">u2")
    cameras = Rig(rig[:2], ("/a", "/b"))
    with ViewWriter(path) as writer:
        writer.write("/a", 10**9, "a", depth)
        image = {"height": 120, "width": 160, "encoding": "16UC1", "is_bigendian": 1, "step": 320}
        data = write_message(IMAGE, 10**9, "b", **image, data=millimetres.view(np.uint8).ravel())
        writer.write_message("/b", IMAGE, 10**9, data)
    (views,) = ViewReader(path, cameras, "depth")
    assert np.array_equal(views.images[0], views.images[1])


def test_depth_in_another_unit_is_said_and_the_setting_sets_it(rig, tmp_path):
    depth, path = np.full((120, 160), 3.0, np.float32), tmp_path / "x.mcap"
    cameras = Rig(rig[:2], ("/a", "/b"))
    with ViewWriter(path) as writer:
        for k in range(3):
            writer.write("/a", 10**9 + k * 33_000_000, "a", depth)
            writer.write("/b", 10**9 + k * 33_000_000, "b", 1000 * depth)
    reader = ViewReader(path, cameras, "depth")
    list(reader)
    (line,) = reader.warnings
    assert "/b: the depths look like another unit" in line and "views.depth_scale" in line
    scaled = ViewReader(path, replace(cameras, topics=("/no", "/b")), "depth", ViewsConfig(depth_scale=0.001))
    assert all(np.allclose(views.images[1], depth) for views in scaled) and not scaled.warnings


def test_a_run_is_repeatable_and_in_the_rigs_world(recorded, model, tmp_path):
    cameras = load_rig(recorded.with_suffix(".yaml"))
    for name in ("a.mcap", "b.mcap"):
        pipeline = VolumePipeline(model, cameras, VolumeConfig(space=SpaceConfig(voxel=0.03)))
        reader, done = ViewReader(recorded, cameras, "silhouettes"), []
        summary = process_recording(reader, tmp_path / name, pipeline, done.append)
        assert (summary.frames, summary.answered, reader.incomplete) == (15, 15, 0)
        assert done == list(range(1, 16))
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()
    skeletons = list(read_skeletons(tmp_path / "a.mcap"))
    assert len(skeletons) == 15
    assert 1.4 < skeletons[-1].positions[4, 2] < 1.8  # z is up: the head


def test_turning_a_skeleton_into_a_world_with_z_up(model, performance):
    tracker = VolumePoseTracker(model, VolumeConfig(space=SpaceConfig(voxel=0.03)))
    skeleton = tracker.process(performance.volumes[0], 1).skeleton
    turned = in_world(skeleton, "z")
    back = upright_from("z")[:3, :3]
    assert np.allclose(turned.positions @ back.T, skeleton.positions)
    assert np.allclose(back @ quat_to_matrix(turned.quats_xyzw), quat_to_matrix(skeleton.quats_xyzw))
    assert in_world(skeleton, "y") is skeleton
    lost = Skeleton.lost(1, "world")
    assert in_world(lost, "z") is lost


def of_depth(space, cut_out):
    return VolumeConfig(space=space, track=TrackConfig(stature=1.66), views=ViewsConfig(cut_out=cut_out))


@pytest.fixture(scope="module")
def depth_model(clips, space):
    """A small model of two performances, seen by one camera from all sides."""
    wearers = [Wearer(BodyShape(stature_m=1.7))]
    return learn_model(simulate_views(clips[:2], wearers, "depth", 6, space), LearnConfig(iterations=40))


def test_one_depth_camera_and_two(depth_model, space):
    """The same model from angles it was not made for, and with one camera more."""
    assert depth_model.views == 16 and depth_model.meta["input"] == "depth"
    reports = []
    for azimuths in ((1.8,), (1.8, 0.2)):
        eyes = rig_eyes("depth", [front_camera(azimuth=a) for a in azimuths], space)
        performance = watch(perform("swing", 50, 1.5), Wearer(BodyShape(stature_m=1.66)), eyes)
        reports.append(track_performance(depth_model, performance, VolumeConfig(space=space)))
    one, two = reports
    assert one.fitted.angle_deg < 0.6 * one.mean_pose.angle_deg
    assert two.fitted.angle_deg < 0.95 * one.fitted.angle_deg
    assert len(one.poses[0].tracked.views) == 1 and len(two.poses[0].tracked.views) == 2
    for report in reports:
        assert report.stature_m == pytest.approx(1.66, rel=0.06)
        assert report.root_cm < 10.0


def test_a_depth_camera_that_fails(depth_model, space):
    """Of three cameras one brings nothing, shows nobody, or sees only a hand: the others go on."""
    rig = depth_ring(3)
    pipeline = VolumePipeline(depth_model, Rig(rig), of_depth(space, cut_out=False))
    pipeline.warm_up()
    clip, renderer, found = perform("swing", 50, 0.5), RigRenderer(rig), []
    for i, (meshes, _) in enumerate(dressed_frames(Wearer(BodyShape(stature_m=1.66)), clip)):
        images = renderer.depths(meshes)
        images[1] = [images[1], None, np.zeros_like(images[1]), sliver(images[1])][i % 4]
        found.append(pipeline.process_frame(ViewSet(1 + i * 33_000_000, tuple(images))))
    assert [p.volume.views for p in found[:4]] == [3, 2, 2, 2]
    assert [p.disregarded for p in found[:4]] == [(), (), (1,), (1,)]
    assert score(np.array([p.rotations for p in found]), clip.rotations).angle_deg < 12.0
    nothing = (np.zeros((240, 320), np.float32),) * 3
    assert pipeline.process_frame(ViewSet(10**9, nothing)).skeleton.is_lost
    assert pipeline.process_frame(ViewSet(2 * 10**9, (None,) * 3)).skeleton.is_lost
    with pytest.raises(InputError, match="depth0 is 10 x 10"):
        pipeline.process_frame(ViewSet(3 * 10**9, (np.zeros((10, 10), np.float32), None, None)))
    with pytest.raises(InputError, match="1 images for 3 cameras"):
        pipeline.process_frame(ViewSet(3 * 10**9, (None,)))
    with pytest.raises(ConfigError, match="at least one"):
        VolumePipeline(depth_model, Rig(()))


def test_a_recording_of_two_depth_cameras(depth_model, space, tmp_path):
    path = tmp_path / "dance.mcap"
    record_views(path, perform("swing", 50, 0.4), Wearer(BodyShape(stature_m=1.66)), depth_ring(2), "depth")
    rig = load_rig(path.with_suffix(".yaml"))
    assert rig.topics == ("/depth0/depth", "/depth1/depth")
    for cut_out in (True, False):
        reader = ViewReader(path, rig, "depth")
        pipeline = VolumePipeline(depth_model, rig, of_depth(space, cut_out))
        summary = process_recording(reader, tmp_path / "out.mcap", pipeline)
        assert (summary.frames, summary.answered, reader.incomplete) == (12, 12, 0)
        heads = [s.positions[4, 2] for s in read_skeletons(tmp_path / "out.mcap")]
        assert np.ptp(heads) < 0.2 and 1.35 < np.mean(heads) < 1.75


def sliver(depth):
    """Keep only the topmost rows of a person."""
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
    assert code == 2 and "is not a .bvh file" in said.err


def test_images_of_several_cameras(tmp_path):
    with ViewWriter(tmp_path / "x.mcap") as writer:
        writer.write("/a", 5, "a", np.full((2, 3), 7, np.uint8))
        writer.write("/b", 5, "b", np.full((2, 3), 1.5, np.float32))
    recording = Recording(tmp_path / "x.mcap")
    assert read_image(recording.first("/a").data).encoding == "mono8"
    assert read_image(recording.first("/b").data).encoding == "32FC1"
