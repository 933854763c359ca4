"""Measure the joints of one detection, its mask, and the probability that it is a person.

The finder processes whole images and locates trunks well, limbs badly. A joint net processes the crop around
one torso. `JointNet` is its interface; another net is another class.

In the packaged net (`VotingNet`) each cell of the crop votes for every landmark and predicts a weight for its
vote (Xiong et al. 2019, *A2J*); it also predicts the deviation of each in the image plane and in depth, and
whether the person is seen from behind. Hidden joints are inferred from the others, with larger deviations.
Last, it predicts the probability that this is a person and not an object, trained on the finder's detections.
Of people who were measured well by the last look its fine part processes only the window of the crop that
shows them (`crop_window`). Its parts are `crop`, the net itself, `joint_codec` and `joint_calibration`.
``tools/people_finder`` makes the weights; their settings hold the size of the crop. There are two nets:
`THOROUGH`, which also sees the crop at a coarser scale, and `QUICK`, the same without that, for people who
were measured well before.
"""

from __future__ import annotations

import json
import threading
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.measurement import TYPICAL_ERROR_M, CropMask, JointMeasurement
from depth_pose.core.skeleton import JOINTS
from depth_pose.detect import _crop_kernels as kernels
from depth_pose.detect.crop import Crop, CropSample, CropSampler
from depth_pose.detect.crop_mask import without_denied
from depth_pose.detect.crop_window import CELL, CropGrid, Window, cells_of, window_around
from depth_pose.detect.joint_calibration import JointCalibration, crop_measures
from depth_pose.detect.joint_codec import JointCodec, JointCodes
from depth_pose.detect.net import open_net, read_weights

_OUTPUTS = ["landmarks", "log_error", "behind", "person", "mask"]
"""Outputs of the net."""

THOROUGH, QUICK = "joint_finder", "quick_joint_finder"
"""Names of the packaged nets. For a whole crop the second takes .75 of the first's multiplications; for a
window around somebody who stands, the first takes .6 and the second .35 of the first's for a whole crop."""

_JOINT_COUNT = len(JOINTS)

_DENIED = 0.08
"""Share of a person's pixels from which, if the net's mask denies them, it looks again without them: joints
of a person on a bed or sofa that the finder took for a part of them; chosen on a bed below a ceiling."""


class JointNet(Protocol):
    """Measures the joints of one detection; keeps no state between frames."""

    def look(self, crop: Crop) -> JointMeasurement:
        """Measure the joints of a crop's person, with the probability of a person, and a mask."""


class VotingNet:
    """The packaged joint net.

    Parameters
    ----------
    weights : path, optional
        A folder with a net in place of the packaged one.
    mirror : bool
        Whether to look at the mirror image, too, and to take the mean of both answers.
    name : str
        `THOROUGH` or `QUICK`.

    Attributes
    ----------
    sampler : CropSampler
    session : InferenceSession
    codec : JointCodec
    calibration : JointCalibration
    """

    def __init__(self, weights: Path | None = None, mirror: bool = False, name: str = THOROUGH) -> None:
        self._mirror = mirror
        settings = json.loads(read_weights(f"{name}.json", weights))
        middle = np.array(settings.get("middle", ()), np.int64)
        coarse = (len(middle) // CELL, settings["coarse_cell_m"]) if len(middle) else ()
        grid = CropGrid(settings["side"], settings["cell_m"], *coarse)
        self._whole = grid.whole
        self.sampler = CropSampler(grid.side, grid.cell_m)
        self.session = open_net(read_weights(f"{name}.onnx", weights))
        self.codec = JointCodec(float(settings["least_width_m"]))
        self.calibration = JointCalibration.of(settings)
        self._inputs = _Inputs(grid, middle)

    def look(self, crop: Crop) -> JointMeasurement:
        """Measure the joints of a crop's person."""
        sample = self.sampler.sample(crop)
        codes = self._ask(sample, crop)
        own = sample.whose == crop.label
        denied = own & (codes.mask < 0.0)
        if denied.sum() > _DENIED * own.sum():
            crop = crop._replace(labels=without_denied(CropMask(codes.mask, sample.view), crop))
            sample = self.sampler.sample(crop)
            codes = self._ask(sample, crop)
        measures = crop_measures(sample, crop.label)
        if self._mirror:
            flipped = self._ask(self.sampler.sample(crop, flip=-1.0), crop)
            codes = codes.mean(flipped.mirrored())
        decoded = self.codec.decode(codes, sample.view)
        sigma = decoded.sigma * self.calibration.deviations.factors(measures)
        confidence = 1.0 / (1.0 + (decoded.error[:_JOINT_COUNT] / TYPICAL_ERROR_M) ** 2)
        return JointMeasurement(
            places=_rounded(decoded.places[:_JOINT_COUNT]),
            sigma=_rounded(sigma[:_JOINT_COUNT]),
            confidence=_rounded(confidence),
            heels=_rounded(np.concatenate([decoded.places, sigma], axis=1)[_JOINT_COUNT:]),
            left_right_confidence=decoded.left_right_confidence,
            probability=self.calibration.odds(crop.expected is not None).probability(
                crop.probability, codes.person
            ),
            mask=CropMask(codes.mask, sample.view),
        )

    def _ask(self, sample: CropSample, crop: Crop) -> JointCodes:
        """Run the net on a crop, or on the window of it that shows a person whose joints are expected."""
        window = self._whole
        if crop.expected is not None:
            window = window_around(sample, crop.label, crop.expected)
        kernels.fill_features(sample.grid, sample.whose, crop.label, sample.view, self._inputs.features)
        places, log_width, behind, person, seen = self.session.run(_OUTPUTS, self._inputs.of(window))
        mask = seen[0]
        if window != self._whole:  # nothing is known outside
            mask = np.zeros(sample.grid.shape, np.float32)
            mask[window.top : window.bottom, window.left : window.right] = seen[0]
        return JointCodes(places[0], log_width[0], float(behind[0]), float(person[0]), mask)


class _Inputs(threading.local):
    """The net's inputs, in arrays that are used again. Each thread has its own.

    Attributes
    ----------
    features : (CHANNELS, side, side) float32
        Of the whole crop.
    """

    def __init__(self, grid: CropGrid, middle: NDArray[np.int64]) -> None:
        self._grid, self._middle = grid, middle
        self.features = np.zeros((kernels.CHANNELS, grid.side, grid.side), np.float32)
        self._coarse = np.empty((1, kernels.CHANNELS, len(middle), len(middle)), np.float32)

    def of(self, window: Window) -> dict[str, NDArray[np.float32] | NDArray[np.int64]]:
        """Return the inputs for a window; the coarse part sees the whole crop."""
        shown = self.features[None, :, window.top : window.bottom, window.left : window.right]
        given = {"features": np.ascontiguousarray(shown)} | cells_of(self._grid, window)
        if len(self._middle):
            kernels.take_pixels(self.features, self._middle, self._coarse[0])
            given["middle"] = self._coarse
        return given


def _rounded(values: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return float32, as messages carry it."""
    return values.astype(np.float32)
