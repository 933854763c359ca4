"""A real browser for the tests of the viewer and of the example's web page, where there is one."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

import numpy as np
import pytest

from depth_pose.core.skeleton import BONES

CHROMIUM = os.environ.get("DEPTH_POSE_CHROMIUM", "")
_SWITCHES = ("--no-sandbox", "--no-zygote", "--use-gl=angle", "--use-angle=swiftshader")
_SWITCHES += ("--enable-unsafe-swiftshader", "--ignore-gpu-blocklist", "--lang=en-US")
FIRST_LOOK_MS = 60_000
"""A page may take so long on a busy machine without a graphics card."""


@contextlib.contextmanager
def new_page():
    """A page of a headless Chromium; what it complains of is in its ``problems``."""
    if not CHROMIUM:
        pytest.skip("needs a Chromium: set DEPTH_POSE_CHROMIUM to its path, and pip install playwright")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as p:
        environment = {"LANG": "en_US.UTF-8", "HOME": str(Path.home())}
        browser = p.chromium.launch(executable_path=CHROMIUM, args=list(_SWITCHES), env=environment)
        page = browser.new_page(viewport={"width": 640, "height": 640}, locale="en-US")
        page.problems = []
        page.on("pageerror", lambda error: page.problems.append(str(error)))
        page.on("console", lambda m: page.problems.append(m.text) if m.type == "error" else None)
        yield page
        browser.close()


@contextlib.contextmanager
def page_of(viewer):
    """A page that shows a viewer."""
    with new_page() as page:
        page.goto(f"http://127.0.0.1:{viewer.port}/")
        page.get_by_text("depth points").wait_for(timeout=FIRST_LOOK_MS)
        yield page


def assert_shows(viewer, camera, people):
    """Seen from the sensor, all that the browser draws of skeletons lies on bones, and covers the joints.

    `people` are the joints (19, 3) of everybody in the viewer's scene, metres, in the sensor's frame.
    Points, names, floor and camera must not be shown.
    """
    (client,) = viewer.server.get_clients().values()
    root = viewer.server.scene.get_handle_by_name("/sensor")
    height, width = 2 * camera.height, 2 * camera.width
    fov = 2 * np.arctan2(camera.height / 2, camera.fy)
    picture = client.get_render(
        height, width, transport_format="png", timeout=90.0, wxyz=root.wxyz, position=root.position, fov=fov
    )
    picture = picture[..., :3].astype(int)
    drawn = np.abs(picture - picture[0, 0]).sum(axis=2) > 60
    v, u = np.nonzero(drawn)
    assert len(u) > 300
    near = np.full(len(u), np.inf)
    for number, joints in enumerate(people):
        pixels = 2 * camera.project(joints) + 0.5
        inside = (pixels > 4).all(axis=1) & (pixels < (width - 4, height - 4)).all(axis=1)
        for x, y in pixels[inside]:
            assert drawn[int(y) - 3 : int(y) + 4, int(x) - 3 : int(x) + 4].any(), (number, x, y)
        for a, b in BONES:
            share = np.linspace(0, 1, 30)[:, None]
            line = pixels[a] + share * (pixels[b] - pixels[a])
            near = np.minimum(near, np.hypot(line[:, :1] - u, line[:, 1:] - v).min(axis=0))
    assert (near < 8).mean() > 0.97, "nothing is drawn elsewhere"
