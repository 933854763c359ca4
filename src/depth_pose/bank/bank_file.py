"""The file of an exemplar bank: its arrays as small integers, and the checks of a file that is read.

A bank file is a compressed NumPy ``.npz`` of plain arrays (never pickled objects) with a JSON header: format
version, content hash, and what the bank was built from. A damaged or foreign file is refused with the reason.

Version 2 stores

- ``pose_quats`` and ``view_quats`` as 16-bit integers, 1 as 32767: at most 0.005 degrees off. They get their
  unit length back when they are read;
- ``view_origins`` as 16-bit integers in steps of 0.1 mm: at most 0.05 mm off;
- ``coefficients`` as 8-bit integers, in a step for each component: ``coefficient_steps`` (D,), 1/127 of its
  largest magnitude. The error is at most half a step: 1 to 2 % of the component's standard deviation;
- the body, ``mean`` and ``components`` as they are.

10,000 poses then take 10.6 MB in place of 39. A step has at most 16 significant bits: its product with an 8-
bit integer is exact in float32, so a bank that is read and written again stays the same, bit by bit. Files of
version 1, which had float32 throughout, are still read.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.arrays import DamagedArrays, load_arrays
from depth_pose.core.errors import BankError
from depth_pose.core.outputs import new_file
from depth_pose.core.reading import parse_json

Arrays = dict[str, NDArray[Any]]

FORMAT = "depth_pose exemplar bank"
FORMAT_VERSION = 2
"""Version of the file that is written."""

BANK_SCHEMES = ("partial", "paper")
"""Schemes of `depth_pose.bank.views.SCHEMES` that a bank may have."""

_LEAST_STATURE_M, _MOST_STATURE_M = 0.3, 3.0
"""Minimum and maximum height of a bank's body (m), as in `depth_pose.body.files`."""

_MOST_INT16 = 32767
"""Largest 16-bit integer; stands for 1 in a quaternion."""

_ORIGIN_STEP_M = np.float32(1e-4)
"""Step of the views' origins."""

_MOST_COEFFICIENT = 127
"""Largest 8-bit integer: that of a component's largest magnitude."""

_STEP_BITS = 16
"""Significant bits of a coefficient's step; float32 has 24, an 8-bit integer the other 8."""

Shapes = dict[str, tuple[str, tuple[int | str, ...]]]
"""Arrays of a file, their types and shapes; a letter stands for a length that several arrays share."""

_COMMON: Shapes = {
    "body_vertices": ("float64", ("V", 3)),
    "body_faces": ("int32", ("F", 3)),
    "body_weights": ("float64", ("V", 21)),
    "body_nodes": ("float64", (21, 3)),
    "mean": ("float32", ("P",)),
    "components": ("float32", ("D", "P")),
}
_SHAPES: dict[int, Shapes] = {
    1: {
        **_COMMON,
        "pose_quats": ("float32", ("N", 21, 4)),
        "view_quats": ("float32", ("N", "W", 4)),
        "view_origins": ("float32", ("N", "W", 3)),
        "coefficients": ("float32", ("N", "W", "D")),
    },
    2: {
        **_COMMON,
        "pose_quats": ("int16", ("N", 21, 4)),
        "view_quats": ("int16", ("N", "W", 4)),
        "view_origins": ("int16", ("N", "W", 3)),
        "coefficients": ("int8", ("N", "W", "D")),
        "coefficient_steps": ("float32", ("D",)),
    },
}
"""The arrays by the file's version."""


def write_bank_file(path: str | Path, header: dict[str, Any], arrays: Arrays) -> None:
    """Write a bank's header and arrays; the file appears whole or not at all."""
    text = json.dumps({"format": FORMAT, "version": FORMAT_VERSION, **header})
    stored = _to_integers(arrays)
    with new_file(path) as stream:
        np.savez_compressed(stream, header=np.frombuffer(text.encode(), np.uint8), **stored)  # type: ignore[arg-type]


def read_bank_file(path: Path) -> tuple[dict[str, Any], Arrays]:
    """Read and check a bank file; return its header and its arrays, all but the body's as float32.

    Raises
    ------
    BankError
        Where the file is missing, damaged, foreign, or of a version that is not known.
    """
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
    if not isinstance(version, int) or version not in _SHAPES:
        raise BankError(
            f"{path}: bank format {version!r:.80}; this version reads {' and '.join(map(str, _SHAPES))}: "
            "build the bank again"
        )
    _check_header(path, header)
    _check_arrays(path, arrays, _SHAPES[version])
    kept = {name: arrays[name] for name in _SHAPES[version]}
    return header, kept if version == 1 else _to_floats(kept)


def round_arrays(arrays: Arrays) -> Arrays:
    """Return a bank's arrays as they are read back from a file; rounding again changes nothing."""
    return _to_floats(_to_integers(arrays))


def round_quats(quats: NDArray[np.floating[Any]]) -> NDArray[np.float32]:
    """Return quaternions, shape (..., 4), as they are read back from a file."""
    return _unit_quats(_quats_to_integers(quats))


def _quats_to_integers(quats: NDArray[np.floating[Any]]) -> NDArray[np.int16]:
    """Round quaternions to integers whose direction rounds to themselves."""
    numbers = _nearest(quats)
    while not np.array_equal(again := _nearest(_unit_quats(numbers)), numbers):
        numbers = again  # an entry moves only where that brings the length nearer to 1
    return numbers


def _nearest(quats: NDArray[np.floating[Any]]) -> NDArray[np.int16]:
    return np.round(_MOST_INT16 * quats.astype(np.float64)).astype(np.int16)


def _unit_quats(numbers: NDArray[Any]) -> NDArray[np.float32]:
    """Return the quaternions of integers; in single steps, which all processors round alike."""
    x, y, z, w = np.moveaxis(numbers.astype(np.float64), -1, 0)
    length = np.sqrt(x * x + y * y + z * z + w * w)
    return (numbers / length[..., None]).astype(np.float32)


def _to_integers(arrays: Arrays) -> Arrays:
    stored = dict(arrays)
    for name in ("pose_quats", "view_quats"):
        stored[name] = _quats_to_integers(arrays[name])
    origins = np.round(arrays["view_origins"] / _ORIGIN_STEP_M)
    if np.abs(origins).max(initial=0) > _MOST_INT16:
        raise BankError(
            f"view_origins reach {np.abs(arrays['view_origins']).max():.2f} m, more than a bank holds"
        )
    stored["view_origins"] = origins.astype(np.int16)
    coefficients = arrays["coefficients"]
    largest = np.abs(coefficients).max(axis=(0, 1), initial=1e-6)
    # to 16 significant bits, upward, so that the largest does not pass 127
    mantissa, exponent = np.frexp(largest.astype(np.float64) / _MOST_COEFFICIENT)
    steps = np.ldexp(np.ceil(np.ldexp(mantissa, _STEP_BITS)), exponent - _STEP_BITS).astype(np.float32)
    stored["coefficients"] = np.round(coefficients / steps).astype(np.int8)
    stored["coefficient_steps"] = steps
    return stored


def _to_floats(stored: Arrays) -> Arrays:
    arrays = dict(stored)
    steps = arrays.pop("coefficient_steps")
    arrays["coefficients"] = stored["coefficients"].astype(np.float32) * steps
    arrays["view_origins"] = stored["view_origins"].astype(np.float32) * _ORIGIN_STEP_M
    for name in ("pose_quats", "view_quats"):
        arrays[name] = _unit_quats(stored[name])
    return arrays


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


def _check_arrays(path: Path, arrays: Arrays, shapes: Shapes) -> None:
    sizes: dict[str, int] = {}
    for name, (dtype, shape) in shapes.items():
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
