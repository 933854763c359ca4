"""Constants of the volume tracker.

They were chosen on further performances (101 and 102 of `benchmarks/parts/dances.py`) that neither training
nor the tables of docs/volume.md use.
"""

from __future__ import annotations

from typing import NamedTuple


class TrackTuning(NamedTuple):
    """Constants of the particle filter, and of the stature."""

    restarts: float = 0.2
    """Share of particles placed on training points similar to the frame."""
    azimuth_window: float = 50.0
    """Azimuths tried to either side of the expected one (degrees)."""
    stature_frames: int = 60
    """Number of frames from which the height is estimated."""
    lost_after: int = 5
    """Number of unlikely frames in a row after which the search is global."""
    seed: int = 0
    """Seed of the particles' random numbers."""


class VolumeFitTuning(NamedTuple):
    """Constants of the fit of a body to the volume; terms as in `depth_pose.refine.tuning.FitTuning`."""

    sigmas: tuple[float, ...] = (0.06, 0.045, 0.035, 0.028, 0.025)
    """Standard deviation of the points about the skin in each iteration, coarse to fine (m)."""
    outlier: float = 0.3
    """Weight u of the outlier class beside a vertex at no distance."""
    plane_weight: float = 1.0
    """Weight of distances along the normal of the skin."""
    point_weight: float = 0.3
    """Weight of distances in all directions."""
    prior: float = 1.0
    """Weight that holds joints near the regressed pose."""
    root_prior: float = 20.0
    """Weight that holds the pelvis near the regressed place."""
    damping: float = 0.02
    """Damping of every Gauss-Newton step."""
    max_step: float = 0.35
    """Maximum rotation of a joint in one iteration (rad)."""
    max_points: int = 400
    """Maximum number of surface voxels for the fit."""
    trust_power: float = 2.0
    """Exponent of a vertex's visibility under clothing."""


class LearnTuning(NamedTuple):
    """Constants of learning the dynamical model and the regressions."""

    noise_floor: float = 2e-3
    """Minimum noise variance of the dynamics."""
    pose_variance: float = 0.99
    """Share of the poses' variance kept by their latent space."""


class VolumeTuning(NamedTuple):
    """All constants of the volume tracker."""

    track: TrackTuning = TrackTuning()
    fit: VolumeFitTuning = VolumeFitTuning()
    learn: LearnTuning = LearnTuning()
