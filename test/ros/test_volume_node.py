"""The volume node live: eight simulated cameras at 60 frames a second, and what cameras do."""

import signal
import time

import numpy as np
import pytest
from depth_pose_msgs.msg import Skeleton
from diagnostic_msgs.msg import DiagnosticArray
from peer import LIMIT_S, RELIABLE, bring
from sensor_msgs.msg import CameraInfo, Image, JointState
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import MarkerArray

from depth_pose.body.angles import ANGLE_INDEX, ANGLES, angles_from_rotations
from depth_pose.body.procedural import BodyShape
from depth_pose.core.camera import Camera
from depth_pose.core.rotations import matrix_to_quat
from depth_pose.core.skeleton import Source
from depth_pose.io.skeleton_read import read_skeletons
from depth_pose.motion.procedural.dance import perform
from depth_pose.offline import process_recording
from depth_pose.rooms.rigfile import load_rig, save_rig, upright_from
from depth_pose.ros.messages.basics import make_header
from depth_pose.ros.messages.skeletons import msg_to_skeleton
from depth_pose.ros.transport.tf import LATCHED, stamped
from depth_pose.sim.clothing import Garment
from depth_pose.sim.roof_cameras import RigRenderer, depth_ring, roof_rig
from depth_pose.sim.wearers import ViewWriter, Wearer, dressed_frames
from depth_pose.volume.config import LearnConfig, SpaceConfig, TrackConfig, VolumeConfig
from depth_pose.volume.learn.learning import learn_model
from depth_pose.volume.learn.training import simulate_views
from depth_pose.volume.model import VolumeModel
from depth_pose.volume.pipeline import VolumePipeline
from depth_pose.volume.recordings import ViewReader

CAMERAS = 8
FPS = 60.0
SMALL = Camera(160, 120, 119.0, 119.0, 79.5, 59.5)
START_NS = 1_700_000_000_000_000_000


@pytest.fixture(scope="module")
def rig():
    return roof_rig(CAMERAS, camera=SMALL)


@pytest.fixture(scope="module")
def model_path(rig, tmp_path_factory):
    clips = [perform("swing", seed, 3.0) for seed in (1, 2)]
    wearers = [Wearer(BodyShape(stature_m=1.7), Garment(skirt=0.5, flare=0.25)), Wearer(BodyShape())]
    path = tmp_path_factory.mktemp("model") / "model.npz"
    learn_model(simulate_views(clips, wearers, every=5, rig=rig), LearnConfig(iterations=40)).save(path)
    return path


@pytest.fixture(scope="module")
def images(rig):
    """One second and a half of a performance: silhouettes of all cameras, and the true rotations."""
    clip = perform("swing", 50, 1.5, FPS, start_beat=0.5)
    renderer = RigRenderer(rig)
    wearer = Wearer(BodyShape(stature_m=1.66), Garment(skirt=0.55, flare=0.3))
    return [renderer.silhouettes(meshes) for meshes, _ in dressed_frames(wearer, clip)], clip.rotations


@pytest.fixture
def rig_path(rig, tmp_path):
    path = tmp_path / "rig.yaml"
    save_rig(path, rig, [f"/camera{i}/silhouette" for i in range(CAMERAS)])
    return path


CONFIG = VolumeConfig(space=SpaceConfig(voxel=0.03), track=TrackConfig(stature=1.66))


WHOLE = {"views__patience": 10.0, "views__gone_after": 60.0}
"""Every set of views is whole, however long the machine stands still between two cameras' images."""

HASTY = {"views__patience": 0.012, "views__gone_after": 0.5}
"""As the node is by default."""


def start_node(start, **given):
    given |= {"space.voxel": CONFIG.space.voxel, "track.stature": CONFIG.track.stature}
    arguments = [a for name, value in given.items() for a in ("-p", f"{name.replace('__', '.')}:={value}")]
    return start("-m", "depth_pose.ros.nodes.volume_node", "--ros-args", *arguments)


class Rehearsal:
    """The node, its cameras' publishers, and what it says."""

    def __init__(self, peer, process, count=CAMERAS):
        process.wait_for("is ready", 240.0)
        self.peer, self.process = peer, process
        self.skeletons = peer.listen(Skeleton, "/depth_pose/skeleton", RELIABLE)
        self.states = peer.listen(JointState, "/depth_pose/joint_states", RELIABLE)
        self.markers = peer.listen(MarkerArray, "/depth_pose/markers", RELIABLE)
        self.told = peer.listen(DiagnosticArray, "/diagnostics", RELIABLE)
        self.cameras = [peer.publisher(Image, f"/camera{i}/silhouette") for i in range(count)]
        self.next = 0  # index of the next frame
        peer.spin(0.3)

    def show(self, index, silhouettes, cameras=range(CAMERAS)):
        stamp = START_NS + round(index * 1e9 / FPS)
        for c in cameras:
            pixels = silhouettes[c]
            self.cameras[c].publish(
                Image(
                    header=make_header(stamp, f"camera{c}"),
                    height=pixels.shape[0],
                    width=pixels.shape[1],
                    encoding="mono8",
                    step=pixels.shape[1],
                    data=pixels.tobytes(),
                )
            )
        return stamp

    def play(self, images, until, cameras=range(CAMERAS), change=None, what="what was waited for"):
        """Play frames at their rate by the wall clock, on and on until a condition holds."""
        began, first = time.monotonic(), self.next
        while not until():
            assert time.monotonic() < began + LIMIT_S, f"{what} did not come:\n{self.process.output}"
            shown = images[self.next % len(images)]
            self.show(self.next, change(shown) if change else shown, cameras)
            self.next += 1
            self.peer.executor.spin_once(timeout_sec=0.001)
            while time.monotonic() < began + (self.next - first) / FPS:
                self.peer.executor.spin_once(timeout_sec=0.001)

    def play_until_found(self, images, found=True, **how):
        """Play until a frame of this part of the play is answered with somebody, or with nobody."""
        first_ns = START_NS + round(self.next * 1e9 / FPS)

        def answers():
            return [s for s in map(msg_to_skeleton, self.skeletons) if s.stamp_ns >= first_ns]

        self.skeletons.clear()
        self.play(images, lambda: any(s.is_lost != found for s in answers()), what="an answer", **how)
        return next(s for s in answers() if s.is_lost != found)

    def play_until_told(self, images, text, **how):
        """Play until the node's log says something it had not said before."""
        said = self.process.output.count(text)
        self.play(images, lambda: self.process.output.count(text) > said, what=text, **how)

    def value(self, key):
        for message in reversed(self.told):
            for status in message.status:
                if status.name == "/depth_pose/volume":
                    return {v.key: v.value for v in status.values}.get(key)
        return None

    def messages(self):
        return [s.message for m in self.told for s in m.status if s.name == "/depth_pose/volume"]


def test_sixty_frames_a_second_and_what_cameras_do(start, peer, model_path, images, rig_path):
    silhouettes, rotations = images
    process = start_node(start, model=model_path, rig=rig_path, **WHOLE)
    live = Rehearsal(peer, process)

    # all cameras: the right pose, in the world frame, z up
    # (which of the frames are answered depends on the machine; benchmarks say)
    live.play(silhouettes, lambda: len(live.skeletons) >= 20 and live.states and live.markers)
    last = msg_to_skeleton(live.skeletons[-1])
    assert last.frame_id == "map" and not last.is_lost
    index = round((last.stamp_ns - START_NS) * FPS / 1e9) % len(silhouettes)
    turn = upright_from("z")[:3, :3].T
    truth = matrix_to_quat(turn @ rotations[index][[0, 2]])
    dots = np.abs(np.einsum("jk,jk->j", truth, last.quats_xyzw[[0, 2]]))
    assert np.degrees(2 * np.arccos(np.clip(dots, 0, 1))).max() < 30.0
    assert 1.3 < last.positions[4, 2] < 1.8  # the head is up
    joints = live.markers[-1].markers[1]
    assert joints.header.frame_id == "map" and len(joints.points) == 19
    state = live.states[-1]
    assert list(state.name) == list(ANGLES) and state.header.frame_id == "map"
    at_ns = state.header.stamp.sec * 10**9 + state.header.stamp.nanosec
    index = round((at_ns - START_NS) * FPS / 1e9) % len(silhouettes)
    elbow = ANGLE_INDEX["left_elbow_flexion"]
    true_elbow = np.radians(angles_from_rotations(rotations[index])[elbow])
    assert abs(state.position[elbow] - true_elbow) < np.radians(35)

    # a lost camera
    peer.set("/depth_pose/volume", **HASTY)
    others = [c for c in range(CAMERAS) if c != 3]
    live.play_until_told(silhouettes, "nothing from /camera3/silhouette; goes on without", cameras=others)
    before = len(live.skeletons)
    live.play(silhouettes, lambda: len(live.skeletons) > before + 20, cameras=others)
    live.play_until_found(silhouettes, cameras=others)
    live.play(
        silhouettes, lambda: any(m == "nothing from /camera3/silhouette" for m in live.messages()), others
    )
    live.play(silhouettes, lambda: int(live.value("answered without: /camera3/silhouette") or 0) > 5, others)

    # it comes back; another is late
    live.play_until_told(silhouettes, "all cameras are there")
    before = int(live.value("late: /camera5/silhouette") or 0)

    def show_one_late():
        live.next += 1
        shown = silhouettes[live.next % len(silhouettes)]
        stamp = live.show(live.next, shown, [c for c in range(CAMERAS) if c != 5])
        deadline = time.monotonic() + 2.0
        while time.monotonic() < deadline and stamp not in [
            msg_to_skeleton(s).stamp_ns for s in live.skeletons
        ]:
            peer.executor.spin_once(timeout_sec=0.02)
        live.show(live.next, shown, [5])

    late = lambda: int(live.value("late: /camera5/silhouette") or 0) > before  # noqa: E731
    peer.ask(show_one_late, late, what="the count", every_s=2.0)
    process.wait_for("is late: its time was answered without it")
    live.next += 1

    # a camera that shows nobody while the others do
    peer.set("/depth_pose/volume", **WHOLE)

    def blind(shown):
        return [s if c != 2 else np.zeros_like(s) for c, s in enumerate(shown)]

    live.play_until_told(silhouettes, "/camera2/silhouette shows nobody while others do", change=blind)
    live.play_until_found(silhouettes, change=blind)

    # really nobody, a damaged image, and time that goes back
    nobody = live.play_until_found(
        silhouettes, found=False, change=lambda shown: [np.zeros_like(s) for s in shown]
    )
    assert nobody.is_lost
    assert all(not s.joints for s in live.skeletons if msg_to_skeleton(s).is_lost)

    def cut(shown):
        return [s[:50] if c == 0 else s for c, s in enumerate(shown)]

    text = "dropped, bad image: /camera0/silhouette: the image of camera0 is 160 x 50"
    live.play_until_told(silhouettes, text, change=cut)
    live.play_until_found(silhouettes, change=cut)
    assert live.next > 60
    peer.set("/depth_pose/volume", **HASTY)
    live.next = 3
    live.skeletons.clear()
    live.play(
        silhouettes,
        lambda: any(START_NS < msg_to_skeleton(s).stamp_ns < START_NS + 10**9 for s in live.skeletons),
    )
    code, _ = process.end(signal.SIGINT)
    assert code == 0


@pytest.mark.parametrize("told_by", ["parameter", "/tf_static"])
def test_cameras_from_camera_info_and_extrinsics(start, peer, model_path, images, rig, told_by):
    """Without a rig file: topics, CameraInfo, and the cameras' poses, as parameters or on /tf_static."""
    silhouettes, _ = images
    topics = [f"/camera{i}/silhouette" for i in range(CAMERAS)]
    poses, transforms = [], []
    for i, c in enumerate(rig):
        T = np.linalg.inv(c.T_camera_world @ upright_from("z"))
        poses += [*T[:3, 3], *matrix_to_quat(T[:3, :3])]
        transforms.append(stamped(0, "map", f"camera{i}", T))
    listed = "[" + ", ".join(f"{float(p):.9f}" for p in poses) + "]"
    given = {"extrinsics": listed} if told_by == "parameter" else {}
    process = start_node(start, model=model_path, topics=topics, **given)
    process.wait_for("waits for CameraInfo of /camera0/silhouette")
    if told_by == "/tf_static":
        peer.node.create_publisher(TFMessage, told_by, LATCHED).publish(TFMessage(transforms=transforms))
    infos = [peer.publisher(CameraInfo, f"/camera{i}/camera_info") for i in range(CAMERAS)]
    c = SMALL
    deadline = time.monotonic() + 240.0
    while "is ready" not in process.output:  # again, as sensors do: best effort may be lost
        assert time.monotonic() < deadline, process.output
        for i, publisher in enumerate(infos):
            publisher.publish(
                CameraInfo(
                    header=make_header(1, f"camera{i}"), width=c.width, height=c.height,
                    k=[c.fx, 0.0, c.cx, 0.0, c.fy, c.cy, 0.0, 0.0, 1.0],
                    distortion_model="plumb_bob", d=[0.0] * 5,
                )
            )  # fmt: skip
            peer.spin(0.05)
    live = Rehearsal(peer, process)
    live.play_until_found(silhouettes)


class DepthRehearsal(Rehearsal):
    """Depth cameras around a person in a room."""

    def __init__(self, peer, process, rig):
        super().__init__(peer, process, 0)
        self.cameras = [peer.publisher(Image, f"/{c.name}/image_raw") for c in rig]
        self.rig, self.renderer, self.room = rig, RigRenderer(rig), room_around()
        self.shown = []
        clip = perform("swing", 50, 0.7)
        scenes = list(dressed_frames(Wearer(BodyShape(stature_m=1.66)), clip))
        self.scenes = [meshes for meshes, _ in scenes]
        self.hips = [posed.nodes[0] for _, posed in scenes]

    def show_scene(self, index, cameras=None, change=None):
        """Show one scene and wait for its answer."""
        depths = self.renderer.depths([*self.scenes[index % len(self.scenes)], self.room])
        self.shown.append(depths)
        stamp_ns = START_NS + index * 33_000_000

        def send():  # what was lost; an image that is there already changes nothing
            for c in range(len(self.rig)) if cameras is None else cameras:
                shown = change(c, depths[c]) if change else depths[c]
                message = Image(
                    height=shown.shape[0], width=shown.shape[1], encoding="32FC1", step=4 * shown.shape[1],
                    data=shown.tobytes(),
                )  # fmt: skip
                message.header = make_header(stamp_ns, self.rig[c].name)
                self.cameras[c].publish(message)

        self.peer.ask(
            send,
            lambda: any(msg_to_skeleton(s).stamp_ns == stamp_ns for s in self.skeletons),
            what=lambda: f"an answer to {index}:\n{self.process.output}\n it",
            every_s=3.0,
        )
        return msg_to_skeleton(self.skeletons[-1])


def offline(folder, live, rig):
    """Record what was shown, run it offline, and give the skeletons."""
    with ViewWriter(folder / "shown.mcap") as writer:
        for i, images in enumerate(live.shown):
            for c, image in zip(rig, images, strict=True):
                writer.write(f"/{c.name}/image_raw", START_NS + i * 33_000_000, c.name, image)
    cameras = load_rig(folder / "rig.yaml")
    pipeline = VolumePipeline(VolumeModel.load(folder / "model.npz"), cameras, CONFIG)
    process_recording(ViewReader(folder / "shown.mcap", cameras, "depth"), folder / "found.mcap", pipeline)
    return read_skeletons(folder / "found.mcap")


def test_depth_cameras(start, peer, tmp_path):
    """A person between walls and on a floor is cut out of two cameras' images; one fails, and is lost.

    Until then what is published is, bit for bit, what an offline run of the same images gives.
    """
    clips = [perform("swing", seed, 3.0) for seed in (1, 2)]
    views = simulate_views(clips, [Wearer(BodyShape(stature_m=1.7))], "depth", 8)
    learn_model(views, LearnConfig(iterations=30)).save(tmp_path / "model.npz")
    rig = depth_ring(2)
    save_rig(tmp_path / "rig.yaml", rig, [f"/{c.name}/image_raw" for c in rig])
    process = start_node(start, model=tmp_path / "model.npz", rig=tmp_path / "rig.yaml", **WHOLE)
    live = DepthRehearsal(peer, process, rig)
    answers = [live.show_scene(i) for i in range(12)]
    for here, there in zip(answers, offline(tmp_path, live, rig), strict=True):
        assert here.source == there.source == Source.VOLUME and here.stamp_ns == there.stamp_ns
        assert np.array_equal(here.positions, there.positions)
        assert np.array_equal(here.quats_xyzw, there.quats_xyzw)
        assert here.confidence == there.confidence
    found = answers[-1]
    assert not found.is_lost and found.frame_id == "map"
    assert 1.3 < found.positions[4, 2] < 1.8
    assert np.linalg.norm(found.positions[0] - upright_from("z")[:3, :3].T @ live.hips[11]) < 0.12
    peer.until(lambda: live.value("cameras") == "2", what="the number of cameras")

    # one shows an empty room, then half of it, then only the other is there, then nobody is
    blind = live.renderer.depths([live.room])
    assert not live.show_scene(12, change=lambda c, depth: blind[c] if c else depth).is_lost
    process.wait_for("/depth1/image_raw shows nobody while others do: it is ignored")
    cut = live.show_scene(13, change=lambda c, depth: depth[:100] if c else depth)
    assert not cut.is_lost
    process.wait_for("dropped, bad image: /depth1/image_raw: the image of depth1 is 320 x 100")
    peer.set("/depth_pose/volume", views__patience=0.3, views__gone_after=0.5)
    assert not live.show_scene(14, cameras=[0]).is_lost  # answered after `patience`
    peer.until(lambda: live.value("answered without: /depth1/image_raw") == "1", what="the count")
    index = 15
    while "nothing from /depth1/image_raw; goes on without" not in process.output:
        assert index < 1000, process.output
        live.show_scene(index, cameras=[0])
        index += 1
    lost = live.show_scene(index, change=lambda c, depth: blind[c])
    assert lost.is_lost


def test_paused_and_resumed(start, peer, model_path, images, rig_path):
    """Started with `depth-pose volume live`; managed like the others, it waits for a manager if told to."""
    silhouettes, _ = images
    params = rig_path.with_name("params.yaml")
    params.write_text("/**:\n  ros__parameters:\n    autostart: false\n    track.stature: 1.66\n")
    command = ["-m", "depth_pose.cli", "volume", "live", "--model", model_path, "--rig", rig_path]
    process = start(*command, "--params", params, "--voxel", 0.03)
    peer.until(lambda: peer.node.count_publishers("/diagnostics"), 240.0, "the node")
    assert bring(True, ["volume"]) == {"volume": "active"}
    live = Rehearsal(peer, process)
    live.play(silhouettes, lambda: live.skeletons)
    assert bring(False, ["volume"]) == {"volume": "inactive"}
    paused_ns = START_NS + round(live.next * 1e9 / FPS)
    live.play(silhouettes, lambda: int(live.value("ignored while paused") or 0) > 10 * CAMERAS)
    assert all(msg_to_skeleton(s).stamp_ns < paused_ns for s in live.skeletons)
    peer.until(lambda: live.messages()[-1] == "is paused", what="its word")
    assert bring(True, ["volume"]) == {"volume": "active"}
    live.skeletons.clear()
    live.play(silhouettes, lambda: live.skeletons)


def room_around():
    """A floor and two walls, before and behind, of two triangles each, both sides."""
    corners = [[x, y, z] for z in (-4, 4) for y in (0, 3) for x in (-4, 4)]
    quads = [(0, 1, 5, 4), (0, 1, 3, 2), (4, 5, 7, 6)]
    faces = [f for a, b, c, d in quads for f in ([a, b, c], [a, c, d])]
    return np.array(corners, float), np.array(faces + [f[::-1] for f in faces], np.int32)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({}, "give the parameter model"),
        ({"model": "/no/such.npz"}, "cannot be read as a volume model"),
        ({"model": "MODEL"}, "give the parameter rig"),
        ({"model": "MODEL", "topics": "['/a']", "extrinsics": "[1.0,2.0,3.0,0.0,0.0,0.0,1.0,9.0]"}, "need 7"),
        ({"model": "MODEL", "rig": "/no/rig.yaml"}, "cannot be read"),
        ({"model": "MODEL", "track.particles": "-3"}, "track.particles"),
        ({"model": "MODEL", "colour": "blue"}, "has the parameter colour"),
    ],
)
def test_settings_that_cannot_be_used(start, model_path, given, says):
    arguments = ["-m", "depth_pose.ros.nodes.volume_node", "--ros-args"]
    for name, value in given.items():
        arguments += ["-p", f"{name}:={model_path if value == 'MODEL' else value}"]
    process = start(*arguments)
    assert process.process.wait(LIMIT_S) == 2
    assert says in process.output
