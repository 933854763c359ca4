"""Constants of the articulated fit and of personal builds, chosen with the shipped weights and bank."""

from __future__ import annotations

from typing import NamedTuple


class RefineTuning(NamedTuple):
    """Constants of the refinement of one person."""

    track: bool = True
    """The previous pose is a start beside the candidates."""


class FitTuning(NamedTuple):
    """Constants of the articulated fit (`depth_pose.refine.articulated`).

    The stages share one annealing schedule, ``sigmas``, and take parts of it: a first look at many starts
    (`glance`), a choice between a few (`rough`), the answer (`fine`), and a trial of a size (`trial`).
    """

    sigmas: tuple[float, ...] = (0.06, 0.05, 0.04, 0.034, 0.028, 0.024, 0.02, 0.02)
    """Standard deviation of the points about the skin in each iteration, coarse to fine (m)."""
    coarse_sigma: float = 0.03
    """Iterations above this use a third of the points and half of the skin (m)."""
    outlier: float = 0.3
    """Density of the outlier class in the E-step."""
    plane_weight: float = 1.0
    """Weight of the distance along the normal of the skin."""
    point_weight: float = 0.3
    """Weight of the whole distance."""
    free_space_weight: float = 0.15
    """Weight of skin in free space, beside the silhouette or in front of the surface."""
    free_space_slack: float = 0.04
    """Allowed distance of skin in front of the seen surface (m)."""
    free_space_limit: float = 0.10
    """Maximum pull out of free space in one iteration (m)."""
    proposal_weight: float = 5.0
    """Weight of a proposed joint, in points of the cloud with the same standard deviation."""
    floor_weight: float = 5.0
    """Weight of the floor under a foot near it, in points of the cloud with the same standard deviation."""
    prior: float = 0.1
    """Stiffness of the joints toward the start."""
    damping: float = 0.02
    """Term added to the diagonal of every step."""
    max_step: float = 0.35
    """Maximum rotation of a joint in one step (rad)."""
    max_points: int = 800
    """Maximum number of points of the cloud."""

    @property
    def glance(self) -> tuple[float, ...]:
        """The first quarter of the schedule: enough to rank the starts."""
        return self.sigmas[: len(self.sigmas) // 4]

    @property
    def rough(self) -> tuple[float, ...]:
        """The second quarter, which continues from `glance`."""
        return self.sigmas[len(self.sigmas) // 4 : len(self.sigmas) // 2]

    @property
    def fine(self) -> tuple[float, ...]:
        """The second half, which continues from `rough`."""
        return self.sigmas[len(self.sigmas) // 2 :]

    @property
    def trial(self) -> tuple[float, ...]:
        """The first three quarters: enough to compare two sizes by their scores."""
        return self.sigmas[: 3 * len(self.sigmas) // 4]


class BuildTuning(NamedTuple):
    """Constants of personal builds (`depth_pose.refine.personal`)."""

    sigma: float = 0.02
    """Standard deviation of the points about the skin (m)."""
    noise: float = 0.035
    """Standard deviation of a point (m), inflated because neighbouring pixels and frames are correlated."""
    free_space: float = 0.1
    """Weight of skin in free space relative to the fit; low, because noise erodes the silhouette."""
    memory: float = 20.0
    """Time constant of forgetting (s)."""
    worst_score: float = 0.4
    """Frames whose fit has a higher disagreement, 0 to 1, are not used."""
