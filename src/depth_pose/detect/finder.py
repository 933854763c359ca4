"""Detect all people in a depth image, with a small net trained on simulated rooms.

Sec. 4 of the paper cuts one person out with two distances. Here a net predicts for every pixel of a reduced
image whether it shows a person, and the offset in metres to that person's torso. Votes for one torso
concentrate, so people are separated by place, not by connectivity (`depth_pose.detect.clusters`). Measures of
each cluster then distinguish people from objects (`depth_pose.detect.verifier`). Finally the labels are
transferred to the grid of the later steps, along depth edges (`depth_pose.detect.outline`).

The size of a pixel at its distance is an input, so one net serves every sensor, field of view and mounting.
``tools/people_finder`` trains the weights.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.config import SegmentConfig
from depth_pose.core.frame import DepthFrame
from depth_pose.core.odds import logistic
from depth_pose.detect import _finder_kernels as kernels
from depth_pose.detect import working_grid
from depth_pose.detect._finder_kernels import NetImage
from depth_pose.detect._vote_kernels import claim_pixels
from depth_pose.detect.background import StillBackground
from depth_pose.detect.clusters import Clusters, VoteGatherer
from depth_pose.detect.net import open_net, read_weights
from depth_pose.detect.outline import carry_people, spread
from depth_pose.detect.tuning import DetectTuning
from depth_pose.detect.turned import NORMAL_GRID, Turned, reduce_frame
from depth_pose.detect.verifier import Verifier

LEAST_PIXELS = 12
"""Least number of working-grid pixels of a person."""

_CLAIM_LOGIT, _CLAIM_M = -2.0, 0.17
"""Least logit (a probability of .12), and maximum distance (m) of the vote from a torso, of pixels that
may belong to a person: shanks below a desk vote within .14 m, chairs at .22 m."""

_CONTACT, _LEAST_CONTACT = 18, 0.3
"""Index of the measure of contact with a neighbour, and its least value for a part of that neighbour."""

_MEAN, _SURE, _AREA, _JUMP, _ASIDE, _SMALLER = 0, 1, 6, 12, 17, 19
"""Indices of measures: mean probability, share of sure pixels, logarithm of the area, share of the edge
with a depth jump; lateral distance of the neighbour, and natural logarithm of the size ratio."""

_FRINGE_MEAN, _FRINGE_SURE, _FRINGE_JUMP, _FRINGE_ASIDE_M, _FRINGE_SMALLER = 0.6, 0.1, 0.25, 0.65, 0.7
"""Limits on these measures for the wall around a person (`_is_fringe`); chosen on development clips."""


@dataclass(frozen=True)
class TorsoDetection:
    """One person in one frame.

    Attributes
    ----------
    label : int
        Number in `FinderResult.labels`, from 1.
    probability : float
        Probability of a person.
    torso : (3,) float64
        Centre of shoulders and hips, camera frame, metres.
    """

    label: int
    probability: float
    torso: NDArray[np.float64]


@dataclass(frozen=True)
class FinderResult:
    """All detections in one frame, on the working grid.

    Attributes
    ----------
    depth : (h, w) float32
        The frame's depth on the working grid, metres; 0 without depth.
    labels : (h, w) uint8
        Number of the person at each pixel; 0: background.
    camera : Camera
        Camera of the working grid.
    chance : (h, w) float32
        Person probability of every pixel from the net, 0 to 1.
    claims : (h, w) uint8
        Number of the confirmed person whose torso a pixel votes for, whether labelled or not; 0: none.
    people : tuple of TorsoDetection
        Nearest first.
    out_of_range : int
        Number of further people nearer than `SegmentConfig.near` or farther than `SegmentConfig.far`.
    """

    depth: NDArray[np.float32]
    labels: NDArray[np.uint8]
    camera: Camera
    chance: NDArray[np.float32]
    claims: NDArray[np.uint8]
    people: tuple[TorsoDetection, ...]
    out_of_range: int


class PeopleFinder:
    """Finds people; keeps no state between frames.

    Parameters
    ----------
    config : SegmentConfig, optional
    model : bytes, optional
        The net (ONNX) in place of the packaged one, with ``settings``.
    settings : mapping, optional
        Settings that belong to the net: its verifier.
    tuning : DetectTuning
    """

    def __init__(
        self,
        config: SegmentConfig | None = None,
        model: bytes | None = None,
        settings: dict[str, Any] | None = None,
        tuning: DetectTuning = DetectTuning(),
    ) -> None:
        self.config, self._tuning = config or SegmentConfig(), tuning
        if model is None or settings is None:
            model, settings = load_weights()
        self.settings = settings
        self.verifier = Verifier.from_mapping(settings["verifier"]) if "verifier" in settings else None
        self._session = open_net(model)
        self._input = self._session.get_inputs()[0].name
        self._allocate(NORMAL_GRID)
        self._gatherer = VoteGatherer()

    def _allocate(self, shape: tuple[int, ...]) -> None:
        """Make the work space for a grid; usually once."""
        self._features = np.zeros((1, kernels.CHANNELS, *shape), np.float32)
        self._unknown = np.zeros(shape, np.float32)
        self._sums = np.zeros((shape[0] + 1, shape[1] + 1))
        self._counts = np.zeros((shape[0] + 1, shape[1] + 1), np.int64)
        self._torso = np.zeros((4, *shape), np.float32)

    def warm_up(self) -> None:
        """Compile and load everything, so that the first frame is not slower."""
        rows, cols = np.mgrid[:120, :160]
        depth = np.where(np.hypot(rows - 60, 3.0 * (cols - 80)) < 50, 2.0, 4.0).astype(np.float32)
        self.find(DepthFrame(0, "", depth, Camera(160, 120, 140.0, 140.0, 79.5, 59.5)))

    def find(
        self, frame: DepthFrame, turns: int = 0, background: StillBackground | None = None
    ) -> FinderResult:
        """Detect all people in a frame.

        Parameters
        ----------
        frame : DepthFrame
        turns : int
            Quarter turns, counter-clockwise, of the net's input image: the net detects upright people
            best. The result refers to the unrotated frame.
        background : StillBackground, optional
            Of the frames before; the frame is added to it. Not used for a rotated image.

        Returns
        -------
        FinderResult
            Empty if no person is in view.
        """
        image = reduce_frame(frame, self.config.near)
        turned = Turned(frame, turns, self.config.near, image.depth.shape) if turns else None
        behind = None if background is None else background.look(image, frame.stamp_ns)
        mask, torso, found = self._vote(image, behind, turned)
        depth, camera = working_grid.reduce_frame(frame, self.config)
        probability = (
            np.ones(len(found.torsos)) if self.verifier is None else self.verifier.probability(found.measures)
        )
        probability[_is_fringe(found.measures)] = 0.0
        distance = found.torsos[:, 2]
        near_enough = (distance >= self.config.near) & (distance <= self.config.far)
        likely = (probability >= self._tuning.keep) & near_enough
        beyond = int(((probability >= self._tuning.likely) & ~near_enough).sum())
        chosen = np.flatnonzero(likely)[np.argsort(distance[likely], kind="stable")]
        number = np.zeros(len(distance) + 1, np.uint8)
        number[chosen + 1] = np.arange(1, len(chosen) + 1)
        join_parts(found, number, probability < self._tuning.keep)
        net_chance = logistic(mask)
        labels = carry_people(image, number[found.labels], net_chance, depth, camera)
        pixels = np.bincount(labels.ravel(), minlength=len(chosen) + 1)
        people = tuple(
            TorsoDetection(n, float(probability[k]), found.torsos[k])
            for n, k in enumerate(chosen, start=1)
            if pixels[n] >= LEAST_PIXELS
        )
        claims = claim_pixels(image, mask, torso, _CLAIM_LOGIT, found.torsos[chosen], _CLAIM_M)
        sure = np.zeros(len(chosen) + 1, np.uint8)
        for person in people:
            sure[person.label] = person.label if person.probability >= self._tuning.likely else 0
        return FinderResult(
            depth,
            labels,
            camera,
            spread(net_chance, image, camera),
            spread(sure[claims], image, camera),
            people,
            beyond,
        )

    def cluster(
        self, image: NetImage, background: NDArray[np.float32] | None = None
    ) -> tuple[NDArray[np.float32], Clusters]:
        """Run the net, and cluster its votes.

        Parameters
        ----------
        image : NetImage
        background : (H, W) float32, optional
            `StillBackground.depth`; unknown by default.

        Returns
        -------
        mask : (H, W) float32
            Logit of the probability that a pixel shows a person.
        clusters : Clusters
        """
        mask, _, clusters = self._vote(image, background)
        return mask, clusters

    def _vote(
        self, image: NetImage, background: NDArray[np.float32] | None, turned: Turned | None = None
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], Clusters]:
        """Run the net, on another image where one is given, and cluster its votes."""
        if image.depth.shape != self._unknown.shape:
            self._allocate(image.depth.shape)
        shown = image if turned is None else turned.image
        behind = self._unknown if background is None or turned is not None else background
        kernels.fill_features(shown, behind, self._sums, self._counts, self._features[0])
        packed_mask, packed_torso = self._session.run(None, {self._input: self._features})
        mask, torso = np.empty((1, *image.depth.shape), np.float32), self._torso
        kernels.unpack(packed_mask[0], mask)
        kernels.unpack(packed_torso[0], torso)
        if turned is not None:
            mask, torso = turned.back(image, mask, torso)
        return mask[0], torso, self._gatherer.gather(image, mask[0], torso)


def _is_fringe(measures: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which clusters are the wall between a person's limbs.

    They lie beside or behind a cluster of twice their area, the net is at most half sure of them, and their
    surface continues beyond their edge.
    """
    beside = (measures[:, _ASIDE] < _FRINGE_ASIDE_M) & (measures[:, _SMALLER] > _FRINGE_SMALLER)
    unsure = (measures[:, _MEAN] < _FRINGE_MEAN) & (measures[:, _SURE] < _FRINGE_SURE)
    return beside & unsure & (measures[:, _JUMP] < _FRINGE_JUMP)


def join_parts(found: Clusters, number: NDArray[np.uint8], may_join: NDArray[np.bool_]) -> None:
    """Assign rejected clusters to the person they touch, directly or through other clusters.

    Parameters
    ----------
    found : Clusters
        K clusters.
    number : (K + 1,) uint8
        Person of each cluster after the background's 0; changed in place.
    may_join : (K,) bool
        Clusters that may be part of a neighbour.
    """
    parts = may_join & (found.measures[:, _CONTACT] >= _LEAST_CONTACT) & (found.neighbour >= 0)
    largest_first = np.argsort(-found.measures[:, _AREA], kind="stable")  # a neighbour is larger
    for k in largest_first[parts[largest_first]]:
        number[k + 1] = number[found.neighbour[k] + 1]


def load_weights(folder: Path | None = None) -> tuple[bytes, dict[str, Any]]:
    """Read the packaged net, or that of a folder, and its settings."""
    settings = json.loads(read_weights("people_finder.json", folder))
    return read_weights("people_finder.onnx", folder), settings
