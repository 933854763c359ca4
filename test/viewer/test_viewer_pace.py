"""The viewer sends frames no faster than browsers take them: with a client that answers, or does not."""

from __future__ import annotations

import contextlib
import threading

import msgspec
import numpy as np
import pytest
import viser
import zstandard
from viewer_scene import wait_for
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from depth_pose.core.camera import Camera
from depth_pose.core.frame import DepthFrame
from depth_pose.viewer.app import RATE_HZ
from depth_pose.viewer.source import RecordedSource

CAMERA = Camera(width=80, height=60, fx=80.0, fy=80.0, cx=40.0, cy=30.0)


class Reader:
    """What a browser's page is to the viewer: takes messages, and answers what it is asked."""

    def __init__(self, port):
        self.frames, self.is_asked, self._answering = 0, False, threading.Lock()
        protocol = f"viser-v{viser.__version__}"
        self._socket = connect(f"ws://127.0.0.1:{port}", subprotocols=[protocol], max_size=None)
        here = {"wxyz": (1.0, 0, 0, 0), "position": (0.0, 0, 0), "look_at": (1.0, 0, 0), "fov": 1.0}
        size = {"near": 0.1, "far": 10.0, "image_height": 400, "image_width": 600}
        self._send("ViewerCameraMessage", up_direction=(0.0, 0, 1), **here, **size)
        threading.Thread(target=self._run, daemon=True).start()

    def close(self):
        self._socket.close()

    def _send(self, kind, **values):
        self._socket.send(msgspec.msgpack.encode({"type": kind, **values}))

    def _run(self):
        with contextlib.suppress(ConnectionClosed):
            for data in self._socket:
                length = int.from_bytes(data[8:16], "little")
                whole = zstandard.ZstdDecompressor().decompress(data[16 : 16 + length])
                for message in msgspec.msgpack.decode(whole)["messages"]:
                    self._take(message)

    def _take(self, message):
        if message["type"] == "SceneNodeUpdateMessage" and message["name"] == "/sensor/points":
            self.frames += "points" in message["updates"]
        elif message["type"] == "LocalStorageGetItemRequestMessage":
            self.is_asked, asked = True, message["request_uuid"]
            with self._answering:
                self._send("LocalStorageGetItemResponseMessage", value=None, error=None, request_uuid=asked)
                self.is_asked = False

    @contextlib.contextmanager
    def silent(self):
        """Answer nothing, from a question on that was heard and is open."""
        with self._answering:
            wait_for(lambda: self.is_asked)
            yield


@pytest.fixture
def viewer(start_viewer):
    """One that shows a recording which goes on and on."""
    depth = np.full((CAMERA.height, CAMERA.width), 2.0, np.float32)
    frames = [DepthFrame(i * 66_000_000 + 1, "optical", depth + 0.01 * i, CAMERA) for i in range(60)]
    return start_viewer(RecordedSource(frames, lambda frame: (), 2000))


@pytest.fixture
def reader(viewer):
    reader = Reader(viewer.port)
    yield reader
    reader.close()


def test_a_client_that_answers_gets_frame_after_frame(viewer, reader):
    wait_for(lambda: reader.frames > 3 * RATE_HZ)


def test_one_that_does_not_answer_gets_no_more_until_it_does(viewer, reader):
    viewer.rate_limit.patience_s = 60.0
    wait_for(lambda: reader.frames > 3)
    with reader.silent():
        drawn = viewer.drawn
        with pytest.raises(
            AssertionError, match="nothing came"
        ):  # for far longer than lies between two frames
            wait_for(lambda: viewer.drawn > drawn, seconds=1.5)
        before = reader.frames
    wait_for(lambda: reader.frames > before + 5)


def test_it_is_not_waited_for_for_ever(viewer, reader):
    viewer.rate_limit.patience_s = 0.5
    wait_for(lambda: reader.frames > 3)
    with reader.silent():
        drawn = viewer.drawn
        wait_for(lambda: viewer.drawn > drawn + 10)


def test_one_that_goes_is_not_waited_for(viewer, reader):
    viewer.rate_limit.patience_s = 600.0
    wait_for(lambda: reader.frames > 3)
    with reader.silent():
        drawn = viewer.drawn
        reader.close()
        wait_for(lambda: viewer.drawn > drawn + 10)
