r"""Tracking a volume through the latent space (Secs. 3 and 5).

A particle filter: every particle is a latent point that moves by the learned dynamics. For each frame
the descriptors of all headings near the expected one are compared with every particle, each particle
taking the heading that fits it best. There are two likelihoods:

``descriptor``
    :math:`\max_\theta \exp(-|v^\theta - f(x_i)|^2 / 2T)` in the descriptor space, with f the map from X
    to V (Hirai et al. eq. 2);
``latent``
    Hirai et al. eq. 4 as printed, with :math:`x^\theta` regressed from :math:`v^\theta`.

The first is the default. Eq. 4 does not penalise wrong headings: a volume under one resembles no training
volume, the regression returns the mean of X, and there the variance is low (docs/volume.md has both).

The weighted mean of the particles is the latent point, from which the pose is regressed.

Each depth camera has its own view of the model; its surface is compared under a common heading, and the
likelihoods of the cameras are multiplied. So one model serves any number of cameras at any place, and a lost
camera is left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.volume.config import TrackConfig
from depth_pose.volume.descriptor import Bins, describe
from depth_pose.volume.gp import square_distances
from depth_pose.volume.hull import Volume
from depth_pose.volume.model import VolumeModel
from depth_pose.volume.tuning import TrackTuning

Array = NDArray[np.float64]

# Numbers without a source were chosen like the defaults of `depth_pose.volume.config`.
TEMPERATURE = 12.0
"""Temperature T (squared distance in the descriptor space): above 1, as noise is correlated over the bins."""
LATENT_NU, LATENT_W = 0.02, 0.5
"""The paper's nu (squared latent distance), and w as a share of the prior variance; it names no values."""
_AZIMUTH_SIGMA = np.radians(40.0)
"""Maximum distance of a heading from the expected one, radians."""
_MOST_STEPS = 4.0
"""Longest prediction, frames of the training: after a gap the dynamics are uninformative."""
_LEAST_USUAL = 50.0
"""Minimum squared distance of wearers from their mean, about that of five: few give too small an estimate."""
_CLEARLY_BETTER = 0.7
"""A search is accepted if its misfit is below this share of the tracked one's."""
UNLIKELY = 4.0
"""Squared distance, in units of the training's, above which a frame counts as unlikely."""
_SPEED_GAIN = 0.5
"""Share of the newest frame in the turning speed."""


@dataclass(frozen=True)
class Sight:
    """Observation of one camera, or of all of them as one hull.

    Attributes
    ----------
    descriptors : (fine, D) float64
        Of all headings (`depth_pose.volume.descriptor.describe`).
    seen_from : float
        Azimuth of the camera from the person, radians, where the model has several views.
    """

    descriptors: Array
    seen_from: float = 0.0


def describe_headings(volume: Volume, stature: float, bins: Bins) -> list[Sight]:
    """Describe each camera's volume, for a person of a stature (metres)."""
    return [Sight(describe(part, stature, bins), part.seen_from) for part in volume.sights]


@dataclass(frozen=True)
class Tracked:
    """Position of a volume in the latent space.

    Attributes
    ----------
    latent : (d,) float64
    step : float
        Heading in steps of the fine azimuth.
    views : tuple of int
        The model's view of each sight.
    misfit : float
        Squared distance of the descriptors from the model's, relative to that in training; mean of the
        sights.
    """

    latent: Array
    step: float
    views: tuple[int, ...]
    misfit: float


class LatentTracker:
    """The particle filter; frames must be passed in order."""

    def __init__(
        self, model: VolumeModel, config: TrackConfig = TrackConfig(), tuning: TrackTuning = TrackTuning()
    ) -> None:
        self.model, self.config, self.tuning = model, config, tuning
        self._fine = model.bins.fine
        motion = model.to_next
        residual = motion.predict(motion.inputs) - motion.outputs
        self._noise = np.sqrt((residual**2).mean(axis=0) + motion.floor)
        self._usual = max(float(model.spread.mean()), _LEAST_USUAL)
        self.reset()

    def reset(self) -> None:
        """Forget all earlier frames."""
        self._rng = np.random.default_rng(self.tuning.seed)
        self._points: Array | None = None
        self._step, self._speed, self._unlikely = 0.0, 0.0, 0

    def track(self, sights: Sequence[Sight], seconds: float) -> Tracked:
        """Process the next frame.

        Parameters
        ----------
        sights : sequence of Sight
            One for a hull, one for each depth camera that sees the person.
        seconds : float
            Time since the previous frame.
        """
        if self._points is None:
            return self._search(sights)
        steps = min(max(seconds * self.model.fps, 0.05), _MOST_STEPS)
        expected = self._step + self._speed * steps
        reach = round(self.tuning.azimuth_window / 360.0 * self._fine)
        window = np.arange(-reach, reach + 1) + round(expected)
        points = self._move(self._points, steps)
        fresh = round(self.tuning.restarts * len(points))
        if fresh:
            # some restart at training points, preferably those that resemble this frame
            cost = search_costs(self.model, sights, window).min(axis=1)
            points[:fresh] = self.model.latent[self._draw(cost, fresh)]
        cost, best = self._compare(points, sights, window, expected)
        weights = np.exp(-0.5 * (cost - cost.min()))
        weights /= weights.sum()
        self._points, self._weights = points, weights
        latent = weights @ points
        step = float(weights @ best)
        found = self._tracked(latent, sights, step)
        self._speed += _SPEED_GAIN * ((step - self._step) / steps - self._speed)
        self._step = step
        self._unlikely = self._unlikely + 1 if found.misfit > UNLIKELY else 0
        if self._unlikely < self.tuning.lost_after:
            return found
        # lost, or only dressed unlike the training: only a clearly better place is accepted
        self._unlikely = 0
        elsewhere = self._anywhere(sights)
        if elsewhere[0].misfit > _CLEARLY_BETTER * found.misfit:
            return found
        self._start(*elsewhere)
        return elsewhere[0]

    def _move(self, points: Array, steps: float) -> Array:
        """Resample, and predict by the dynamics (Hirai et al. eq. 1)."""
        n, rng = len(points), self._rng
        at = (np.arange(n) + rng.uniform()) / n
        rows = np.minimum(np.searchsorted(np.cumsum(self._weights), at), n - 1)
        moved = points[rows]
        moved = moved + steps * (self.model.to_next.predict(moved) - moved)
        spread = np.sqrt(steps) * self._noise
        moved += spread * rng.normal(size=moved.shape)
        return np.asarray(moved)

    def _compare(
        self, points: Array, sights: Sequence[Sight], window: NDArray[np.int64], expected: float
    ) -> tuple[Array, Array]:
        """Cost (n,) of each particle at its best heading, and that heading in steps.

        The descriptor that a particle stands for is Hirai et al. eq. 2 without its noise. The least cost over
        the headings is the maximum of Hirai et al. eq. 4, which both likelihoods have.
        """
        costs = np.zeros((len(points), len(window)))
        recall = self.config.likelihood == "latent"
        covariance = self.model.to_volume[0].kernel.between(points, self.model.latent)  # of all views
        seen: dict[int, Array] = {}
        for sight in sights:
            components, rest = self.model.space.split(sight.descriptors[window % self._fine])
            views = self.model.views_of(window, sight.seen_from)
            for view in np.unique(views):
                at = views == view
                if recall:
                    costs[:, at] += self._latent_cost(points, components[at], view)
                    continue
                if view not in seen:
                    seen[view] = self.model.to_volume[view].predict_from(covariance)
                costs[:, at] += (square_distances(seen[view], components[at]) + rest[at]) / TEMPERATURE
        if not recall:
            costs += ((window - expected) * (2 * np.pi / self._fine) / _AZIMUTH_SIGMA) ** 2
        # Hirai et al. eq. 4: the greatest likelihood over the azimuths is the least cost
        best = np.argmin(costs, axis=1)
        return costs[np.arange(len(points)), best], window[best].astype(np.float64)

    def _latent_cost(self, points: Array, components: Array, view: int) -> Array:
        r"""Minus twice the logarithm of Hirai et al. eq. 4 for n particles and K headings, (n, K).

        .. math:: \max_\theta \exp(-|x^\theta - x_i|^2 / \nu) \exp(-\sigma_V^2(x^\theta) / w) \qquad (4)

        The regressed point does not depend on the particle, so it is found once for each heading.
        """
        recalled = self.model.to_latent[view].predict(components)
        variance = self.model.to_volume[0].variance(recalled)
        prior = float(np.exp(self.model.volume_kernel[0]))
        # Hirai et al. eq. 4: distance from the regressed point, and how unlike the training it is
        return np.asarray(
            2.0 * square_distances(points, recalled) / LATENT_NU + 2.0 * variance / (LATENT_W * prior)
        )

    def _tracked(self, latent: Array, sights: Sequence[Sight], step: float) -> Tracked:
        views, square = [], 0.0
        for sight in sights:
            views.append(int(self.model.views_of(np.array([step]), sight.seen_from)[0]))
            components, rest = self.model.space.split(sight.descriptors[[round(step) % self._fine]])
            seen = self.model.to_volume[views[-1]].predict(latent[None])
            square += float(((components - seen) ** 2).sum() + rest[0])
        return Tracked(latent, step, tuple(views), square / (len(sights) * self._usual))

    def _search(self, sights: Sequence[Sight]) -> Tracked:
        """Restart at the best training point under any heading."""
        found, cost = self._anywhere(sights)
        self._start(found, cost)
        return found

    def _anywhere(self, sights: Sequence[Sight]) -> tuple[Tracked, Array]:
        """Compare all headings with all training points; return the best, and each point's cost."""
        costs = search_costs(self.model, sights, np.arange(self._fine))
        row, step = np.unravel_index(np.argmin(costs), costs.shape)
        found = self._tracked(self.model.latent[row], sights, float(step))
        return found, costs.min(axis=1)

    def _start(self, found: Tracked, cost: Array) -> None:
        """Place the particles on training points, by their cost."""
        rows = self._draw(cost, self.config.particles)
        spread = self._noise * self._rng.normal(size=(len(rows), self.model.latent.shape[1]))
        self._points = self.model.latent[rows] + spread
        self._weights = np.full(len(rows), 1.0 / len(rows))
        self._step, self._speed, self._unlikely = found.step, 0.0, 0

    def _draw(self, cost: Array, count: int) -> NDArray[np.int64]:
        """Draw training points by their likelihood."""
        weights = np.exp(-0.5 * (cost - cost.min()) / TEMPERATURE)
        return self._rng.choice(len(weights), count, p=weights / weights.sum())


def search_costs(model: VolumeModel, sights: Sequence[Sight], window: NDArray[np.int64]) -> Array:
    """Squared distance (N, K) of every training frame from the descriptors of some headings, summed."""
    costs = np.zeros((len(model.latent), len(window)))
    for sight in sights:
        components, rest = model.space.split(sight.descriptors[window % model.bins.fine])
        views = model.views_of(window, sight.seen_from)
        for view in np.unique(views):
            at = views == view
            costs[:, at] += square_distances(model.volumes[view], components[at]) + rest[at]
    return costs
