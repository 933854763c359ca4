"""Rising from a chair and standing still, with known times and sway."""

from __future__ import annotations

import numpy as np
import pytest
from walked import skeletons_of, write

from depth_pose.analysis import analyse_recording
from depth_pose.analysis.sway import centre_of_mass
from depth_pose.core.skeleton import JOINT_NODES
from depth_pose.sim.function import sit_to_stand, stand_still

FPS = 30.0
RISE_S = 1.2 * (np.arccos(-0.9) - np.arccos(0.9)) / np.pi
"""Time from 5 to 95 % of a rise of 1.2 s along a cosine."""


def test_rises_are_counted_and_timed(tmp_path):
    path = write(tmp_path / "chair.mcap", skeletons_of(sit_to_stand(FPS, 20.4, 0), turn_deg=50.0))
    (person,) = analyse_recording(path).people
    found = {m.name: m for m in person.rising.measures}
    assert found["rises"].value == 5
    assert found["time of a rise"].value == pytest.approx(RISE_S, abs=0.05)
    assert found["time of sitting down"].value == pytest.approx(RISE_S, abs=0.05)
    assert found["time of five rises"].value == pytest.approx(4 * 4.0 + RISE_S, abs=0.1)
    assert not any(m.is_known for m in person.gait.measures)
    assert "walks straight" in person.gait.measures[0].reason


def test_sway_is_that_of_the_centre_of_mass(tmp_path):
    clip = stand_still(FPS, 20.0, 0)
    (person,) = analyse_recording(write(tmp_path / "still.mcap", skeletons_of(clip))).people
    found = {m.name: m for m in person.sway.measures}
    mass = 1e3 * centre_of_mass(clip.nodes()[:, JOINT_NODES])
    for name, axis in (("sway forward and back", 2), ("sway to the sides", 0)):
        true = mass[:, axis].std()
        assert found[name].value == pytest.approx(true, abs=2.5 * found[name].deviation)
        assert 0.1 < found[name].deviation < 3.0
    short = write(tmp_path / "short.mcap", skeletons_of(stand_still(FPS, 4.0, 0)))
    (person,) = analyse_recording(short).people
    assert "stands still for 8 s; the longest time is 4.0 s" in person.sway.measures[0].reason
