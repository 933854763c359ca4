"""The second, closer look at each detection: its joints, and whether it is a person.

The finder looks at whole images and places trunks well, limbs badly. Here a crop around the torso, with the
same pixel size for every sensor and distance, goes through another small net. Each of its cells votes for
every joint and predicts a weight for its vote (Xiong et al. 2019, *A2J*); the net also predicts the deviation
of each joint in the image plane and in depth, and whether the person is seen from behind. Hidden joints are
inferred from the others, with larger deviations. `DeviationScale` calibrates all of them by sensor and
distance. Last, the net predicts the probability that this is a person and not an object, trained on the
finder's detections; logistic regression combines this with the finder's own probability.
``tools/people_finder`` makes the weights; their settings hold the size of the crop.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.measurement import TYPICAL_ERROR_M, CropMask, CropView, JointMeasurement
from depth_pose.core.skeleton import JOINTS, MIRROR_LANDMARKS
from depth_pose.detect import _crop_kernels as kernels
from depth_pose.detect.net import open_net, read_weights

_STANDARD = np.sqrt([3.0, 2.0])
"""Standard deviation of a distribution of width 1: exp(-r) over the plane, each way, and exp(-|z|)."""

_MEAN_SQUARE = np.array([4.0 / 3.0, 0.5])
"""Squares of the mean distances, 2 widths in the plane and 1 in depth, by the squares of those deviations."""

_OUTPUTS = ["landmarks", "log_error", "behind", "person", "mask"]
"""Outputs of the net."""

_JOINT_COUNT = len(JOINTS)
_HALF = np.float32(0.5)
_SUREST = 1e-4
"""Probabilities are limited to this."""


class NetAnswer(NamedTuple):
    """Outputs of the net for one crop.

    Attributes
    ----------
    places : (K, 3) float32
        Landmarks in the crop's coordinates, metres; left and right as in the image.
    log_width : (K, 2) float32
        Logarithms of the widths of their distributions, in the image plane and in depth.
    behind, person : float
        Logits of a back view, and of a person.
    mask : (side, side) float32
    """

    places: NDArray[np.float32]
    log_width: NDArray[np.float32]
    behind: float
    person: float
    mask: NDArray[np.float32]

    def mirrored(self) -> NetAnswer:
        """Return the answer for the mirror image of the crop."""
        places = self.places[MIRROR_LANDMARKS] * np.array([-1.0, 1.0, 1.0], np.float32)
        width, mask = self.log_width[MIRROR_LANDMARKS], np.ascontiguousarray(self.mask[:, ::-1])
        return self._replace(places=places, log_width=width, mask=mask)

    def mean(self, other: NetAnswer) -> NetAnswer:
        """Return the mean of two answers for one crop; left and right of the other are named alike."""
        gap, swapped_gap = (
            np.linalg.norm(self.places - places, axis=1).sum()
            for places in (other.places, other.places[MIRROR_LANDMARKS])
        )
        if swapped_gap < gap:  # seen from the side: then it is also the other view
            places, width = other.places[MIRROR_LANDMARKS], other.log_width[MIRROR_LANDMARKS]
            other = other._replace(places=places, log_width=width, behind=-other.behind)
        return NetAnswer(
            _HALF * (self.places + other.places),
            _HALF * (self.log_width + other.log_width),
            0.5 * (self.behind + other.behind),
            0.5 * (self.person + other.person),
            _HALF * (self.mask + other.mask),
        )


class PersonOdds(NamedTuple):
    """Logistic regression on both looks' logits of a person.

    Attributes
    ----------
    first, second : float
        Weights of the logits of the finder and of the second look.
    bias : float
    """

    first: float
    second: float
    bias: float

    def probability(self, found: float, logit: float) -> float:
        """Combine the finder's probability and the second look's logit."""
        return _logistic(self.first * logit_of(found) + self.second * logit + self.bias)


_BENDS = (1, 4)
"""Steps of `measure_bend`, pixels of a crop."""

_PAIRS = np.triu_indices(1 + len(_BENDS))
"""All pairs of two `look_measures`, each with itself, too."""


class DeviationScale(NamedTuple):
    """Factors on the net's deviations, by sensor and distance: exponentials of quadratic functions.

    Attributes
    ----------
    weights : (2, K) float64
        Weights of the `terms`, in the plane and in depth.
    least, most : (M,) float64
        Range of the `look_measures` for which the weights were fitted; others are clipped.
    """

    weights: NDArray[np.float64]
    least: NDArray[np.float64]
    most: NDArray[np.float64]

    def terms(self, measures: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return 1, the measures (..., M) from -1 to 1, and the products of two of them, (..., K)."""
        x = 2.0 * (measures.clip(self.least, self.most) - self.least) / (self.most - self.least) - 1.0
        first, second = _PAIRS
        return np.concatenate([np.ones_like(x[..., :1]), x, x[..., first] * x[..., second]], axis=-1)

    def factors(self, measures: NDArray[np.float64]) -> NDArray[np.float64]:
        """Compute the factors (..., 2) for looks with measures (..., M)."""
        return np.exp(self.terms(measures) @ self.weights.T)


def look_measures(
    grid: NDArray[np.float32], whose: NDArray[np.int64], label: int, distance: float
) -> NDArray[np.float64]:
    """Return what tells sensors and distances apart, (3,): logarithms of the distance and of bends, metres.

    Parameters
    ----------
    grid, whose : (side, side)
        A crop's depth, metres, and labels (`sample_crop`).
    label : int
        The person's.
    distance : float
        Of the torso, metres.
    """
    return np.log([distance, *(kernels.measure_bend(grid, whose, label, step) for step in _BENDS)])


def logit_of(probability: float) -> float:
    """Return the logit of a probability, clipped to `_SUREST` from 0 and 1."""
    p = min(max(probability, _SUREST), 1.0 - _SUREST)
    return float(np.log(p / (1.0 - p)))


def _logistic(logit: float) -> float:
    return float(1.0 / (1.0 + np.exp(-logit)))


def _spread(log_width: NDArray[np.float32], least: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return standard deviations (J, 2) and mean distances (J,) of a net's distributions, metres.

    ``log_width`` is (J, 2), in the image plane and in depth.
    """
    width = least + np.exp(log_width.astype(np.float64).clip(-6.0, 2.0))
    sigma = _STANDARD * width
    return sigma, np.sqrt(sigma**2 @ _MEAN_SQUARE)


class JointFinder:
    """Proposes joints; keeps no state between frames.

    Parameters
    ----------
    weights : path, optional
        A folder with a net in place of the packaged one.
    mirror : bool
        Whether to look at the mirror image, too, and to take the mean of both answers.
    """

    def __init__(self, weights: Path | None = None, mirror: bool = False) -> None:
        self._mirror = mirror
        self._session = open_net(read_weights("joint_finder.onnx", weights))
        settings = json.loads(read_weights("joint_finder.json", weights))
        self._person = PersonOdds(*settings["person"])
        self._deviations = DeviationScale(
            *(np.array(settings["deviations"][k]) for k in DeviationScale._fields)
        )
        self._cell_m, self._least_width_m = float(settings["cell_m"]), float(settings["least_width_m"])
        shape = (int(settings["side"]), int(settings["side"]))
        self._features = np.zeros((1, kernels.CHANNELS, *shape), np.float32)
        self._rows = np.array(settings["middle"])
        self._middle = np.zeros((1, kernels.CHANNELS, len(self._rows), len(self._rows)), np.float32)
        self._inputs = {"features": self._features, "middle": self._middle}
        self._grid, self._whose = np.empty(shape, np.float32), np.empty(shape, np.int64)

    def find(
        self,
        depth: NDArray[np.float32],
        labels: NDArray[np.uint8],
        camera: Camera,
        label: int,
        torso: NDArray[np.float64],
        probability: float,
    ) -> JointMeasurement:
        """Find the joints of one person.

        Parameters
        ----------
        depth : (h, w) float32
            The whole image, metres; 0 where nothing returned.
        labels : (h, w) uint8
            Number of the person at each pixel.
        camera : Camera
        label : int
            Number of this person.
        torso : (3,) float64
            Approximate middle of shoulders and hips, camera frame, metres.
        probability : float
            Probability of a person, from the first look.
        """
        x, y, z = torso.tolist()
        look = CropView(x, y, z, self._cell_m)
        answer = self._ask(depth, labels, camera, label, look)
        if self._mirror:
            mirrored = self._ask(depth, labels, camera, label, look._replace(flip=-1.0))
            answer = answer.mean(mirrored.mirrored())
        points = kernels.from_crop(answer.places.astype(np.float64), look)
        sigma, error = _spread(answer.log_width, self._least_width_m)
        sigma *= self._deviations.factors(look_measures(self._grid, self._whose, label, z))
        from_behind = _logistic(answer.behind)
        if from_behind > 0.5:
            points, sigma, error = (v[MIRROR_LANDMARKS] for v in (points, sigma, error))
        apart = np.linalg.norm(points - points[MIRROR_LANDMARKS], axis=1)
        error += min(from_behind, 1.0 - from_behind) * apart
        both = self._person.probability(probability, answer.person)
        heels = np.column_stack([points, sigma])[_JOINT_COUNT:]
        error = error[:_JOINT_COUNT]
        return JointMeasurement(
            places=points[:_JOINT_COUNT].astype(np.float32),
            sigma=sigma[:_JOINT_COUNT].astype(np.float32),
            confidence=(1.0 / (1.0 + (error / TYPICAL_ERROR_M) ** 2)).astype(np.float32),
            heels=heels.astype(np.float32),
            sides=max(from_behind, 1.0 - from_behind),
            probability=both,
            mask=CropMask(answer.mask, look),
        )

    def _ask(
        self,
        depth: NDArray[np.float32],
        labels: NDArray[np.uint8],
        camera: Camera,
        label: int,
        look: CropView,
    ) -> NetAnswer:
        """Run the net on one crop."""
        kernels.sample_crop(depth, labels, camera, look, self._grid, self._whose)
        kernels.fill_features(self._grid, self._whose, label, look, self._features[0])
        kernels.take_pixels(self._features[0], self._rows, self._middle[0])
        places, log_width, behind, person, mask = self._session.run(_OUTPUTS, self._inputs)
        return NetAnswer(places[0], log_width[0], float(behind[0]), float(person[0]), mask[0])
