"""The model learned from performances, and its file.

The file is a plain ``.npz`` of arrays and one JSON text; reading executes nothing from it.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.arrays import DamagedArrays, load_arrays
from depth_pose.core.errors import ConfigError, InputError
from depth_pose.core.outputs import new_file
from depth_pose.volume.descriptor import Bins
from depth_pose.volume.gp import Kernel, Regression
from depth_pose.volume.gpdm import chain_rows
from depth_pose.volume.posespace import PoseSpace
from depth_pose.volume.space import DescriptorSpace

Array = NDArray[np.float64]

FORMAT = "depth_pose volume model"
VERSION = 1
"""Version of the file; models of any other are refused."""

INPUTS = ("silhouettes", "depth")

_META: dict[str, Any] = {
    "bins": list, "fps": (int, float), "noise_floor": (int, float), "input": str, "about": str,
    "performances": list, "frames": int, "wearers": int, "statures": list,
}  # fmt: skip
DIMENSIONS = {
    "latent": 2, "lengths": 1, "volumes": 3, "spread": 1, "poses": 3, "rotations": 4, "space_mean": 1,
    "space_whiten": 2, "space_basis": 2, "pose_mean": 1, "pose_basis": 2, "volume_kernel": 1,
    "motion_kernel": 1, "recall_kernel": 1, "pose_kernel": 1, "trust": 1,
}  # fmt: skip
"""Number of dimensions of each array in the file, by its name."""
_MOST_FPS = 1000.0
"""Maximum frame rate of a valid model."""
_MOST_BINS = 1024
"""Maximum number of bins in one direction; the paper has at most 16, and 128 fine ones."""


@dataclass(frozen=True, eq=False)
class VolumeModel:
    """A person's motion as volumes and poses.

    Attributes
    ----------
    latent : (N, d) float64
        Latent point of each training frame (GPDM).
    lengths : (P,) int64
        Frames of each training performance.
    volumes : (views, N, q) float64
        Descriptor of each training frame in the descriptor space, mean of the wearers; one view for
        hulls, one for each direction that the camera may see the person from for a depth camera.
    spread : (N,) float64
        Mean squared distance of the wearers' descriptors from it, including the part outside the space.
    poses : (views, N, k) float64
        Training poses in the pose space.
    rotations : (N, 21, 3, 3) float64
        The original training poses, the pelvis facing +z; reports measure against them.
    space_mean, space_whiten, space_basis, pose_mean, pose_basis
        `DescriptorSpace` and `PoseSpace`.
    volume_kernel, motion_kernel, recall_kernel, pose_kernel : (3,) or (4,) float64
        Kernels of X to V, of X to the next X, of V to X, and of X to poses.
    trust : (V,) float64
        Trust that each vertex of the reference body lies on the volume's surface, 0 to 1.
    meta : dict
        ``bins`` (heights, azimuths, radii, fine), ``fps``, ``noise_floor``,
        ``input`` (``silhouettes`` or ``depth``), and what the model was trained on.
    """

    latent: Array
    lengths: NDArray[np.int64]
    volumes: Array
    spread: Array
    poses: Array
    rotations: Array
    space_mean: Array
    space_whiten: Array
    space_basis: Array
    pose_mean: Array
    pose_basis: Array
    volume_kernel: Array
    motion_kernel: Array
    recall_kernel: Array
    pose_kernel: Array
    trust: Array
    meta: dict[str, Any]

    @property
    def views(self) -> int:
        """Number of directions from which the person is seen."""
        return len(self.volumes)

    @property
    def fps(self) -> float:
        """Frame rate of the training."""
        return float(self.meta["fps"])

    @cached_property
    def bins(self) -> Bins:
        """Bins of the descriptor."""
        return Bins(*self.meta["bins"])

    @cached_property
    def space(self) -> DescriptorSpace:
        """The space of descriptors."""
        return DescriptorSpace(self.space_mean, self.space_whiten, self.space_basis)

    @cached_property
    def pose_space(self) -> PoseSpace:
        """The space of poses."""
        return PoseSpace(self.pose_mean, self.pose_basis)

    @cached_property
    def to_volume(self) -> tuple[Regression, ...]:
        r"""X to V, one for each view (Hirai et al. eq. 2).

        .. math:: v_t = \sum_j b_j \psi_j(x_t) + n_{v,t} \qquad (2)

        The weights of the basis functions are marginalised, as GPDM does it: a Gaussian process with the
        training points as its basis. V is the descriptor space, not the descriptor.
        """
        kernel = Kernel.from_array(self.volume_kernel)
        # Hirai et al. eq. 2: from X to V
        made = tuple(Regression(self.latent, v, kernel) for v in self.volumes)
        for other in made[1:]:  # they differ in their outputs only
            other.__dict__["inverse"] = made[0].inverse
        return made

    @cached_property
    def to_latent(self) -> tuple[Regression, ...]:
        """V to X, one for each view: by regression, as in Sec. 3; GPDM has no such map."""
        kernel = Kernel.from_array(self.recall_kernel)
        return tuple(Regression(v, self.latent, kernel) for v in self.volumes)

    @cached_property
    def to_pose(self) -> tuple[Regression, ...]:
        """X to the pose space, one for each view."""
        kernel = Kernel.from_array(self.pose_kernel)
        return tuple(Regression(self.latent, p, kernel) for p in self.poses)

    @cached_property
    def to_next(self) -> Regression:
        r"""X to the next X (Hirai et al. eq. 1), the weights marginalised as in `to_volume`.

        .. math:: x_t = \sum_i a_i \phi_i(x_{t-1}) + n_{x,t} \qquad (1)
        """
        before, after, _ = chain_rows([int(n) for n in self.lengths])
        kernel = Kernel.from_array(self.motion_kernel)
        # Hirai et al. eq. 1: from X to the next X
        return Regression(self.latent[before], self.latent[after], kernel, float(self.meta["noise_floor"]))

    def views_of(self, steps: Array | NDArray[np.int64], seen_from: float) -> NDArray[np.int64]:
        """Return views of a person with headings (steps of the fine azimuth) from an azimuth (radians)."""
        turns = seen_from / (2 * np.pi) - steps / self.bins.fine
        return np.asarray(np.rint(turns * self.views).astype(np.int64) % self.views)

    def save(self, path: Path) -> None:
        """Write the file."""
        arrays = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "meta"}
        text = json.dumps({"format": FORMAT, "version": VERSION, **self.meta}, sort_keys=True)
        with new_file(path) as file:
            np.savez_compressed(file, meta=np.frombuffer(text.encode(), np.uint8), **arrays)

    @classmethod
    def load(cls, path: Path) -> VolumeModel:
        """Read a file.

        Raises
        ------
        InputError
            Where it is missing, damaged, of another kind or of another version.
        """
        try:
            arrays = load_arrays(path)
        except DamagedArrays as error:
            raise InputError(f"{path} cannot be read as a volume model: {error}") from error
        try:
            meta = json.loads(bytes(arrays.pop("meta")).decode())
            kind, version = meta.pop("format"), meta.pop("version")
        except (KeyError, ValueError, AttributeError, TypeError, RecursionError) as error:
            raise InputError(f"{path} is not a volume model: its header is missing") from error
        if kind != FORMAT or version != VERSION:
            raise InputError(
                f"{path} holds {kind!r}, version {version}; this program reads {FORMAT!r}, version "
                f"{VERSION}: make it again with 'depth-pose volume train'"
            )
        names = {f.name for f in fields(cls)} - {"meta"}
        if set(arrays) != names:
            odd = ", ".join(sorted(set(arrays) ^ names))
            raise InputError(f"{path}: arrays are missing or unknown: {odd}")
        model = cls(**arrays, meta=meta)
        model.check(str(path))
        return model

    def check(self, where: str) -> None:
        """Raise InputError where arrays do not fit together or are not finite."""
        self._check_kinds(where)
        n = len(self.latent)
        q, size = self.space_basis.shape[1], self.bins.size
        wanted = {
            "volumes": (self.views, n, q), "spread": (n,), "poses": (self.views, n, self.pose_basis.shape[1]),
            "space_mean": (size,), "space_whiten": (size, size), "space_basis": (size, q),
            "rotations": (n, 21, 3, 3), "pose_mean": (192,), "pose_basis": (192, self.pose_basis.shape[1]),
        }  # fmt: skip
        for name, shape in wanted.items():
            if getattr(self, name).shape != shape:
                found = list(getattr(self, name).shape)
                raise InputError(f"{where}: the array {name} is {found}; it must be {list(shape)}")
        for f in fields(self):
            array = getattr(self, f.name)
            if f.name != "meta" and not np.isfinite(array).all():
                raise InputError(f"{where}: the array {f.name} has values that are not numbers")
        if int(self.lengths.sum()) != n:
            raise InputError(f"{where}: the performances have {int(self.lengths.sum())} frames, not {n}")

    def _check_kinds(self, where: str) -> None:
        """Raise InputError where the metadata or an array has another type."""
        try:
            self._check_meta()
        except (KeyError, TypeError, ValueError, ConfigError) as error:
            raise InputError(f"{where}: its metadata is damaged: {error}") from error
        for name, dimensions in DIMENSIONS.items():
            array = getattr(self, name)
            kind = np.int64 if name == "lengths" else np.float64
            if array.dtype != kind or array.ndim != dimensions or array.size == 0:
                raise InputError(
                    f"{where}: the array {name} is {array.dtype}{list(array.shape)}; "
                    f"it must be {kind.__name__}, of {dimensions} dimensions"
                )
        for name in ("volume_kernel", "motion_kernel", "recall_kernel", "pose_kernel"):
            if len(getattr(self, name)) not in (3, 4):
                raise InputError(f"{where}: the array {name} must have 3 or 4 numbers")
        if self.lengths.min() < 1:
            raise InputError(f"{where}: a performance has {int(self.lengths.min())} frames")

    def _check_meta(self) -> None:
        """Raise one of several errors where ``meta`` is invalid."""
        meta = self.meta
        for name, kind in _META.items():
            if not isinstance(meta[name], kind) or isinstance(meta[name], bool):
                raise TypeError(f"{name} is {meta[name]!r:.80}")
        if meta["input"] not in INPUTS or not 0 < self.fps < _MOST_FPS:
            raise ValueError(f"it sees {meta['input']!r:.80} at {self.fps} frames a second")
        if any(type(number) is not int or not 0 < number <= _MOST_BINS for number in meta["bins"]):
            raise ValueError(f"the bins are {meta['bins']!r:.80}")
        if any(type(value) not in (int, float) for value in meta["statures"]):
            raise TypeError("a stature is not a number")
        _ = self.bins  # validates itself
