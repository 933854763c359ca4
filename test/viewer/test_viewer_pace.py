"""The viewer sends frames no faster than browsers take them: with a client that answers, or does not."""

from __future__ import annotations

import contextlib
import threading
import time

import msgspec
import numpy as np
import pytest
import viser
import zstandard
from viewer_scene import wait_for
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from depth_pose.core.camera import Camera
from depth_pose.core.types import DepthFrame
from depth_pose.viewer import rate_limit as pace
from depth_pose.viewer.app import RATE_HZ
from depth_pose.viewer.source import RecordedSource

CAMERA = Camera(width=80, height=60, fx=80.0, fy=80.0, cx=40.0, cy=30.0)


class Reader:
    """What a browser's page is to the viewer: takes messages, and answers what it is asked, while it may."""

    def __init__(self, port):
        self.frames, self.may_answer = 0, threading.Event()
        self.may_answer.set()
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
            self.may_answer.wait()
            asked = message["request_uuid"]
            self._send("LocalStorageGetItemResponseMessage", value=None, error=None, request_uuid=asked)


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
    reader.may_answer.set()
    reader.close()


def test_a_client_that_answers_gets_frame_after_frame(viewer, reader):
    wait_for(lambda: reader.frames > 3 * RATE_HZ)


def test_one_that_does_not_answer_gets_no_more_until_it_does(viewer, reader, monkeypatch):
    monkeypatch.setattr(pace, "_PATIENCE_S", 60.0)
    wait_for(lambda: reader.frames > 3)
    reader.may_answer.clear()

    def is_still():
        """Frames are left out for far longer than lies between two, and not kept for later."""
        before, drawn = reader.frames, viewer.drawn
        time.sleep(1.5)
        return (reader.frames, viewer.drawn) == (before, drawn)

    wait_for(is_still)  # once what was on the way has come
    before = reader.frames
    reader.may_answer.set()
    wait_for(lambda: reader.frames > before + 5)


def test_it_is_not_waited_for_for_ever(viewer, reader, monkeypatch):
    monkeypatch.setattr(pace, "_PATIENCE_S", 0.5)
    wait_for(lambda: reader.frames > 3)
    reader.may_answer.clear()
    time.sleep(0.2)
    drawn = viewer.drawn
    wait_for(lambda: viewer.drawn > drawn + 10)


def test_one_that_goes_is_not_waited_for(viewer, reader, monkeypatch):
    monkeypatch.setattr(pace, "_PATIENCE_S", 600.0)
    wait_for(lambda: reader.frames > 3)
    reader.may_answer.clear()
    time.sleep(0.5)
    drawn = viewer.drawn
    reader.close()
    wait_for(lambda: viewer.drawn > drawn + 10)
