"""The exemplar bank, and where the default one lies; `depth_pose.bank.bank_file` has the file's format."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from depth_pose.bank.bank_file import read_bank_file, round_arrays, write_bank_file
from depth_pose.body.body import Body
from depth_pose.body.pose import BodyPose
from depth_pose.core.errors import BankError
from depth_pose.core.pose_match import Candidate
from depth_pose.core.rotations import quat_to_matrix
from depth_pose.core.skeleton import forward_kinematics

_PACKAGED = Path(__file__).parent / "data" / "default_bank.npz"
"""The default bank. It was made by `depth-pose bank build -o src/depth_pose/bank/data/default_bank.npz`."""


@dataclass(frozen=True, eq=False)
class Bank:
    """Poses of one body, their partial views, and the subspace in which inputs are matched.

    Attributes
    ----------
    body : Body
    pose_quats : (N, 21, 4) float32
        Segment rotations of each pose, model frame, x y z w.
    view_quats : (N, W, 4) float32
        ``R_canonical_model`` of each view.
    view_origins : (N, W, 3) float32
        Centroid of each view's partial cloud, model frame with the pelvis at the origin, metres.
    coefficients : (N, W, D) float32
        Each view's descriptor in the subspace.
    mean, components : (P,), (D, P) float32
        The PCA subspace of descriptors.
    source : dict
        What the bank was built from.
    """

    body: Body
    pose_quats: NDArray[np.float32]
    view_quats: NDArray[np.float32]
    view_origins: NDArray[np.float32]
    coefficients: NDArray[np.float32]
    mean: NDArray[np.float32]
    components: NDArray[np.float32]
    source: dict[str, Any] = field(default_factory=dict)

    def _arrays(self) -> dict[str, NDArray[Any]]:
        return {
            "body_vertices": self.body.vertices,
            "body_faces": self.body.faces,
            "body_weights": self.body.weights,
            "body_nodes": self.body.nodes,
            "pose_quats": self.pose_quats,
            "view_quats": self.view_quats,
            "view_origins": self.view_origins,
            "coefficients": self.coefficients,
            "mean": self.mean,
            "components": self.components,
        }

    @cached_property
    def bank_id(self) -> str:
        """Hash of the content and of the header, 16 hexadecimal digits."""
        digest = self._digest()
        digest.update(json.dumps([self._about()], sort_keys=True).encode())
        return digest.hexdigest()[:16]

    def _digest(self) -> hashlib._Hash:
        """Hash the arrays."""
        digest = hashlib.sha256()
        for name, array in self._arrays().items():
            digest.update(f"{name}{array.dtype.str}{array.shape}".encode())
            digest.update(np.ascontiguousarray(array).data)
        return digest

    def _about(self) -> dict[str, Any]:
        """Return the content of the header."""
        return {"body": {"name": self.body.name, "stature": float(self.body.stature)}, "source": self.source}

    @property
    def poses(self) -> int:
        """Number of poses."""
        return len(self.pose_quats)

    @property
    def views(self) -> int:
        """Number of views of each pose."""
        return self.coefficients.shape[1]

    @property
    def view_scheme(self) -> str:
        """Scheme of its views, one of `BANK_SCHEMES`: inputs use the same axes."""
        return str(self.source.get("views", "partial"))

    @cached_property
    def pose_nodes(self) -> NDArray[np.float64]:
        """Nodes of each pose about its pelvis, model frame, metres, shape (N, 21, 3)."""
        rotations = quat_to_matrix(self.pose_quats.astype(np.float64))
        return forward_kinematics(rotations, np.zeros((self.poses, 3)), self.body.nodes)

    def rotations(self, exemplar: int) -> NDArray[np.float64]:
        """Segment rotations of one pose in the model frame, shape (21, 3, 3)."""
        return quat_to_matrix(self.pose_quats[exemplar].astype(np.float64))

    def pose(self, candidate: Candidate, scale: float) -> BodyPose:
        """Return the pose of a matched exemplar in the camera frame."""
        return self.poses_of([candidate], scale)[0]

    def poses_of(self, candidates: Sequence[Candidate], scale: float) -> list[BodyPose]:
        """Return the poses of matched exemplars, as `pose` does of one."""
        rotations = quat_to_matrix(self.pose_quats[[c.exemplar for c in candidates]].astype(np.float64))
        return [
            BodyPose(c.rotation @ own, c.translation, scale)
            for c, own in zip(candidates, rotations, strict=True)
        ]

    def rounded(self) -> Bank:
        """Return the bank as it is read back from its file."""
        return replace(self, **_without_body(round_arrays(self._arrays())))

    def without_views(self) -> Bank:
        """Return the bank, under its id, without the views: 35 MB that the search alone needs."""
        none: dict[str, Any] = {name: getattr(self, name)[:0].copy() for name in _OF_VIEWS}
        bare = replace(self, **none)
        vars(bare)["bank_id"] = self.bank_id
        return bare

    def save(self, path: str | Path) -> None:
        """Write the bank, `rounded`; the file appears whole or not at all."""
        write_bank_file(path, {"bank_id": self.rounded().bank_id, **self._about()}, self._arrays())

    @classmethod
    def load(cls, path: str | Path) -> Bank:
        """Read a bank.

        Raises
        ------
        BankError
            Where the file is missing, damaged, foreign, or of another version.
        """
        header, arrays = read_bank_file(Path(path))
        body = _read_body(path, header["body"], arrays)
        bank = cls(body=body, source=header["source"], **_without_body(arrays))
        # earlier versions left the header out of it
        if header["bank_id"] not in (bank.bank_id, bank._digest().hexdigest()[:16]):
            raise BankError(f"{path}: the content does not match its hash; build the bank again")
        return bank


_OF_VIEWS = ("view_quats", "view_origins", "coefficients", "mean", "components")
"""Arrays that only the search for exemplars needs."""


def _without_body(arrays: dict[str, NDArray[Any]]) -> dict[str, Any]:
    return {name: array for name, array in arrays.items() if not name.startswith("body_")}


def _read_body(path: str | Path, header: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> Body:
    faces, count = arrays["body_faces"], len(arrays["body_vertices"])
    if faces.size and not 0 <= faces.min() <= faces.max() < count:
        raise BankError(f"{path}: body_faces speaks of vertices that are not there; build the bank again")
    try:
        return Body(
            name=header["name"],
            vertices=arrays["body_vertices"],
            faces=faces,
            weights=arrays["body_weights"],
            nodes=arrays["body_nodes"],
            stature=header["stature"],
        )
    except ValueError as error:
        raise BankError(f"{path}: its body is invalid ({error}); build the bank again") from error


def default_bank_path() -> Path:
    """Return the file of the default bank: ``$DEPTH_POSE_BANK``, else the one that comes with the package."""
    return Path(os.environ.get("DEPTH_POSE_BANK") or _PACKAGED)
