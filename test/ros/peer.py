"""A node of the tests' own: publishes, and keeps what it hears; spun by hand."""

import contextlib
import fcntl
import itertools
import os
import random
import tempfile
import time
from pathlib import Path

import rclpy
from rcl_interfaces.srv import SetParameters
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy

from depth_pose.core.errors import DepthPoseError
from depth_pose.ros import LOCAL_PROFILE_PATH, PROFILE_VARIABLE
from depth_pose.ros.nodes.lifecycle import set_active

RELIABLE = QoSProfile(depth=1000)
SENSOR = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
HEARING = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)
"""As a sensor's, for who must miss nothing even after it stood still for seconds."""

HERE = Path(__file__).parent
SOURCE = HERE.parents[1] / "src"

LIMIT_S = 120.0
"""Hard limit of every wait for what must come: it tells that something is wrong, not how fast it is."""


def _own_domains():
    """Domains that no other worker of pytest takes, each again after all others: a node may linger in one."""
    worker = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
    numbers = list(range(1 + worker % 4, 101, 4))
    random.SystemRandom().shuffle(numbers)
    return itertools.cycle(numbers)


_DOMAINS = _own_domains()
_HELD = []
"""The lock of the domain in use."""


def _take_domain():
    """Take the next domain that no other run of tests on this machine is on; hold it until the next call."""
    folder = Path(tempfile.gettempdir()) / f"depth_pose_domains_{os.getuid()}"
    folder.mkdir(exist_ok=True)
    for number in _DOMAINS:
        lock = (folder / str(number)).open("w")
        with contextlib.suppress(BlockingIOError):
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            _HELD[:] = [lock]
            return number
        lock.close()
    raise AssertionError


def join_own_domain(monkeypatch):
    """Have this process and its children talk on a domain that nobody else is on; gives its number."""
    number = _take_domain()
    monkeypatch.setenv("ROS_DOMAIN_ID", str(number))
    monkeypatch.setenv(PROFILE_VARIABLE, str(LOCAL_PROFILE_PATH))
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "SYSTEM_DEFAULT")
    monkeypatch.setenv("PYTHONUNBUFFERED", "1")
    path = os.pathsep.join(filter(None, [str(SOURCE), str(HERE), os.environ.get("PYTHONPATH")]))
    monkeypatch.setenv("PYTHONPATH", path)
    return number


def slowdown():
    """Time that a calculation takes now, as a multiple of the processor time it uses."""
    wall_s, used_s = time.perf_counter(), time.thread_time()
    sum(range(10_000_000))
    return (time.perf_counter() - wall_s) / (time.thread_time() - used_s)


def patient(seconds):
    """Time limit of an action that takes at most this many seconds where each process has a core."""
    return seconds * max(1.0, slowdown(), os.getloadavg()[0] / len(os.sched_getaffinity(0)))


def within(seconds, attempt, tries=3):
    """Assert that an action takes at most this long in one of a few attempts.

    A virtual machine's core may stand still for a second or two, which its processes cannot detect.

    Parameters
    ----------
    seconds : float
        Where each process has a core.
    attempt : callable
        Does it; returns the seconds that it took.
    tries : int
    """
    took = []
    for _ in range(tries):
        took.append(attempt())
        if took[-1] < patient(seconds):
            return
    raise AssertionError(f"it took {took} s, and not {seconds}")


def bring(active, nodes):
    """Pause or resume, again where a node's services were not found in the seconds that takes at most."""
    for left in reversed(range(10)):
        try:
            return set_active(active, nodes)
        except DepthPoseError as error:  # noqa: PERF203
            if "is the node running" not in str(error) or not left:
                raise
    raise AssertionError


class Peer:
    def __enter__(self):
        self.context = Context()
        rclpy.init(context=self.context, args=[])
        self.node = rclpy.create_node("peer", context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.heard = {}
        return self

    def __exit__(self, *_):
        self.executor.shutdown()
        self.node.destroy_node()  # left to the garbage collector, it once took the process along
        rclpy.try_shutdown(context=self.context)

    def listen(self, kind, topic, qos=HEARING):
        self.heard[topic] = []
        self.node.create_subscription(kind, topic, self.heard[topic].append, qos)
        return self.heard[topic]

    def publisher(self, kind, topic, qos=SENSOR, subscribers=1):
        made = self.node.create_publisher(kind, topic, qos)
        self.until(lambda: made.get_subscription_count() >= subscribers, what=f"subscribers of {topic}")
        self.spin(0.2)  # the publisher finds the subscriber first
        return made

    def until(self, condition, timeout_s=LIMIT_S, what="it"):
        deadline = time.monotonic() + timeout_s
        while not condition():
            assert time.monotonic() < deadline, (
                f"{what() if callable(what) else what} did not come in {timeout_s} s"
            )
            self.executor.spin_once(timeout_sec=0.02)

    def spin(self, seconds):
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            self.executor.spin_once(timeout_sec=0.02)

    def ask(self, send, condition, what="it", every_s=1.0):
        """Send, and again where nothing came of it: what is best effort may be lost while nodes meet."""
        deadline = time.monotonic() + LIMIT_S
        while True:
            send()
            again = time.monotonic() + every_s
            while time.monotonic() < again:
                if condition():
                    return
                self.executor.spin_once(timeout_sec=0.02)
            assert time.monotonic() < deadline, f"{what() if callable(what) else what} did not come"

    def call(self, kind, name, request, timeout_s=LIMIT_S):
        client = self.node.create_client(kind, name)
        self.until(client.service_is_ready, timeout_s, name)
        future = client.call_async(request)
        self.until(future.done, timeout_s, name)
        return future.result()

    def put(self, node, name, value):
        """Set a parameter of a running node; gives what the node says to it."""
        wanted = Parameter(name, value=value).to_parameter_msg()
        request = SetParameters.Request(parameters=[wanted])
        return self.call(SetParameters, f"{node}/set_parameters", request).results[0]

    def set(self, node, **values):
        """Set parameters of a running node, ``__`` for the dot in their names."""
        for name, value in values.items():
            answer = self.put(node, name.replace("__", "."), value)
            assert answer.successful, answer
