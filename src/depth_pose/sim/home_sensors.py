"""Sensors of scenes at home, in four families: structured light, time of flight, active and passive stereo.

The first two are those of `depth_pose.sim.scene_noise` with dropout in blotches on dark surfaces. Active
stereo (RealSense D400: baselines of 5 and 9.5 cm, a projector) errs little; passive stereo (OAK, ZED: 7.5 and
12 cm, no projector) matches large blocks, so its errors are wide bumps, streaks at edges and wrong matches or
holes where surfaces have no texture. Their ranges enclose what ``tools/people_finder/match_blocks.py``
measures on matched images with and without dots.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from depth_pose.sim.scene_noise import SceneSensor, sample_sensor
from depth_pose.sim.sensor import SENSORS
from depth_pose.sim.stereo import StereoConfig

HOME_FAMILIES = ("structured", "tof", "active", "passive")
"""Families of sensors at home, drawn in equal parts."""
_NO_PROJECTOR = ("oak_d", "zed")
"""Stereo cameras of `depth_pose.sim.sensor.SENSORS` that project no pattern."""


def sample_home_sensor(rng: np.random.Generator, family: str | None = None) -> SceneSensor:
    """Sample a sensor of one of `HOME_FAMILIES`, of the given or a random one; `family` keeps that name."""
    name = family or str(rng.choice(HOME_FAMILIES))
    if name in ("structured", "tof"):
        return replace(sample_sensor(rng, name), blotches=rng.uniform(0.0, 1.2))
    active = name == "active"
    return replace(
        sample_sensor(rng, "stereo"),
        family=name,
        stereo=_filtered(_sample_active(rng) if active else _sample_passive(rng), rng),
        native_focal=rng.uniform(350.0, 450.0) if active else rng.uniform(320.0, 520.0),
        texture=(rng.uniform(0.1, 0.5), 0.5) if active else (rng.uniform(-0.5, 0.3), rng.uniform(0.5, 0.9)),
        darkness=rng.uniform(0.0, 0.3) if active else rng.uniform(0.0, 0.2),
    )


def sample_named_sensor(rng: np.random.Generator, name: str) -> SceneSensor:
    """Sample a sensor by its name in `depth_pose.sim.sensor.SENSORS`: range, baseline, steps, matching."""
    model = SENSORS[name]
    near, far, stereo = model.near, model.far, model.stereo
    if stereo is None:
        family = "structured" if model.noise.disparity_step else "tof"
        drawn = sample_home_sensor(rng, family)
        return replace(
            drawn, near=near, far=far, baseline=model.projector_offset, step=model.noise.disparity_step
        )
    drawn = sample_home_sensor(rng, "passive" if name in _NO_PROJECTOR else "active")
    errors = _sample_passive(rng) if name in _NO_PROJECTOR else _sample_active(rng)
    stereo = replace(stereo, rim=errors.rim, mismatch=errors.mismatch, jump=errors.jump)
    return replace(drawn, near=near, far=far, stereo=stereo, native_focal=model.camera.fx)


def _filtered(camera: StereoConfig, rng: np.random.Generator) -> StereoConfig:
    """Sample what a driver does to disparities."""
    return replace(
        camera,
        smoothing=float(rng.choice([0.0, rng.uniform(0.3, 0.9)], p=[0.4, 0.6])),
        smooth_step=float(np.exp(rng.uniform(np.log(0.3), np.log(3.0)))),
        temporal=rng.uniform(0.0, 0.6),
        fill=int(rng.choice(4, p=[0.5, 0.12, 0.25, 0.13])),
        colour_offset=float(rng.choice([0.0, rng.uniform(0.01, 0.06)], p=[0.6, 0.4])),
        margin=int(rng.random() < 0.5),
    )


def _sample_active(rng: np.random.Generator) -> StereoConfig:
    return StereoConfig(
        baseline=float(rng.choice([0.05, 0.055, 0.095])),
        window=int(rng.integers(5, 17)),
        fattening=rng.uniform(0.1, 0.7),
        thin=rng.uniform(0.0, 0.5),
        error=float(np.exp(rng.uniform(np.log(0.06), np.log(0.35)))),
        blob=rng.uniform(4.0, 16.0),
        step=float(rng.choice([1 / 32, 1 / 16])),
        lost=rng.uniform(0.0, 0.35),
        edge_loss=float(rng.choice([0.02, rng.uniform(0.02, 0.6)])),
        rim=rng.uniform(0.0, 3.0),
        mismatch=rng.uniform(0.0, 0.25),
        jump=rng.uniform(1.5, 6.0),
    )


def _sample_passive(rng: np.random.Generator) -> StereoConfig:
    return StereoConfig(
        baseline=float(rng.choice([0.075, 0.12])),
        window=int(rng.integers(7, 26)),
        fattening=rng.uniform(0.1, 0.8),
        thin=rng.uniform(0.0, 0.6),
        error=float(np.exp(rng.uniform(np.log(0.12), np.log(0.5)))),
        blob=rng.uniform(6.0, 30.0),
        step=float(rng.choice([1 / 32, 1 / 16, 1 / 8, 1 / 4])),
        lost=rng.uniform(0.0, 0.5),
        edge_loss=float(rng.choice([0.02, rng.uniform(0.02, 0.6)])),
        rim=rng.uniform(0.5, 5.0),
        mismatch=rng.uniform(0.25, 0.75),
        jump=rng.uniform(1.5, 7.0),
    )
