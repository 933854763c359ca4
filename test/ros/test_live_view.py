"""The viewer on running nodes: from depth over real DDS to what is in the scene, and in a real browser."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest
import scene
from peer import LIMIT_S

from browser import assert_shows, page_of
from depth_pose.core.skeleton import BONES
from depth_pose.io.mcap_read import read_frames
from depth_pose.io.skeleton_read import read_people
from depth_pose.ros.process.supervisor import Suite
from depth_pose.ros.tools.bag import Recorder, play
from depth_pose.ros.tools.watch import Watch
from depth_pose.viewer.app import Viewer
from depth_pose.viewer.source import LiveSource

IMAGE, INFO, PEOPLE = "/camera/depth/image_raw", "/camera/depth/camera_info", "/depth_pose/skeletons"
FRAMES = 30


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return scene.write_recording(tmp_path_factory.mktemp("live") / "small.mcap", FRAMES)


@pytest.fixture
def suite(domain, bank_path):
    lossless = {"reliable": True, "queue": 200}  # or the nodes leave out frames on a busy machine
    with Suite(bank=bank_path, parameters=lossless, sink=lambda line: None) as suite:
        yield suite


@pytest.fixture
def viewer(suite, tmp_path):
    """One that listens to the nodes, and finds the depth topic by itself."""
    watch = Watch()
    watch.start()
    viewer = Viewer(LiveSource(watch, 4000), port=0, pictures=tmp_path / "pictures")
    thread = threading.Thread(target=viewer.run, daemon=True)
    thread.start()
    yield viewer
    viewer.stop()
    thread.join(60)
    watch.stop()


def wait_for(true, what, seconds=120.0):
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end, f"{what} did not come"
        time.sleep(0.05)


def joints_shown(viewer):
    """Joints (19, 3) of everybody in the scene, of the frame that is shown."""
    return [s.positions for s in viewer.frame.skeletons or ()] if viewer.frame else []


def show(viewer, recording, tmp_path):
    """Play the recording, slowly, to the nodes and the viewer; gives what is shown, and its skeleton.

    Again where the viewer, which leaves out what it has no time for, was left with nothing to show, or
    shows a frame whose answer the recorder did not hear.
    """
    for _ in range(10):
        answers = play_once(recording, tmp_path)
        wait_for(lambda: viewer.frame is not None, "something to show")
        frame = viewer.frame
        found = answers.get(frame.stamp_ns, ())
        if (
            viewer.drawn > 5
            and len(found) == 1
            and [s.body_id for s in frame.skeletons or ()] == [found[0].body_id]
        ):
            return frame, found[0]
    raise AssertionError("the viewer does not show what the nodes answer")


def play_once(recording, tmp_path):
    """Everybody in each frame that was answered: all but those before the nodes knew each other."""
    out = tmp_path / "out.mcap"
    with Recorder(out, [PEOPLE]) as recorder:
        assert recorder.wait_subscribed(timeout_s=LIMIT_S)
        play(recording, rate=0.25, wait_for_subscribers=[IMAGE, IMAGE, INFO, INFO], wait_s=LIMIT_S)
        if not recorder.wait_for(PEOPLE, FRAMES, 20.0):
            assert recorder.wait_for(PEOPLE, FRAMES // 2, LIMIT_S), f"{recorder.counts[PEOPLE]} answers"
    return {m.stamp_ns: m.skeletons for m in read_people(out, PEOPLE)}


def test_the_scene_shows_what_the_nodes_answer(viewer, recording, tmp_path):
    frame, found = show(viewer, recording, tmp_path)
    bones = viewer.server.scene.get_handle_by_name(f"/sensor/people/{found.body_id}/bones")
    wanted = found.positions[np.array(BONES)]
    wait_for(lambda: np.allclose(bones.points, wanted, rtol=0.0, atol=1e-5), "the bones of what is shown")
    depth = next(f.depth for f in read_frames(recording) if f.stamp_ns == frame.stamp_ns)
    points = np.asarray(viewer.server.scene.get_handle_by_name("/sensor/points").points, np.float32)
    assert points[:, 2].min() == pytest.approx(depth[depth > 0].min(), abs=0.1)
    wait_for(lambda: "denoise" in viewer.tables, "the table of nodes")
    assert found.body_id in viewer.tables


def test_a_browser_shows_people_live(viewer, recording, tmp_path):
    with page_of(viewer) as page:
        for wish in ("points", "names", "floor", "camera"):
            viewer.set_visible(wish, False)
        _, found = show(viewer, recording, tmp_path)
        page.get_by_text(found.body_id).first.wait_for(timeout=30_000)
        wait_for(viewer.rate_limit.is_free, "the browser's answer")
        assert_shows(viewer, scene.CAMERA, joints_shown(viewer))
        assert page.problems == []
