"""What the viewer's tests look at: a recording of two people before a wall; and how they wait."""

from __future__ import annotations

import time

import numpy as np
from test_viewer_parts import skeleton_at

from synthetic import START_NS, STEP_NS, draw, mesh, posed, to_frame, varied

FRAMES = 20


def frames():
    """Somebody and a wall, as a depth camera sees them."""
    for i in range(FRAMES):
        person = draw(mesh(posed(varied(1, 5.0), distance=3.0, aside=0.3)))
        depth = np.fmin(np.where(person > 0, person, np.inf), 4.5)
        yield to_frame(depth, START_NS + i * STEP_NS)


def people(frame):
    """Return the people in a frame."""
    return (skeleton_at(0.3, 3.0, hidden=3), skeleton_at(-0.6, 3.5, "body_2"))


def wait_for(true, seconds=120.0):
    """Wait until something is true."""
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end, "nothing came"
        time.sleep(0.05)
