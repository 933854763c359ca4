"""What listens where, who may read what, and two suites side by side: real sockets, real accounts."""

import contextlib
import fcntl
import os
import shutil
import socket
import stat
import struct
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
import scene
from depth_pose_msgs.msg import SkeletonArray
from peer import LIMIT_S, RELIABLE, SENSOR
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Header
from test_denoise_node import image_msg, info_msg

from depth_pose.core.errors import ConfigError
from depth_pose.ros import LOCAL_PROFILE_PATH, PROFILE_PATH, PROFILE_VARIABLE, UDP_PROFILE_PATH, stay_local
from depth_pose.ros.messages.basics import make_header, ns_to_stamp
from depth_pose.ros.process.shared_memory import other_account_advice
from depth_pose.ros.process.supervisor import NODES, Suite


def open_files(pid):
    """Return what a process holds open; it may close a file while they are listed."""
    found = set()
    for f in Path(f"/proc/{pid}/fd").iterdir():
        with contextlib.suppress(FileNotFoundError):
            found.add(os.readlink(f))
    return found


def addresses(pid):
    """Return the local addresses of a process's network sockets, of every kind."""
    links = open_files(pid)
    found = set()
    for kind in ("udp", "udp6", "udplite", "udplite6", "tcp", "tcp6", "raw", "raw6"):
        table = Path(f"/proc/net/{kind}")
        rows = [line.split() for line in table.read_text().splitlines()[1:]] if table.exists() else []
        hexes = [row[1].partition(":")[0] for row in rows if f"socket:[{row[9]}]" in links]
        found |= {socket.inet_ntoa(struct.pack("<I", int(h, 16))) if len(h) == 8 else h for h in hexes}
    return found


def processes(pid):
    """Yield a process and all its descendants."""
    for children in Path(f"/proc/{pid}/task").glob("*/children"):
        for child in children.read_text().split():
            yield from processes(int(child))
    yield pid


def segments(pid):
    """List the shared memory of a process, and its locks, which it holds open."""
    locks = {f for f in open_files(pid) if f.startswith("/dev/shm/fastrtps_") and Path(f).exists()}
    return [Path(f) for f in locks | {f.removesuffix("_el") for f in locks}]


@pytest.mark.skipif(os.geteuid() != 0, reason="only root makes files of another account")
def test_programs_of_another_account_are_named_where_nothing_comes(start, peer):
    """Shared memory does not connect two accounts: topics are listed, and nothing comes."""
    file = Path("/dev/shm/fastrtps_00000000000f00d1_el")
    process = start(Path(__file__).with_name("trial_node.py"))
    process.wait_for("is ready")
    publisher = peer.node.create_publisher(Image, "/depth_pose/a", 1)
    try:
        file.touch()
        os.chown(file, 54321, -1)
        assert "54321" not in other_account_advice(), "it is left from a process that has ended"
        with file.open() as handle:
            fcntl.flock(handle, fcntl.LOCK_EX)
            process.wait_for("54321")
    finally:
        file.unlink()
        peer.node.destroy_publisher(publisher)
    assert "has 1 publisher(s) but nothing came" in process.output
    assert f"start one with {PROFILE_VARIABLE}={UDP_PROFILE_PATH}" in process.output


def test_a_profile_of_udp_alone_reaches_those_with_shared_memory(start, peer, monkeypatch):
    monkeypatch.setenv(PROFILE_VARIABLE, str(UDP_PROFILE_PATH))
    process = start(Path(__file__).with_name("trial_node.py"))
    process.wait_for("is ready")
    assert not [s for s in segments(process.process.pid) if s.exists()]
    answers = peer.listen(Header, "/depth_pose/answer")
    images = peer.publisher(Image, "/depth_pose/a")
    peer.ask(
        lambda: images.publish(Image(header=make_header(5, "optical"), height=1, width=2)),
        lambda: answers,
        what=lambda: process.output,
    )


def read_as_nobody(paths):
    """Try to read files from an account without rights; return each result, or nothing if impossible."""
    code = (
        "import sys\n"
        "for path in sys.argv[1:]:\n"
        "    try:\n        open(path, 'rb').read(1); print('read')\n"
        "    except PermissionError:\n        print('refused')\n"
    )
    if os.getuid() != 0 or not shutil.which("setpriv"):
        return []
    nobody = ["setpriv", "--reuid", "65534", "--clear-groups", "env", "-i", "python3", "-c", code]
    return subprocess.run([*nobody, *paths], capture_output=True, text=True, timeout=300).stdout.split()


def test_a_local_suite_is_this_machine_s_and_this_account_s(domain, tmp_path):
    """Sockets on the loopback interface alone; shared memory that no other account can read."""
    assert os.environ[PROFILE_VARIABLE] == str(LOCAL_PROFILE_PATH)
    earlier = {*processes(os.getpid())}  # what other tests have left here
    with Suite(nodes=["denoise"], sink=str) as suite:
        assert addresses(suite.pid("denoise")) == {"127.0.0.1"}
        check_private(segments(suite.pid("denoise")))
        everyone = {*processes(os.getpid())} - earlier
        assert suite.pid("denoise") in everyone
        assert set().union(*map(addresses, everyone)) == {"127.0.0.1"}


_GROUPS = """
import fcntl, socket, struct, time
from pathlib import Path
with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:  # lo: up, and with multicast
    fcntl.ioctl(any_socket, 0x8914, struct.pack("16sh", b"lo", 0x1 | 0x40 | 0x1000))
import rclpy
rclpy.init()
node = rclpy.create_node("listener")
print("239.255.0.1" if "0100FFEF" in Path("/proc/net/igmp").read_text() else "no group")
"""


def own_network():
    """Return the command that runs another one in its own network, without an interface that is up."""
    command = ["unshare", "--net", *([] if os.getuid() == 0 else ["--map-root-user"])]
    if not shutil.which("unshare") or subprocess.run([*command, "true"], timeout=300).returncode:
        pytest.skip("this account can make no network of its own")  # a container's, or the kernel forbids it
    return command


@pytest.mark.parametrize("options", [[], ["--local"]], ids=["usual", "local"])
def test_a_machine_without_an_interface_is_one_line(domain, monkeypatch, bank_path, options):
    """Nodes would wait for one another, and no log would say why."""
    monkeypatch.setenv(PROFILE_VARIABLE, str(LOCAL_PROFILE_PATH if options else PROFILE_PATH))
    command = [sys.executable, "-m", "depth_pose.cli", "up", "--bank", str(bank_path), *options]
    done = subprocess.run([*own_network(), *command], capture_output=True, text=True, timeout=300)
    assert done.returncode == 2 and "ip link set lo up" in done.stderr, done.stdout + done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("profile", "group"), [(LOCAL_PROFILE_PATH, "no group"), (PROFILE_PATH, "239.255.0.1")]
)
def test_a_local_suite_joins_no_multicast_group(domain, monkeypatch, profile, group):
    """In a network of its own, where nobody else can have joined one; the usual profile joins one."""
    monkeypatch.setenv(PROFILE_VARIABLE, str(profile))
    done = subprocess.run(
        [*own_network(), sys.executable, "-c", _GROUPS], capture_output=True, text=True, timeout=300
    )
    assert group in done.stdout, done.stdout + done.stderr


def modes(found):
    return {stat.S_IMODE(f.stat().st_mode) for f in found}


def has_messages(found):
    """Whether a segment is large enough for the messages."""
    return any(f.stat().st_size > 1 << 20 for f in found)


def check_private(found):
    assert has_messages(found)
    assert modes(found) == {0o600}
    assert set(read_as_nobody(found)) <= {"refused"}


def test_what_is_played_is_this_account_s(start, tmp_path):
    """A recording's images lie in the player's shared memory."""
    path = scene.write_recording(tmp_path / "small.mcap", 3)
    player = start("-m", "depth_pose.cli", "play", path, "--wait-for", 1)
    deadline = time.monotonic() + LIMIT_S
    while not has_messages(found := segments(player.process.pid)) or modes(found) != {0o600}:
        assert time.monotonic() < deadline, f"{found}\n{player.output}"
        time.sleep(0.05)
    check_private(found)


def test_the_default_profile_listens_to_the_network(domain, monkeypatch):
    monkeypatch.setenv(PROFILE_VARIABLE, str(PROFILE_PATH))
    with Suite(nodes=["denoise"], sink=str) as suite:
        assert "0.0.0.0" in addresses(suite.pid("denoise"))


def test_staying_local_does_not_override_a_profile_of_the_user(monkeypatch):
    monkeypatch.setenv(PROFILE_VARIABLE, "/somewhere/mine.xml")
    with pytest.raises(ConfigError, match="profile of yours"):
        stay_local()


def test_a_rule_that_renames_nothing_is_refused():
    with pytest.raises(ConfigError, match="__ns:=/left"):
        Suite(remap=["/left"])


class Camera:
    """A sensor of its own topics, at ten frames a second."""

    def __init__(self, peer, side):
        self.images = peer.node.create_publisher(Image, f"/{side}/depth", SENSOR)
        self.infos = peer.node.create_publisher(CameraInfo, f"/{side}/info", SENSOR)
        self.frames = [(image_msg(f), info_msg(f)) for f in scene.frames(10)]
        self.frame_id = f"{side}_optical"
        self.stop = threading.Event()
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()

    def run(self):
        while True:
            for image, info in self.frames:
                image.header.stamp = info.header.stamp = ns_to_stamp(time.time_ns())
                image.header.frame_id = self.frame_id
                self.infos.publish(info)
                self.images.publish(image)
                if self.stop.wait(0.1):
                    return


def test_two_suites_in_one_domain_each_follow_their_camera(domain, peer, bank_path):
    """``up -r __ns:=/left`` and ``/right``: both answer, each with its own camera's frames alone."""
    suites, heard, cameras = [], {}, []
    try:
        for side in ("left", "right"):
            remap = (
                f"__ns:=/{side}",
                f"/camera/depth/image_raw:=/{side}/depth",
                f"/camera/depth/camera_info:=/{side}/info",
            )
            suites.append(Suite(bank=bank_path, remap=remap, sink=str))
            suites[-1].start()
            heard[side] = peer.listen(SkeletonArray, f"/{side}/skeletons", RELIABLE)
        for suite, side in zip(suites, heard, strict=True):
            suite.wait_ready()
            cameras.append(Camera(peer, side))
        peer.until(lambda: all(len(h) > 5 for h in heard.values()), what="both suites' skeletons")
    finally:
        for camera in cameras:
            camera.stop.set()
            camera.thread.join(60.0)
        codes = [suite.stop() for suite in suites]
    for side, messages in heard.items():
        assert {m.header.frame_id for m in messages} == {f"{side}_optical"}
        assert any(m.skeletons for m in messages)
    assert codes == [dict.fromkeys(NODES, 0)] * 2
    names = {name for name, _ in peer.node.get_topic_names_and_types()}
    assert not [n for n in names if n.startswith("/depth_pose/s")]  # nothing of the two is left where one was
