"""The joints of one person as a net measured them in one frame, with their deviations.

`JointMeasurement` is made once, by the joint net (`depth_pose.detect`), and carried unchanged to the end:
through tracking, matching, fitting and recovery, in one process and as a message.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.skeleton import JOINT_NODES, JOINTS, MIRROR_JOINTS

TYPICAL_ERROR_M = 0.1
"""Expected error (m) of a measured joint at which its confidence is one half."""

_JOINT_COUNT = len(JOINTS)
_NAMINGS = np.array([np.arange(_JOINT_COUNT), MIRROR_JOINTS])
_NO_HEELS = np.zeros((2, 0, 5))


class CropView(NamedTuple):
    """Placement of a crop in an image.

    Attributes
    ----------
    x, y, z : float
        Centre of the torso, camera frame, metres.
    cell : float
        Side of a pixel of the crop at the torso's distance, metres.
    cos, sin : float
        Cosine and sine of the crop's rotation in the image.
    flip : float
        1, or -1 for the mirror image.
    coarse : int
        Side of the blocks of pixels that are read as one; each block shows its first pixel.
    """

    x: float
    y: float
    z: float
    cell: float
    cos: float = 1.0
    sin: float = 0.0
    flip: float = 1.0
    coarse: int = 1


@dataclass(frozen=True)
class CropMask:
    """Which pixels of a crop show the person; `depth_pose.detect.crop_mask` applies it to labels.

    Attributes
    ----------
    logits : (side, side) float32
    view : CropView
        Placement of the crop in the image.
    """

    logits: NDArray[np.float32]
    view: CropView


class Proposals(NamedTuple):
    """Measured joints under both namings of left and right, as the compiled loops of the fit read them.

    Attributes
    ----------
    nodes : (J,) int64
        The body's node of each joint.
    places : (2, J, 3) float64
        Camera frame, metres: named as measured, and with left and right exchanged.
    weights : (2, J) float64
        Confidence of each, 0 to 1.
    sigmas : (2, J, 2) float64
        Standard deviation of each across its ray and along it, metres.
    heels : (2, H, 5) float64
        As in `JointMeasurement`, under both namings.
    """

    nodes: NDArray[np.int64]
    places: NDArray[np.float64]
    weights: NDArray[np.float64]
    sigmas: NDArray[np.float64]
    heels: NDArray[np.float64] = _NO_HEELS


NO_PROPOSALS = Proposals(np.zeros(0, np.int64), np.zeros((2, 0, 3)), np.zeros((2, 0)), np.zeros((2, 0, 2)))
"""For people without measured joints."""


class NamedJoints(NamedTuple):
    """Measured joints under one naming of left and right.

    Attributes
    ----------
    places : (19, 3) float64
        Camera frame, metres.
    confidence : (19,) float64
    sigmas : (19, 2) float64
        Standard deviations across the ray and along it, metres.
    is_exchanged : bool
        Whether left and right are exchanged against the measurement.
    """

    places: NDArray[np.float64]
    confidence: NDArray[np.float64]
    sigmas: NDArray[np.float64]
    is_exchanged: bool


def _no_heels() -> NDArray[np.float32]:
    return np.zeros((0, 5), np.float32)


@dataclass(frozen=True)
class JointMeasurement:
    """Measured joints of one person in one frame, hidden ones included.

    Attributes
    ----------
    places : (19, 3) float32
        Joints (`depth_pose.JOINTS`), camera frame, metres.
    sigma : (19, 2) float32
        Standard deviation of each, metres: in each direction of the image plane, and in depth.
    confidence : (19,) float32
        0 to 1; one half where the expected error, including that of exchanged sides, is `TYPICAL_ERROR_M`.
    heels : (H, 5) float32
        Backs of the left and the right heel, camera frame, metres, and their two standard deviations; no rows
        where a net does not measure heels.
    left_right_confidence : float
        Probability that left and right are not exchanged, .5 to 1.
    probability : float
        Probability that this is a person, 0 to 1, in this frame.
    mask : CropMask or None
        Pixels that show the person; None outside the process that measured.
    """

    places: NDArray[np.float32]
    sigma: NDArray[np.float32]
    confidence: NDArray[np.float32]
    heels: NDArray[np.float32] = field(default_factory=_no_heels)
    left_right_confidence: float = 1.0
    probability: float = 1.0
    mask: CropMask | None = None

    def __post_init__(self) -> None:
        for name, shape in (
            ("places", (_JOINT_COUNT, 3)),
            ("sigma", (_JOINT_COUNT, 2)),
            ("confidence", (_JOINT_COUNT,)),
        ):
            if getattr(self, name).shape != shape:
                raise ValueError(f"{name} has shape {getattr(self, name).shape}, not {shape}")

    @cached_property
    def both(self) -> Proposals:
        """The joints under both namings of left and right."""
        return Proposals(
            JOINT_NODES,
            self.places[_NAMINGS].astype(np.float64),
            self.confidence[_NAMINGS].astype(np.float64),
            self.sigma[_NAMINGS].astype(np.float64),
            np.array([self.heels, self.heels[::-1]], np.float64),
        )

    def named_like(self, joints: NDArray[np.float64]) -> NamedJoints:
        """Return the joints under the naming of left and right that is nearer to ``joints``, (19, 3)."""
        both = self.both
        apart = (both.weights * ((both.places - joints) ** 2).sum(axis=2)).sum(axis=1)
        side = 0 if apart[0] <= apart[1] else 1
        return NamedJoints(both.places[side], both.weights[side], both.sigmas[side], side == 1)

    def moved(self, by: NDArray[np.float64], unsure_m: float) -> JointMeasurement:
        """Return the joints translated by a vector (3,), metres, with a deviation added to theirs."""
        heels = np.column_stack([self.heels[:, :3] + by, np.hypot(self.heels[:, 3:], unsure_m)])
        mask = self.mask
        if mask is not None:
            x, y, z = (mask.view.x, mask.view.y, mask.view.z) + by
            mask = replace(mask, view=mask.view._replace(x=x, y=y, z=z))
        return replace(
            self,
            places=(self.places + by).astype(np.float32),
            sigma=np.hypot(self.sigma, unsure_m).astype(np.float32),
            heels=heels.astype(np.float32),
            mask=mask,
        )


def both_namings(measured: JointMeasurement | None) -> Proposals:
    """Return a person's joints under both namings of left and right; empty without a measurement."""
    return NO_PROPOSALS if measured is None else measured.both
