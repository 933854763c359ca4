r"""The volume descriptor (Sec. 4), for all headings at once.

Surface voxels are counted in bins of height, azimuth and radius about the vertical axis through
the volume's centroid. The world has y up (the paper: z), so the cylindrical coordinates are
``[y, atan2(x, z), sqrt(x^2 + z^2)]``, and a rotation of the person only adds to the azimuth. The paper
prints them in another order than it names them, ``atan(y / x)`` for the angle, and 180 dimensions for
5 x 16 x 2 bins, which are 160: slips.

Three things are not in the paper. Lengths are divided by the person's stature, so that one model serves
people of all heights. The shares are square-rooted, so that the distance of two descriptors is
Hellinger's. Heights, radii and fine azimuths are shared between the two nearest bins, so that nothing
jumps when a voxel crosses over.

The azimuth of a fine histogram is counted once; cumulative sums then give the descriptor for each
of its rotations: row ``s`` is that of a person who faces ``2 pi s / n_fine``, which is the
direction ``(sin, 0, cos)`` of the world frame, with azimuths taken from where they face.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.errors import ConfigError
from depth_pose.core.skeleton import ADULT_STATURE_M
from depth_pose.volume import _descriptor_kernels as kernels
from depth_pose.volume.hull import Volume

OUTER_RADIUS_M = 0.8
"""Radius of the outermost bins' edge for an adult of 1.75 m, metres; they include all beyond. Set by hand."""

TOP_M = 1.2 * ADULT_STATURE_M
"""Height of the topmost bins' edge for an adult of 1.75 m, metres: arms up. Set by hand."""


@dataclass(frozen=True)
class Bins:
    """Numbers of bins in height, azimuth and radius (as in the paper), and of fine azimuths."""

    heights: int = 5
    azimuths: int = 16
    radii: int = 2
    fine: int = 128

    def __post_init__(self) -> None:
        if min(self.heights, self.radii) < 2 or self.azimuths < 4 or self.fine % self.azimuths:
            raise ConfigError(
                f"{self}: at least 2 heights, 2 radii and 4 azimuths, and fine a multiple of azimuths"
            )

    @property
    def size(self) -> int:
        """Dimensions of the descriptor."""
        return self.heights * self.azimuths * self.radii


def describe(volume: Volume, stature: float, bins: Bins | None = None) -> NDArray[np.float64]:
    """Descriptors of a volume for all headings.

    Parameters
    ----------
    volume : Volume
        Not empty.
    stature : float
        The person's height, metres.
    bins : Bins

    Returns
    -------
    (bins.fine, bins.size) float64
        Row ``s`` is for the heading ``2 pi s / bins.fine``; each has norm 1.
    """
    bins = bins or Bins()
    if volume.is_empty:
        raise ValueError("an empty volume has no descriptor")
    fine = np.empty((bins.heights, bins.radii, bins.fine))
    out = np.empty((bins.fine, bins.size))
    scale = ADULT_STATURE_M / stature
    kernels.count_fine(volume.surface, volume.centroid, scale, TOP_M, OUTER_RADIUS_M, fine)
    kernels.sum_rotations(fine, bins.azimuths, out)
    return out


def heading_angle(step: float, bins: Bins) -> float:
    """Radians of a heading given in steps of the fine azimuth."""
    return float(2.0 * np.pi * step / bins.fine)
