"""A viewer's subscriptions to running nodes: the newest depth, all skeletons, diagnostics.

Messages are kept as bytes; only those that are shown are decoded. Subscriptions match each publisher's
reliability and keep short queues, so a slow viewer never blocks a publisher.
"""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from depth_pose.core.errors import InputError
from depth_pose.core.frame import DepthFrame
from depth_pose.core.printable import printable
from depth_pose.core.result import Skeleton
from depth_pose.io import schemas
from depth_pose.io.calibration import is_rectified
from depth_pose.io.camera_infos import CameraInfos
from depth_pose.io.mcap_read import frame_of_cloud, make_frame
from depth_pose.io.messages import read_message, read_people, stamp_of
from depth_pose.ros.process.security import init_context
from depth_pose.ros.tools.bag import header_stamp_ns

_HELD, _HELD_BYTES = 64, 64 << 20
"""Maximum number and memory of depth messages that wait for their skeletons: two seconds of 640 x 480 with 16
bits at 30 a second."""

_MOST_BYTES = 2 << 20
"""Maximum size of a message of skeletons: 255 people of 2 kB each, and a margin."""

_LEAST_BYTES = 12
"""Bytes of a message's stamp; a shorter message is invalid."""

_UNANSWERED_NS = 2_000_000_000
"""Depth this much newer than the newest skeletons is shown without any. Nodes on free cores take a tenth of
a second; on busy cores more than a second was observed."""

_QUEUE = 8
"""Queue length of a topic for the viewer; skeletons whose depth image was lost are not shown."""

_BARE_EVERY_NS = 100_000_000
"""Time between frames shown without skeletons, which may still arrive."""

_LOOK_S = 0.5
"""Time between checks of topics and their publishers, seconds."""
_ANSWER_S = 2.0
"""Time limit for a node to answer a service, seconds."""

_STALE_S = 5.0
"""A node silent for this long is no longer listed; it reports once a second."""

_PARAMETERS = {
    "follow": ("recovery", "follow"),
    "zone": ("denoise", "zone"),
    "people": ("denoise", "segment.most_people"),
}


@dataclass
class _Listened:
    """A subscribed topic, and its QoS."""

    kind: type
    callback: Callable[[bytes], None]
    is_reliable: bool = False
    subscription: Any = None


@dataclass(frozen=True)
class Heard:
    """A frame, and all its skeletons; None without an answer."""

    frame: DepthFrame
    skeletons: tuple[Skeleton, ...] | None


@dataclass(frozen=True)
class NodeState:
    """A node's state from ``/diagnostics``.

    Attributes
    ----------
    name : str
    message : str
    values : mapping of str to str
    """

    name: str
    message: str
    values: Mapping[str, str]


class Watch:
    """Subscriber to the nodes in a separate thread, from `start` to `stop`.

    Parameters
    ----------
    depth_topic : str, optional
        Depth images or clouds; by default the denoise node's input.
    """

    def __init__(self, depth_topic: str | None = None) -> None:
        self._depth_topic = depth_topic
        self._lock = threading.Lock()
        self._depth: OrderedDict[int, bytes] = OrderedDict()
        self._skeletons: OrderedDict[int, bytes] = OrderedDict()
        self._nodes: dict[str, tuple[float, NodeState]] = {}
        self._infos, self._kind, self._shown = CameraInfos("camera_info"), "", (0, False)
        self._subscribed = self._rectified = False
        self._clients: dict[str, Any] = {}
        self._listened: dict[str, _Listened] = {}
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="watch", daemon=True)

    def start(self) -> None:
        """Start the thread."""
        import rclpy
        from depth_pose_msgs.msg import SkeletonArray
        from diagnostic_msgs.msg import DiagnosticArray
        from rclpy.context import Context

        self._context = Context()
        init_context(self._context, args=[])
        self._node = rclpy.create_node("viewer", namespace="depth_pose", context=self._context)
        self._listen(SkeletonArray, "/depth_pose/skeletons", self.take_skeletons)
        self._node.create_subscription(DiagnosticArray, "/diagnostics", self._take_diagnostics, 10)
        self._thread.start()

    def stop(self) -> None:
        """Stop the thread."""
        import rclpy

        self._stopping.set()
        self._thread.join()
        self._node.destroy_node()
        rclpy.try_shutdown(context=self._context)

    @property
    def held(self) -> int:
        """Return the number of images, clouds and skeleton arrays held."""
        with self._lock:
            return len(self._depth) + len(self._skeletons)

    def newest(self) -> Heard | None:
        """Return the newest frame not returned before, decoded; None if there is none."""
        with self._lock:
            both = [stamp for stamp in self._skeletons if stamp in self._depth]
            stamp = both[-1] if both else 0
            last = next(reversed(self._depth), 0)
            answered = bool(stamp) and last - stamp < _UNANSWERED_NS
            stamp = stamp if answered else last
            if (stamp, answered) == self._shown or stamp == 0:
                return None
            if not answered and last - self._shown[0] < _BARE_EVERY_NS:
                return None
            depth, people, self._shown = self._depth[stamp], self._skeletons.get(stamp), (stamp, answered)
        try:
            frame = self._frame(depth)
            return Heard(frame, None if people is None else read_people(people).skeletons)
        except InputError as error:
            self._node.get_logger().warning(printable(error), throttle_duration_sec=5.0)
            return None

    def nodes(self) -> list[NodeState]:
        """Return the latest diagnostics of each node."""
        now = time.monotonic()
        with self._lock:
            return [state for told, state in self._nodes.values() if now - told < _STALE_S]

    def set(self, name: str, value: str | int) -> str:
        """Set ``follow``, ``zone`` or ``people`` of the nodes; return an error text, or an empty one."""
        from rcl_interfaces.srv import SetParameters
        from rclpy.parameter import Parameter

        node, parameter = _PARAMETERS[name]
        request = SetParameters.Request(parameters=[Parameter(parameter, value=value).to_parameter_msg()])
        result = self._ask(SetParameters, f"{node}/set_parameters", request)
        if result is None:
            return f"/depth_pose/{node} does not answer"
        return "" if result.results[0].successful else str(result.results[0].reason)

    def _frame(self, data: bytes) -> DepthFrame:
        if self._kind == schemas.POINT_CLOUD:
            return frame_of_cloud(data)
        image = read_message(data, self._kind)
        with self._lock:
            if self._infos.count > _QUEUE:  # as the denoise node does, which reports it
                self._infos.accept_only()
            info = self._infos.find(image.header.frame_id)
            if info is None:
                raise InputError(self._infos.why_none(image.header.frame_id))
        return make_frame(image, self._kind, info, self._rectified)

    # The thread

    def _run(self) -> None:
        from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

        executor = SingleThreadedExecutor(context=self._context)
        executor.add_node(self._node)
        looked = 0.0
        try:
            while not self._stopping.is_set():
                if time.monotonic() - looked > _LOOK_S:
                    if not self._subscribed:
                        self._look()
                    self._match()
                    looked = time.monotonic()
                executor.spin_once(timeout_sec=0.1)
        except ExternalShutdownException:
            pass
        finally:
            executor.shutdown()

    def _look(self) -> None:
        """Subscribe to the depth topic once it exists."""
        if self._depth_topic is not None:
            self._subscribe(self._depth_topic, self._depth_topic.rpartition("/")[0] + "/camera_info")
            return
        from rcl_interfaces.srv import GetParameters

        client = self._client(GetParameters, "denoise/get_parameters")
        if client.service_is_ready():
            names = ["cloud_topic", "image_topic", "info_topic"]
            client.call_async(GetParameters.Request(names=names)).add_done_callback(self._take_topics)

    def _take_topics(self, future: Any) -> None:
        values = [value.string_value for value in future.result().values]
        if len(values) == 3 and not self._subscribed:
            cloud, image, info = (self._node.resolve_topic_name(v) if v else "" for v in values)
            self._subscribe(cloud or image, "" if cloud else info)

    def _subscribe(self, topic: str, info_topic: str) -> None:
        from sensor_msgs.msg import CameraInfo, CompressedImage, Image, PointCloud2

        kinds = {
            schemas.IMAGE: Image,
            schemas.COMPRESSED: CompressedImage,
            schemas.POINT_CLOUD: PointCloud2,
        }
        types = dict(self._node.get_topic_names_and_types()).get(topic, [])
        known = [kind for kind in types if kind in kinds]
        if not known:
            return
        self._kind, self._subscribed, self._rectified = known[0], True, is_rectified(topic)
        self._listen(kinds[self._kind], topic, self.take_depth)
        if self._kind != schemas.POINT_CLOUD:
            self._listen(CameraInfo, info_topic, self.take_info)

    def _listen(self, kind: type, topic: str, callback: Callable[[bytes], None]) -> None:
        self._listened[topic] = _Listened(kind, callback)
        self._match()

    def _match(self) -> None:
        """Subscribe to every topic with its publishers' reliability."""
        from depth_pose.ros.transport.intake import frame_qos, is_sent_reliable

        for topic, listened in self._listened.items():
            reliable = is_sent_reliable(self._node, topic)
            if reliable is None and listened.subscription is not None:
                continue
            if listened.subscription is None or reliable != listened.is_reliable:
                if listened.subscription is not None:
                    self._node.destroy_subscription(listened.subscription)
                listened.is_reliable, qos = bool(reliable), frame_qos(_QUEUE, bool(reliable))
                listened.subscription = self._node.create_subscription(
                    listened.kind, topic, listened.callback, qos, raw=True
                )

    def take_depth(self, data: bytes) -> None:
        """Store a serialized image or cloud; ignored without a stamp, or before the CameraInfo it needs."""
        if self._infos.count or self._kind == schemas.POINT_CLOUD:
            self._hold(self._depth, data)

    def take_info(self, data: bytes) -> None:
        """Add a serialized CameraInfo."""
        try:
            info = read_message(data, schemas.CAMERA_INFO)
        except InputError:  # the denoise node reports it
            return
        with self._lock:
            self._infos.add(info, stamp_of(info))

    def take_skeletons(self, data: bytes) -> None:
        """Store a serialized SkeletonArray; ignored without a stamp, or if it is too large."""
        if len(data) > _MOST_BYTES:  # reading it would take the viewer minutes
            self._node.get_logger().warning(
                f"skeletons of {len(data)} bytes are not shown; more than {_MOST_BYTES} are not plausible",
                throttle_duration_sec=5.0,
            )
            return
        self._hold(self._skeletons, data)

    def _hold(self, kept: OrderedDict[int, bytes], data: bytes) -> None:
        if len(data) < _LEAST_BYTES:
            return
        stamp = header_stamp_ns(data)
        with self._lock:
            if kept and stamp < next(reversed(kept)):  # the recording restarts
                kept.clear()
                self._shown = (0, False)
            kept[stamp] = data
            most = min(_HELD, max(1, _HELD_BYTES // len(data)))
            while len(kept) > most:
                kept.popitem(last=False)

    def _take_diagnostics(self, message: Any) -> None:
        with self._lock:
            for status in message.status:
                if status.hardware_id == "depth_pose":
                    values = {value.key: value.value for value in status.values}
                    self._nodes[status.name] = (
                        time.monotonic(),
                        NodeState(status.name, status.message, values),
                    )

    # Services

    def _client(self, kind: type, name: str) -> Any:
        if name not in self._clients:
            self._clients[name] = self._node.create_client(kind, f"/depth_pose/{name}")
        return self._clients[name]

    def _ask(self, kind: type, name: str, request: Any) -> Any:
        """Call a service from another thread; return None on timeout."""
        client = self._client(kind, name)
        if not client.wait_for_service(timeout_sec=_ANSWER_S):
            return None
        done = threading.Event()
        future = client.call_async(request)
        future.add_done_callback(lambda _: done.set())
        return future.result() if done.wait(_ANSWER_S) else None


def start_watch(depth_topic: str | None) -> Watch:
    """Run a watch on the nodes."""
    watch = Watch(depth_topic)
    watch.start()
    return watch
