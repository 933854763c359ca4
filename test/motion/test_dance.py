"""The dances: performances differ, and every one can be danced."""

import numpy as np
import pytest

from depth_pose.body.angles import ANGLE_INDEX, angles_from_rotations
from depth_pose.body.limits import violation
from depth_pose.core.errors import ConfigError
from depth_pose.motion.procedural.dance import DANCES, perform
from depth_pose.motion.procedural.families import FAMILIES


@pytest.mark.parametrize("dance", sorted(DANCES))
def test_a_performance_can_be_danced(dance):
    clip = perform(dance, 3, 4.0)
    assert len(clip) == 120 and clip.rotations.shape == (120, 21, 3, 3)
    assert np.allclose(clip.rotations @ np.swapaxes(clip.rotations, -1, -2), np.eye(3), atol=1e-9)
    assert np.percentile(violation(angles_from_rotations(clip.rotations)), 99) < 5.0
    nodes = clip.nodes()
    assert -0.05 < nodes[..., 1].min() < 0.12
    speed = np.linalg.norm(np.diff(nodes, axis=0), axis=-1) * clip.fps
    assert speed.max() < 12.0
    assert np.abs(clip.roots[:, [0, 2]]).max() < 1.5


def test_performances_are_repeatable_and_differ():
    one, same, other = (perform("swing", seed, 3.0) for seed in (1, 1, 2))
    assert np.array_equal(one.rotations, same.rotations)
    apart = np.abs(angles_from_rotations(one.rotations) - angles_from_rotations(other.rotations))
    assert 2.0 < apart[:, ANGLE_INDEX["left_shoulder_flexion"]].mean() < 40.0


def test_a_dance_repeats_and_turns():
    beats = np.linspace(0.0, 8.0, 50)
    for dance in DANCES.values():
        first, second = dance.posture(beats), dance.posture(beats + len(dance.keys))
        turned = second - first
        heading = ANGLE_INDEX["pelvis_twist"]
        assert np.allclose(turned[:, heading], dance.turn_deg)
        assert np.allclose(np.delete(turned, heading, axis=1), 0.0, atol=1e-9)
    assert DANCES["sweep"].turn_deg == 360.0


def test_dances_are_not_in_the_bank():
    assert not set(DANCES) & set(FAMILIES)
    with pytest.raises(ConfigError, match="there is no dance"):
        perform("waltz", 0, 1.0)
