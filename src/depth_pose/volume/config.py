"""Settings of the volume tracker, with their defaults.

Unless stated otherwise they were chosen on further performances (101 and 102 of
`benchmarks/parts/dances.py`) that neither training nor the tables of docs/volume.md use.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from depth_pose.core.config import DenoiseConfig, SegmentConfig
from depth_pose.core.options import Checked, Sections, option


@dataclass(frozen=True)
class SpaceConfig(Checked):
    """The observed space, and its voxels; world frame, y up, floor at 0."""

    voxel: float = option(0.02, "Edge of a voxel", unit="m", low=0.005, high=0.08)
    centre_x: float = option(0.0, "Middle of the space along x", unit="m", low=-1000.0, high=1000.0)
    centre_z: float = option(0.0, "Middle of the space along z", unit="m", low=-1000.0, high=1000.0)
    half_width: float = option(1.4, "Half the width of the space", unit="m", low=0.4, high=10.0)
    height: float = option(2.32, "Height of the space", unit="m", low=0.5, high=5.0)


@dataclass(frozen=True)
class TrackConfig(Checked):
    """The particle filter and the steps after it."""

    particles: int = option(100, "Particles in the latent space", low=10, high=5000)
    likelihood: str = option(
        "descriptor",
        "descriptor: distance of descriptors; latent: eq. 4 of the paper",
        choices=("descriptor", "latent"),
    )
    restarts: float = option(
        0.2, "Share of particles placed on training points similar to the frame", low=0.0, high=1.0
    )
    azimuth_window: float = option(
        50.0, "Azimuths tried to either side of the expected one", unit="deg", low=5.0, high=180.0
    )
    diffusion: float = option(1.0, "Factor on the noise of the dynamics", low=0.0, high=10.0)
    stature: float = option(
        0.0, "The person's height; 0: estimated over the first frames", unit="m", low=0.0, high=2.5
    )
    stature_frames: int = option(60, "Number of frames used to estimate the height", low=1, high=1000)
    lost_after: int = option(5, "Unlikely frames in a row after which the search is global", low=1, high=1000)
    refine: bool = option(True, "Fit a body to the volume, from the regressed pose")
    seed: int = option(0, "Seed of the particles' random numbers", low=0, high=2**31 - 1)


@dataclass(frozen=True)
class VolumeFitConfig(Checked):
    """The fit of a body to the volume; terms as in `depth_pose.core.config.FitConfig`."""

    sigmas: tuple[float, ...] = option(
        (0.06, 0.045, 0.035, 0.028, 0.025),
        "Standard deviation of the points about the skin in each iteration, coarse to fine",
        unit="m",
        low=0.001,
        high=1.0,
    )
    outlier: float = option(
        0.3, "Weight u of the outlier class, relative to a vertex at distance 0", low=0.0, high=10.0
    )
    plane_weight: float = option(1.0, "Weight of distances along the skin's normal", low=0.0, high=100.0)
    point_weight: float = option(0.3, "Weight of distances in all directions", low=0.0, high=100.0)
    prior: float = option(1.0, "Weight that holds joints near the regressed pose", low=0.0, high=1000.0)
    root_prior: float = option(
        20.0, "Weight that holds the pelvis near the regressed place", low=0.0, high=1000.0
    )
    damping: float = option(0.02, "Damping of every Gauss-Newton step", low=0.0, high=10.0)
    max_step: float = option(
        0.35, "Maximum rotation of a joint in one iteration", unit="rad", low=0.01, high=3.0
    )
    max_points: int = option(400, "Maximum number of surface voxels for the fit", low=50, high=100000)
    trust_power: float = option(
        2.0, "Exponent of a vertex's visibility under clothing; 0: all count alike", low=0.0, high=10.0
    )


@dataclass(frozen=True)
class ViewsConfig(Checked):
    """Grouping of images of several cameras to sets of views of one time."""

    tolerance: float = option(
        0.004, "Maximum difference of stamps within one set of views", unit="s", low=0.0, high=1.0
    )
    patience: float = option(
        0.012, "Live: how long a set waits for a late camera", unit="s", low=0.0, high=10.0
    )
    gone_after: float = option(
        0.5, "A camera silent for this long is gone and not waited for", unit="s", low=0.05, high=60.0
    )
    depth_scale: float = option(
        0.0, "Metres per unit of depth; 0: 0.001 for integers, 1 for floats", low=0.0, high=1e3
    )
    cut_out: bool = option(True, "Depth: find the person in the images; false: they show only the person")


@dataclass(frozen=True)
class LearnConfig(Checked):
    """Learning of the dynamical model and the regressions."""

    latent: int = option(6, "Dimensions of the latent space", low=2, high=20)
    iterations: int = option(150, "Maximum steps of the optimiser", low=1, high=10000)
    dynamics_weight: float = option(1.0, "Weight of the dynamics against the volumes", low=0.0, high=1000.0)
    noise_floor: float = option(2e-3, "Least noise variance of the dynamics", low=1e-8, high=1.0)
    pose_variance: float = option(
        0.99, "Share of the poses' variance kept by their latent space", low=0.5, high=1.0
    )


@dataclass(frozen=True)
class VolumeConfig(Sections):
    """All settings of the volume tracker; those of finding the person in depth images are shared."""

    segment: SegmentConfig = field(default=SegmentConfig())
    denoise: DenoiseConfig = field(default=DenoiseConfig())
    views: ViewsConfig = ViewsConfig()
    space: SpaceConfig = SpaceConfig()
    track: TrackConfig = TrackConfig()
    fit: VolumeFitConfig = VolumeFitConfig()
    learn: LearnConfig = LearnConfig()
