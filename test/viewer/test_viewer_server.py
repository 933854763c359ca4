"""The viewer's server: what it puts into the scene, who may connect, and the page in a real browser."""

from __future__ import annotations

import re
import socket
import urllib.request

import numpy as np
import pytest
from PIL import Image
from raw_browser import raw_browser
from viewer_scene import FRAMES, people, wait_for

from browser import assert_shows, page_of
from depth_pose.core.errors import DepthPoseError
from depth_pose.core.rotations import quat_to_matrix
from depth_pose.core.skeleton import BONES
from depth_pose.viewer import app as viewer_app
from depth_pose.viewer.source import RecordedSource
from synthetic import CAMERA, START_NS, STEP_NS, draw, mesh, posed, room, varied


def handle(viewer, name):
    return viewer.server.scene.get_handle_by_name(name)


def test_the_scene_has_everybody(viewer):
    wait_for(lambda: viewer.drawn > 2)
    for skeleton in people(None):
        bones = handle(viewer, f"/sensor/people/{skeleton.body_id}/bones")
        np.testing.assert_allclose(bones.points, skeleton.positions[np.array(BONES)], atol=1e-5)
        seen = handle(viewer, f"/sensor/people/{skeleton.body_id}/joints").batched_scales > 1e-3
        hollow = handle(viewer, f"/sensor/people/{skeleton.body_id}/hidden").batched_scales > 1e-3
        np.testing.assert_array_equal(seen, skeleton.joint_states == 0)
        np.testing.assert_array_equal(seen, ~hollow)
    points = np.asarray(handle(viewer, "/sensor/points").points, np.float32)
    assert len(points) > 1000
    assert points[:, 2].max() == pytest.approx(4.5, abs=0.01)


def test_the_floor_comes_from_their_feet(viewer):
    wait_for(lambda: handle(viewer, "/floor").visible)
    turn = quat_to_matrix(np.roll(np.array(handle(viewer, "/sensor").wxyz, float), -1))
    up = turn @ np.array([0.0, -1.0, 0.0])
    assert up[2] > 0.99
    assert handle(viewer, "/sensor").position[2] == pytest.approx(0.9, abs=0.1)


def test_whom_one_chooses_is_shown(viewer):
    wait_for(lambda: viewer.drawn > 2)
    assert viewer.choose("people", 1) == ""
    wait_for(lambda: handle(viewer, "/sensor/people/body_2/bones") is None)
    assert handle(viewer, "/sensor/people/body_1/bones") is not None
    viewer.choose("people", 0)
    viewer.choose("zone", "3.4:9")
    wait_for(lambda: handle(viewer, "/sensor/people/body_1/bones") is None)
    assert "zone is 'what?'" in viewer.choose("zone", "what?")


def test_the_page_is_served_to_this_machine_only(viewer):
    with urllib.request.urlopen(f"http://127.0.0.1:{viewer.port}/", timeout=60) as page:
        assert b"<html" in page.read(2000).lower()
    others = {info[4][0] for info in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)} - {
        "127.0.0.1"
    }
    for address in others:
        if not address.startswith("127."):
            with pytest.raises(OSError):
                socket.create_connection((address, viewer.port), timeout=2).close()


def test_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "viser", None)
    with pytest.raises(DepthPoseError, match=r"pip install 'depth_pose\[view\]'"):
        viewer_app.Viewer(RecordedSource([], lambda frame: None, 1000))


def test_a_recording_without_skeletons_has_them_found(bank_path, tmp_path):
    """As ``depth-pose view in.mcap`` does."""
    from depth_pose.cli.view import recorded_source
    from depth_pose.io.mcap_write import DepthWriter

    with DepthWriter(tmp_path / "in.mcap", CAMERA, "optical") as writer:
        for i in range(6):
            person = draw(mesh(posed(varied(1, 5.0), distance=2.5)))
            depth = np.fmin(np.where(person > 0, person, np.inf), room())
            writer.write(START_NS + i * STEP_NS, depth.astype(np.float32))
    source = recorded_source(tmp_path / "in.mcap", None, bank_path, None, "", 4000)
    source.start()
    source.wait()
    assert source.error == ""
    (found,) = source.frame(5).skeletons
    assert found.positions[0, 2] == pytest.approx(2.5, abs=0.15)


def test_an_open_door_is_said(capsys):
    from depth_pose.cli.view import print_address

    print_address("127.0.0.1", 8080)
    assert "open to other machines" not in capsys.readouterr().out
    print_address("0.0.0.0", 8080)
    said = capsys.readouterr().out
    assert "http://localhost:8080" in said
    assert "open to other machines" in said


def test_a_clip_lasts_as_long_as_the_panel_says(viewer, tmp_path):
    wait_for(lambda: viewer.drawn > 2)
    with raw_browser(viewer) as page:
        wait_for(lambda: page.hear() and {"clip", "seconds of a clip"} <= page.controls.keys())
        page.set("seconds of a clip", 2)
        wait_for(lambda: viewer.clip_s == 2.0)
        page.set("clip", True)
        wait_for(lambda: any(m.get("props", {}).get("title") == "saved" for m in page.hear()))
    with Image.open(tmp_path / "pictures" / "view_001.gif") as clip:
        assert duration_ms(clip) == 2000
        assert clip.size == (480, 270)


def duration_ms(clip):
    """Sum over its pictures; those that are the same are one, which stays longer."""
    passed_ms = 0
    for i in range(clip.n_frames):
        clip.seek(i)
        passed_ms += clip.info["duration"]
    return passed_ms


# In a browser


@pytest.fixture
def page(viewer):
    wait_for(lambda: viewer.drawn > 2)
    with page_of(viewer) as page:
        yield page


def test_a_browser_shows_the_skeletons_where_they_are(viewer, page):
    for wish in ("points", "names", "floor", "camera"):
        viewer.set_visible(wish, False)
    page.get_by_label("playing").dispatch_event("click")
    wait_for(lambda: not viewer.source.playback.playing)
    assert_shows(viewer, CAMERA, [skeleton.positions for skeleton in people(None)])
    assert page.problems == []


def test_the_controls_of_the_page_work(viewer, page, tmp_path):
    page.get_by_label("playing").dispatch_event("click")
    wait_for(lambda: not viewer.source.playback.playing)
    before = viewer.source.playback.index
    page.get_by_role("button", name="+1").dispatch_event("click")
    wait_for(lambda: viewer.source.playback.index in (before + 1, FRAMES - 1))
    page.get_by_label("depth points").dispatch_event("click")
    wait_for(lambda: not handle(viewer, "/sensor/points").visible)
    page.get_by_role("button", name="screenshot").dispatch_event("click")
    wait_for(lambda: list((tmp_path / "pictures").glob("view_*.png")), 90.0)
    assert re.match(r"view_001.png", next((tmp_path / "pictures").iterdir()).name)
    assert page.problems == []


def test_a_clip_is_saved(viewer, page, tmp_path):
    viewer.clip_s = 1
    page.get_by_role("button", name="clip", exact=True).dispatch_event("click")
    wait_for(lambda: list((tmp_path / "pictures").glob("view_*.gif")), 240.0)
    with Image.open(tmp_path / "pictures" / "view_001.gif") as clip:
        assert duration_ms(clip) == 1000
        assert clip.size == (480, 270)
    assert page.problems == []
