"""Settings of the volume tracker; all other values are constants (`depth_pose.volume.tuning`)."""

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
    stature: float = option(
        0.0, "The person's height; 0: estimated over the first frames", unit="m", low=0.0, high=2.5
    )
    refine: bool = option(True, "Fit a body to the volume, from the regressed pose")


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


@dataclass(frozen=True)
class VolumeConfig(Sections):
    """All settings of the volume tracker; those of finding the person in depth images are shared."""

    segment: SegmentConfig = field(default=SegmentConfig())
    denoise: DenoiseConfig = field(default=DenoiseConfig())
    views: ViewsConfig = ViewsConfig()
    space: SpaceConfig = SpaceConfig()
    track: TrackConfig = TrackConfig()
    learn: LearnConfig = LearnConfig()
