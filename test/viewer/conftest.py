"""A viewer that runs while a test does."""

from __future__ import annotations

import contextlib
import threading

import pytest
from viewer_scene import frames, people

from depth_pose.viewer.app import Viewer
from depth_pose.viewer.source import RecordedSource


@pytest.fixture
def start_viewer(tmp_path):
    """Start viewers of sources; all end with the test."""
    with contextlib.ExitStack() as ends:

        def start(source):
            source.start()
            source.wait()
            viewer = Viewer(source, port=0, pictures=tmp_path / "pictures")
            thread = threading.Thread(target=viewer.run, daemon=True)
            thread.start()
            ends.callback(_end, viewer, thread)
            return viewer

        yield start


@pytest.fixture
def viewer(start_viewer):
    """A viewer of two people before a wall."""
    return start_viewer(RecordedSource(list(frames()), people, 3000))


def _end(viewer, thread):
    viewer.stop()
    thread.join(60)
    assert not thread.is_alive()
