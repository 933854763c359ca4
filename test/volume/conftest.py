"""A small world: a short dance on two small wearers, four low-resolution cameras, one learned model."""

import pytest

from depth_pose.body.procedural import BodyShape
from depth_pose.core.camera import Camera
from depth_pose.motion.procedural.dance import perform
from depth_pose.sim.clothing import Garment
from depth_pose.sim.roof_cameras import roof_rig
from depth_pose.sim.wearers import Wearer
from depth_pose.volume.config import LearnConfig, SpaceConfig
from depth_pose.volume.learn.learning import learn_model
from depth_pose.volume.learn.performances import rig_eyes, watch
from depth_pose.volume.learn.training import simulate_views

SMALL = Camera(160, 120, 119.0, 119.0, 79.5, 59.5)
SKIRT = Garment(skirt=0.5, flare=0.25)
SECONDS = 4.0


@pytest.fixture(scope="session")
def rig():
    return roof_rig(6, camera=SMALL)


@pytest.fixture(scope="session")
def space():
    return SpaceConfig(voxel=0.03)


@pytest.fixture(scope="session")
def clips():
    return [perform("swing", seed, SECONDS) for seed in (1, 2, 3)]


@pytest.fixture(scope="session")
def views(rig, space, clips):
    wearers = [Wearer(BodyShape(stature_m=1.70), SKIRT), Wearer(BodyShape(stature_m=1.78, girth=1.1))]
    return simulate_views(clips, wearers, every=5, space=space, rig=rig)


@pytest.fixture(scope="session")
def model(views):
    return learn_model(views, LearnConfig(iterations=60), about="a test")


@pytest.fixture(scope="session")
def performance(rig, space):
    """Somebody else performs once more, and was not taught."""
    wearer = Wearer(BodyShape(stature_m=1.64, girth=1.05), Garment(skirt=0.55, flare=0.3))
    return watch(perform("swing", 50, 2.0, start_beat=1.0), wearer, rig_eyes("silhouettes", rig, space))
