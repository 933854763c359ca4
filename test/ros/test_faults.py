"""The faults of docs/faults.md: each is done here, to real nodes over real DDS.

How long each takes is measured by ``benchmarks/faults.py``.
"""

import functools
import itertools
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
import scene
from depth_pose_msgs.msg import Skeleton
from diagnostic_msgs.msg import DiagnosticArray
from peer import HEARING, RELIABLE, SENSOR, Peer, join_own_domain
from sensor_msgs.msg import CameraInfo, Image
from test_denoise_node import image_msg, info_msg

from depth_pose.core.config import MAX_STAMP_GAP_NS
from depth_pose.ros.messages.basics import ns_to_stamp, stamp_to_ns
from depth_pose.ros.process import NODES
from depth_pose.ros.process.supervisor import Suite
from depth_pose.ros.tools.bag import Player

IMAGE, INFO = "/camera/depth/image_raw", "/camera/depth/camera_info"
FPS = 15.0
PATIENCE_S = 120.0
"""Hard limit of every wait."""


@functools.cache
def frame_msgs():
    return [(image_msg(f), info_msg(f)) for f in scene.frames(25)]


class Sensor:
    """Publishes frames at a rate from a thread of its own, with the time as stamp, until unplugged."""

    def __init__(self, peer):
        self.peer, self.fps, self._sent = peer, FPS, {}
        self.images = peer.node.create_publisher(Image, IMAGE, SENSOR)
        self.infos = peer.node.create_publisher(CameraInfo, INFO, SENSOR)
        self._unplugged = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self):
        for image, info in itertools.cycle(frame_msgs()):
            stamp_ns = time.time_ns()
            image.header.stamp = info.header.stamp = ns_to_stamp(stamp_ns)
            self._sent[stamp_ns] = time.monotonic()
            self.infos.publish(info)
            self.images.publish(image)
            if self._unplugged.wait(1.0 / self.fps):
                return

    @property
    def sent(self):
        """When frames were sent, by stamp; a copy, as the thread goes on."""
        return self._sent.copy()

    def unplug(self):
        if not self._unplugged.is_set():
            self._unplugged.set()
            self._thread.join(PATIENCE_S)
            self.peer.node.destroy_publisher(self.images)
            self.peer.node.destroy_publisher(self.infos)


class Heard:
    """Skeletons, with the time each came."""

    def __init__(self, peer):
        self.came = {}
        self.stamps = []
        self.sources = []
        peer.node.create_subscription(Skeleton, "/depth_pose/skeleton", self._take, HEARING)

    def _take(self, skeleton):
        self.stamps.append(stamp_to_ns(skeleton.header.stamp))
        self.came[self.stamps[-1]] = time.monotonic()
        self.sources.append((skeleton.source, skeleton.body_id))

    def latency_s(self, sensor, since_s=0.0):
        sent = sensor.sent
        both = [s for s in self.came if s in sent and sent[s] >= since_s]
        return sorted(self.came[s] - sent[s] for s in both)


@pytest.fixture(scope="module")
def domain():
    """One domain for all tests: they share the suite, and the node that listens to it."""
    with pytest.MonkeyPatch.context() as patch:
        yield join_own_domain(patch)


@pytest.fixture(scope="module")
def peer(domain):
    with Peer() as made:
        yield made


@pytest.fixture(scope="module")
def running(bank_path, peer):
    lines = []
    with Suite(bank=bank_path, sink=lines.append) as suite:
        yield suite, Heard(peer), lines


@pytest.fixture
def live(running, peer):
    """A suite that answers a sensor's frames."""
    suite, heard, lines = running
    peer.until(lambda: all(map(suite.is_ready, NODES)), PATIENCE_S, lambda: "\n".join(lines))
    for kept in (lines, heard.came, heard.stamps, heard.sources):
        kept.clear()
    sensor = Sensor(peer)
    peer.until(lambda: heard.latency_s(sensor)[8:], PATIENCE_S, lambda: "skeletons:\n" + "\n".join(lines))
    yield suite, sensor, heard, lines
    sensor.unplug()


def own_segments(pid):
    """Shared memory of messages that a process holds the lock of."""
    files = {os.readlink(f) for f in Path(f"/proc/{pid}/fd").iterdir() if f.exists()}
    locks = [f for f in files if f.startswith("/dev/shm/fastrtps_") and f.endswith("_el") and "port" not in f]
    return [Path(f.removesuffix("_el")) for f in locks]


def await_replaced(suite, peer, heard, lines, before, gone):
    """Wait until nodes are new and ready, and skeletons come again; the others must be the same."""
    peer.until(
        lambda: all(suite.is_ready(n) and (suite.pid(n) != before[n]) == (n in gone) for n in NODES),
        PATIENCE_S,
        lambda: f"another {' and '.join(gone)}:\n" + "\n".join(lines),
    )
    settled = time.monotonic()
    peer.until(lambda: max(heard.came.values()) > settled, PATIENCE_S, "skeletons again")


def test_a_looping_recording(bank_path, peer, tmp_path):
    """Stamps jump back at each turn: what was kept is dropped, and the frames are answered.

    It comes first, as its suite and the others' would hear each other.
    """
    path = scene.write_recording(tmp_path / "small.mcap", 20)
    lines, sent = [], []
    with Suite(bank=bank_path, parameters={"use_sim_time": True}, sink=lines.append):
        heard = Heard(peer)

        def told(message, now_ns):
            if message.topic == IMAGE:
                sent.append(now_ns)

        player = Player(path, loop=True, rate=0.6, wait_for_subscribers=[IMAGE, INFO], on_message=told)
        playing = threading.Thread(target=player.run, daemon=True)
        playing.start()

        def ids():
            return {body for source, body in heard.sources if source != Skeleton.LOST}

        # nothing says that it is the same person as before a jump
        peer.until(
            lambda: len(sent) >= 65 and scene.turns(heard.stamps) >= 3 and len(ids()) >= 3,
            PATIENCE_S,
            lambda: f"{ids()}\n" + "\n".join(lines),
        )
        player.stop()
        playing.join(PATIENCE_S)
        peer.spin(0.5)
    assert any("went back" in line for line in lines)
    assert not any("Traceback" in line for line in lines), "\n".join(lines)


@pytest.mark.parametrize("gone", [*((name,) for name in NODES), NODES], ids=[*NODES, "all"])
def test_killed_nodes(live, peer, gone):
    """kill -9, of one or of all at once: skeletons again, without anybody's help; the others go on."""
    suite, _, heard, lines = live
    before = {name: suite.pid(name) for name in NODES}
    left = [segment for name in gone for segment in own_segments(before[name])]
    assert left
    for name in gone:
        os.kill(before[name], signal.SIGKILL)
    await_replaced(suite, peer, heard, lines, before, gone)
    peer.until(lambda: not any(map(Path.exists, left)), PATIENCE_S, "the end of the shared memory they left")
    assert all(segment.exists() for n in NODES for segment in own_segments(suite.pid(n)))
    assert not any("Traceback" in line for line in lines), "\n".join(lines)


def test_a_hung_node(live, peer):
    """SIGSTOP: it lives, and answers nothing. It is killed and replaced."""
    suite, _, heard, lines = live
    before = {name: suite.pid(name) for name in NODES}
    os.kill(before["matcher"], signal.SIGSTOP)
    await_replaced(suite, peer, heard, lines, before, ["matcher"])
    assert sum("[matcher] gave no sign of life" in line for line in lines) == 1
    assert not Path(f"/proc/{before['matcher']}").exists()


def test_a_sensor_that_is_unplugged_and_comes_back(live, peer):
    """Nothing comes for six seconds: that is told; with the first frame after it all is as before."""
    _, sensor, heard, lines = live
    sensor.unplug()
    missing = ("nobody publishes", "publisher(s) but nothing came")  # DDS may remember the publisher
    warnings = lambda: [x for x in lines if any(text in x for text in missing)]  # noqa: E731
    peer.until(warnings, PATIENCE_S, lambda: "the warning:\n" + "\n".join(lines))
    assert "/depth_pose/labels" not in warnings()[0]  # of the same type, but the node's own
    told = peer.listen(DiagnosticArray, "/diagnostics", RELIABLE)
    peer.until(
        lambda: any(s.message.startswith("nothing from") for m in told for s in m.status),
        PATIENCE_S,
        "the diagnostics",
    )
    assert not any("Traceback" in line for line in lines), "\n".join(lines)
    again = Sensor(peer)
    peer.until(again.images.get_subscription_count, what="the denoise node")
    heard.came.clear()
    peer.until(lambda: len(heard.came) > 3, PATIENCE_S, "skeletons again")
    again.unplug()
    assert not any("starting it again" in line for line in lines), "\n".join(lines)


def test_the_frame_rate_changes(live, peer):
    """From 15 frames a second to 5 and to 25, as drivers do in the dark: every rate is followed."""
    _, sensor, heard, lines = live
    for fps in (5.0, 25.0):
        sensor.fps = fps
        peer.spin(0.5)
        since = time.monotonic()
        enough = lambda s=since: sum(t > s for t in heard.came.values()) >= 10  # noqa: E731
        peer.until(enough, PATIENCE_S, lambda f=fps: f"ten at {f}:\n" + "\n".join(lines))
    assert not any("Traceback" in line for line in lines), "\n".join(lines)
    assert {source for source, _ in heard.sources[8:]} <= {Skeleton.REFINED, Skeleton.RECOVERED}
    sent = sensor.sent
    answered = [s for s in sorted(heard.came) if s in sent]
    pause_ns = max(b - a for a, b in itertools.pairwise(answered))
    assert len({body for _, body in heard.sources}) == 1 or pause_ns > MAX_STAMP_GAP_NS


BURN = "while True: sum(range(10000))"


def test_another_program_takes_the_processor(live, peer):
    """Every core is taken: frames are dropped and counted, latency stays bounded, nothing piles up."""
    _, sensor, heard, lines = live
    sensor.fps = 30.0
    count = len(os.sched_getaffinity(0)) + 1
    burners = [subprocess.Popen([sys.executable, "-c", BURN]) for _ in range(count)]
    since, ended = time.monotonic(), float("inf")

    def under_load():
        return [(t, heard.came[s]) for s, t in sensor.sent.items() if s in heard.came and since <= t < ended]

    try:
        peer.until(lambda: len(under_load()) > 20, PATIENCE_S, lambda: "\n".join(lines))
    finally:
        for burner in burners:
            burner.kill()
            burner.wait(PATIENCE_S)
    ended = time.monotonic()

    def is_over():
        """The latency is again what it was at its worst, or better."""
        after = heard.latency_s(sensor, ended)
        worst = max((came - sent for sent, came in under_load()), default=0.0)
        return len(after) > 10 and after[len(after) // 2] <= worst + 0.05

    peer.until(is_over, PATIENCE_S, lambda: "\n".join(lines))
    under = sorted(came - sent for sent, came in under_load())
    came = sorted(came for _, came in under_load())
    pause = max(b - a for a, b in itertools.pairwise(came))
    # four stages, each with one frame that it works at and one that waits; a queue that grew would end here
    assert under[-1] < max(2.0, 8.0 * pause)
