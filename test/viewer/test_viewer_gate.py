"""Who may connect to the viewer, and what a hostile page can do: nothing that stops it for others."""

from __future__ import annotations

import contextlib
import logging
import random
import resource
import urllib.error
import urllib.request

import pytest
from raw_browser import raw_browser
from viewer_scene import wait_for
from websockets.exceptions import ConnectionClosed, InvalidStatus

from depth_pose.viewer.access import refusal


def is_alive(viewer):
    """Whether it still draws frames for a page of its own."""
    before = viewer.drawn
    with raw_browser(viewer, origin=f"http://127.0.0.1:{viewer.port}") as page:
        wait_for(lambda: page.hear() and viewer.drawn > before + 2)


@pytest.mark.parametrize(("host", "origin", "is_local", "is_served"), [
    ("localhost:8080", None, True, True),  # a program
    ("localhost:8080", "http://localhost:8080", True, True),
    ("127.0.0.1:8080", "http://127.0.0.1:8080", True, True),
    ("[::1]:8080", "http://[::1]:8080", True, True),
    ("localhost:9000", "http://localhost:9000", True, True),  # ssh -L 9000:localhost:8080
    ("localhost:8080", "https://evil.example", True, False),
    ("localhost:8080", "http://localhost:3000", True, False),  # another server of this machine
    ("localhost:8080", "null", True, False),  # a sandboxed frame, a file
    ("localhost:8080", "http://[", True, False),
    ("evil.example:8080", "http://evil.example:8080", True, False),  # DNS rebinding
    ("localhost.evil.example", None, True, False),
    ("", None, True, False),
    ("robot.local:8080", "http://robot.local:8080", False, True),  # --host
    ("robot.local:8080", "http://evil.example", False, False),
])  # fmt: skip
def test_only_pages_of_its_own_are_served(host, origin, is_local, is_served):
    assert (refusal([host], [origin] if origin else [], is_local) == "") == is_served


def test_a_page_of_another_site_sees_nothing(viewer):
    """The browser itself says where the page is from that asks."""
    for origin in ("http://evil.example", "null", f"http://localhost:{viewer.port + 1}"):
        with pytest.raises(InvalidStatus, match="403"), raw_browser(viewer, origin=origin):
            pass
    request = urllib.request.Request(f"http://127.0.0.1:{viewer.port}/", headers={"Host": "evil.example"})
    with pytest.raises(urllib.error.HTTPError, match="403"):
        urllib.request.urlopen(request, timeout=60)
    is_alive(viewer)


def test_what_no_page_sends_stops_nothing(viewer):
    logging.getLogger("websockets.server").setLevel(logging.CRITICAL)
    wait_for(lambda: viewer.drawn > 2)
    for data in (b"\x00\xff garbage", b"", b"\x90", "text", b"x" * (51 << 20)):
        with raw_browser(viewer) as page, pytest.raises(ConnectionClosed):
            page.socket.send(data)
            while True:
                page.socket.recv(60.0)
    odd = ("abc", 1e9, -5, float("nan"), 1e308, None, [1, 2], {"a": 1}, True, "x" * 100_000)
    with raw_browser(viewer) as page:
        wait_for(lambda: page.hear() and {"speed", "zone", "clip"} <= page.controls.keys())
        for label in page.controls.keys() - {"screenshot", "clip"}:
            for value in odd:
                page.set(label, value)
        page.hear()
    assert viewer.source.playback.speed == 1.0
    viewer.source.playback.playing = True
    is_alive(viewer)


KINDS = (
    "ViewerCameraMessage", "GuiUpdateMessage", "GetRenderRequestMessage", "GetRenderResponseMessage",
    "FileTransferStartUpload", "FileTransferPart", "FileTransferPartAck", "ScenePointerMessage",
    "SceneNodeClickMessage", "TransformControlsUpdateMessage", "TransformControlsDragEndMessage",
    "GuiCloseModalMessage", "RunJavascriptMessage", "ShareUrlRequest", "PointCloudMessage", "no such message",
)  # fmt: skip
"""Messages of viser's protocol."""

VALUES = (
    None, True, -1, 0, 2**63 - 1, -(2**63), 1e308, float("nan"), float("inf"), "", "../../x", "x" * 10_000,
    b"", b"\0" * 10_000, [], [1, 2, 3], [float("nan")] * 4, {}, {"a": {"b": []}},
)  # fmt: skip
FIELDS = (
    "uuid", "updates", "wxyz", "position", "fov", "near", "far", "image_height", "image_width", "look_at",
    "up_direction", "render_uuid", "payload", "name", "part_index", "content", "transfer_uuid", "filename",
    "mime_type", "size_bytes", "source_component_uuid", "part_count", "event_type", "ray_origin",
    "ray_direction", "screen_pos", "instance_index", "share_url",
)  # fmt: skip


def test_messages_of_its_protocol_with_odd_contents_stop_nothing(viewer, tmp_path):
    logging.getLogger("websockets.server").setLevel(logging.CRITICAL)
    rng = random.Random(3)
    uuids = list(viewer.server.gui._gui_input_handle_from_uuid)
    before = set(tmp_path.rglob("*"))
    for _ in range(60):
        with contextlib.suppress(ConnectionClosed), raw_browser(viewer) as page:
            for _ in range(10):
                values = {f: rng.choice(VALUES) for f in FIELDS if rng.random() < 0.9}
                if rng.random() < 0.5:
                    values |= {name: rng.choice(uuids) for name in ("uuid", "source_component_uuid")}
                page.send({"type": rng.choice(KINDS)} | values)
            page.hear(0.05)
    is_alive(viewer)
    assert set(tmp_path.rglob("*")) == before
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss < 2 << 20  # KiB


def test_many_browsers_that_do_not_listen_stop_nothing(viewer):
    pages = [raw_browser(viewer) for _ in range(30)]
    for page in pages:
        page.__enter__()
    try:
        is_alive(viewer)
    finally:
        for page in pages:
            page.__exit__(None, None, None)


def told(page, title):
    """What notifications of this title a page has got by now."""
    return [m["props"]["body"] for m in page.hear() if m.get("props", {}).get("title") == title]


def test_a_picture_on_a_full_disk_is_told_to_the_browser(viewer, tmp_path):
    wait_for(lambda: viewer.drawn > 2)
    unlimited = resource.getrlimit(resource.RLIMIT_FSIZE)
    with raw_browser(viewer) as page:
        wait_for(lambda: page.hear() and "screenshot" in page.controls)
        resource.setrlimit(resource.RLIMIT_FSIZE, (2000, unlimited[1]))
        try:
            page.set("screenshot", True)
            said = []
            wait_for(lambda: said.extend(told(page, "not taken")) or said)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, unlimited)
        assert "view_001.png cannot be written: File too large" in said[0]
        assert not any((tmp_path / "pictures").iterdir())
        page.set("screenshot", True)
        wait_for(lambda: told(page, "saved"))
    assert [p.name for p in (tmp_path / "pictures").iterdir()] == ["view_001.png"]
