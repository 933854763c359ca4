"""A viewer that runs while a test does."""

from __future__ import annotations

import contextlib
import threading

import pytest

from depth_pose.viewer.app import Viewer


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


def _end(viewer, thread):
    viewer.stop()
    thread.join(10)
    assert not thread.is_alive()
