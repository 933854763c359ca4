"""A disk that is full, before the work and on the way, under the commands of the volume tracker."""

from __future__ import annotations

from dataclasses import replace

import pytest

from depth_pose.body.procedural import BodyShape
from depth_pose.core.errors import ConfigError
from depth_pose.motion.procedural.dance import perform
from depth_pose.sim.wearers import Wearer, record_views
from depth_pose.volume.learn.learning import learn_model
from full_disk import run_on_full_disk

SMALL = ("--performances", "1", "--every", "30", "--latent", "2", "--iterations", "2", "--voxel", "0.06")

COMMANDS = (
    ("volume", "run", "in.mcap", "-m", "model.npz", "--rig", "in.yaml", "-o", "out.mcap"),
    ("volume", "demo", "-m", "model.npz", "-o", "out.png", "--seconds", "1"),
    ("volume", "demo", "-m", "model.npz", "-o", "out.png", "--seconds", "1", "--record", "out.mcap"),
    ("volume", "train", "-o", "out.npz", "--garment", "none", *SMALL),
)


@pytest.mark.slow
@pytest.mark.parametrize("trial", [None, 1], ids=["before the work", "on the way"])
def test_a_full_disk_is_one_line_and_leaves_nothing(tmp_path, bank_path, model, rig, trial):
    record_views(tmp_path / "in.mcap", perform("swing", 50, 1.0), Wearer(BodyShape()), rig, "silhouettes")
    model.save(tmp_path / "model.npz")
    for name in ("out.mcap", "out.png", "out.npz", "out.yaml"):
        (tmp_path / name).write_bytes(b"good")
    run_on_full_disk(COMMANDS, tmp_path, bank_path, trial=trial)


def _first(performance, count):
    names = ("volumes", "rotations", "pelvis")
    return replace(performance, **{name: getattr(performance, name)[:count] for name in names})


def test_fewer_frames_than_latent_dimensions_are_refused(views):
    few = [[[_first(performance, 2) for performance in wearer[:1]] for wearer in view] for view in views]
    with pytest.raises(ConfigError, match="2 frames are too few for 6 latent dimensions"):
        learn_model(few)
