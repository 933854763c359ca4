"""A browser as the viewer's server knows it: a websocket that speaks its protocol, and draws nothing."""

from __future__ import annotations

import io
import time
from contextlib import contextmanager

import msgspec
import numpy as np
import viser
import zstandard
from PIL import Image
from websockets.sync.client import connect

_CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": (1.0, 0.0, 0.0, 0.0),
    "position": (0.0, 0.0, 0.0),
    "fov": 1.0,
    "near": 0.1,
    "far": 100.0,
    "image_height": 540,
    "image_width": 960,
    "look_at": (1.0, 0.0, 0.0),
    "up_direction": (0.0, 0.0, 1.0),
}


class RawBrowser:
    """One connection; `hear` answers what a page would answer.

    `controls` has the number of each control of the panel that was heard of, by its label.
    """

    def __init__(self, socket):
        self.socket, self.controls = socket, {}
        self.send(_CAMERA)

    def send(self, message):
        """Send a message, as a mapping."""
        self.socket.send(msgspec.msgpack.encode(message))

    def set(self, label, value):
        """Do as a page does whose control gets a value; a button takes True."""
        self.send({"type": "GuiUpdateMessage", "uuid": self.controls[label], "updates": {"value": value}})

    def hear(self, seconds=0.2):
        """Receive messages for a while; answer requests for a picture."""
        heard, end = [], time.monotonic() + seconds
        while (left_s := end - time.monotonic()) > 0.0:
            try:
                data = self.socket.recv(left_s)
            except TimeoutError:
                break
            size = int.from_bytes(data[8:16], "little")
            inner = zstandard.ZstdDecompressor().decompress(data[16 : 16 + size])
            for message in msgspec.msgpack.decode(inner)["messages"]:
                heard.append(message)
                if message["type"].startswith("Gui") and "value" in message and "uuid" in message:
                    self.controls[message["props"]["label"]] = message["uuid"]
                if message["type"] == "GetRenderRequestMessage":
                    self._show(message)
        return heard

    def _show(self, request):
        picture = io.BytesIO()
        shown = np.random.default_rng(1).integers(0, 256, (request["height"], request["width"], 3), np.uint8)
        Image.fromarray(shown).save(picture, request["format"].rpartition("/")[2].upper())
        answer = {"payload": picture.getvalue(), "render_uuid": request["render_uuid"]}
        self.send({"type": "GetRenderResponseMessage", **answer})


@contextmanager
def raw_browser(viewer, **options):
    """Connect to a viewer as its own page does."""
    versions = [f"viser-v{viser.__version__}"]
    with connect(f"ws://127.0.0.1:{viewer.port}/", subprotocols=versions, max_size=None, **options) as socket:
        yield RawBrowser(socket)
