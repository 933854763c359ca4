"""The exemplar bank and its file.

A bank file is a NumPy ``.npz`` of plain arrays (never pickled objects) with a JSON header: format
version, content hash, and what the bank was built from. Loading checks all of it and refuses a
damaged or foreign file with the reason.
"""

from __future__ import annotations

import hashlib
import json
import os
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.body import Body
from depth_pose.body.pose import BodyPose
from depth_pose.core.arrays import DamagedArrays, load_arrays
from depth_pose.core.errors import BankError
from depth_pose.core.outputs import new_file
from depth_pose.core.reading import parse_json
from depth_pose.core.rotations import quat_to_matrix
from depth_pose.core.skeleton import forward_kinematics
from depth_pose.core.types import Candidate

FORMAT = "depth_pose exemplar bank"
FORMAT_VERSION = 1
"""Version of the file; banks of any other are refused."""

BANK_SCHEMES = ("partial", "paper")
"""Those of `depth_pose.bank.views.SCHEMES` that banks are made with."""

_LEAST_STATURE_M, _MOST_STATURE_M = 0.3, 3.0
"""Bodies of a bank are between these heights; as `depth_pose.body.files` has it."""

_SHAPES: dict[str, tuple[str, tuple[int | str, ...]]] = {
    "body_vertices": ("float64", ("V", 3)),
    "body_faces": ("int32", ("F", 3)),
    "body_weights": ("float64", ("V", 21)),
    "body_nodes": ("float64", (21, 3)),
    "pose_quats": ("float32", ("N", 21, 4)),
    "view_quats": ("float32", ("N", "W", 4)),
    "view_origins": ("float32", ("N", "W", 3)),
    "coefficients": ("float32", ("N", "W", "D")),
    "mean": ("float32", ("P",)),
    "components": ("float32", ("D", "P")),
}
"""Arrays of the file, their types and shapes; a letter is a length that others share."""


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
        """Hash of the content and of what the header says of it, 16 hexadecimal digits."""
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
        """Return what the header says."""
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
        """How its views were made, one of `BANK_SCHEMES`: inputs take the same axes."""
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
        rotations = candidate.rotation @ self.rotations(candidate.exemplar)
        return BodyPose(rotations, candidate.translation, scale)

    def save(self, path: str | Path) -> None:
        """Write the bank; the file appears whole or not at all."""
        header = {
            "format": FORMAT,
            "version": FORMAT_VERSION,
            "bank_id": self.bank_id,
            **self._about(),
        }
        text = np.frombuffer(json.dumps(header).encode(), np.uint8)
        with new_file(path) as stream:
            np.savez(stream, header=text, **self._arrays())  # type: ignore[arg-type]

    @classmethod
    def load(cls, path: str | Path) -> Bank:
        """Read a bank.

        Raises
        ------
        BankError
            Where the file is missing, damaged, foreign, or of another version.
        """
        header, arrays = _read(Path(path))
        body = _read_body(path, header["body"], arrays)
        views = {k: v for k, v in arrays.items() if not k.startswith("body_")}
        bank = cls(body=body, source=header["source"], **views)
        # earlier versions left the header out of it
        if header["bank_id"] not in (bank.bank_id, bank._digest().hexdigest()[:16]):
            raise BankError(f"{path}: the content does not match its hash; build the bank again")
        return bank


def _read(path: Path) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Read and check a bank file's header and arrays."""
    if not path.is_file():
        raise BankError(f"{path}: no such bank; make it with `depth-pose bank build -o {path}`")
    try:
        arrays = load_arrays(path)
    except DamagedArrays as error:
        raise BankError(f"{path}: not a readable bank file ({error}); build the bank again") from error
    header = _read_header(path, arrays.pop("header", None))
    found, version = header.get("format"), header.get("version")
    if found != FORMAT:
        raise BankError(f"{path}: this is not a bank of depth_pose but {found!r}")
    if version != FORMAT_VERSION:
        raise BankError(
            f"{path}: bank format {version}; this version reads {FORMAT_VERSION}: build the bank again"
        )
    _check_header(path, header)
    _check_arrays(path, arrays)
    return header, {name: arrays[name] for name in _SHAPES}


def _read_header(path: Path, stored: NDArray[Any] | None) -> dict[str, Any]:
    if stored is None or stored.dtype != np.uint8 or stored.ndim != 1:
        raise BankError(f"{path}: this is not a bank of depth_pose: its header is missing")
    header = parse_json(f"{path}: the header", stored.tobytes().decode(errors="replace"), BankError)
    if not isinstance(header, dict):
        raise BankError(f"{path}: this is not a bank of depth_pose: its header is {type(header).__name__}")
    return header


def _check_header(path: Path, header: dict[str, Any]) -> None:
    """Check the types of the header's fields."""
    body, source, bank_id = header.get("body"), header.get("source"), header.get("bank_id")
    if not (isinstance(body, dict) and isinstance(source, dict) and isinstance(bank_id, str)):
        raise BankError(f"{path}: its header is damaged (id {bank_id!r:.80}); build the bank again")
    name, stature = body.get("name"), body.get("stature")
    is_tall = isinstance(stature, float) and _LEAST_STATURE_M < stature < _MOST_STATURE_M
    if not (isinstance(name, str) and is_tall):
        raise BankError(f"{path}: its header is damaged (body {body!r:.80}); build the bank again")
    scheme = source.get("views", "partial")
    if scheme not in BANK_SCHEMES:
        raise BankError(f"{path}: its views are {scheme!r:.80}, not one of {', '.join(BANK_SCHEMES)}")


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


def _check_arrays(path: Path, arrays: dict[str, NDArray[Any]]) -> None:
    sizes: dict[str, int] = {}
    for name, (dtype, shape) in _SHAPES.items():
        if name not in arrays:
            raise BankError(f"{path}: the array {name} is missing; build the bank again")
        array = arrays[name]
        fits = array.dtype == dtype and array.ndim == len(shape)
        for want, have in zip(shape, array.shape, strict=False):
            fits = fits and have == (sizes.setdefault(want, have) if isinstance(want, str) else want)
        if not fits:
            raise BankError(
                f"{path}: the array {name} is {array.dtype}{list(array.shape)}, "
                f"not {dtype}{list(shape)}; build the bank again"
            )
        if array.dtype.kind == "f" and not np.isfinite(array).all():
            raise BankError(f"{path}: the array {name} has values that are not finite; build the bank again")


def default_bank_path() -> Path:
    """Where the set-up keeps the embedded bank: ``$DEPTH_POSE_BANK``, else the user's cache."""
    if "DEPTH_POSE_BANK" in os.environ:
        return Path(os.environ["DEPTH_POSE_BANK"])
    cache = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache"))
    return cache / "depth_pose" / f"default_bank_v{FORMAT_VERSION}.npz"
