"""Body files: the arrays of a body in the rest pose, as NumPy's ``.npz``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.body import Body, keep_largest
from depth_pose.core.arrays import DamagedArrays, load_arrays
from depth_pose.core.errors import InputError
from depth_pose.core.outputs import new_file
from depth_pose.core.skeleton import ADULT_STATURE_M, NODES

_FIELDS = ("vertices", "faces", "weights", "nodes")


def save_body(body: Body, path: Path, **notes: str) -> None:
    """Write a body file: arrays ``vertices``, ``faces``, ``weights``, ``nodes``, ``stature``.

    Parameters
    ----------
    body : Body
    path : Path
    **notes : str
        Stored beside the arrays under their names; `load_body` does not read them.
    """
    arrays: dict[str, Any] = {name: getattr(body, name) for name in _FIELDS}
    arrays.update(stature=np.float64(body.stature), **notes)
    with new_file(path) as stream:
        np.savez_compressed(stream, **arrays)


def _stature(path: Path, arrays: dict[str, NDArray[Any]]) -> float:
    if "stature" not in arrays:
        return float(np.ptp(arrays["vertices"][:, 1]))
    told = arrays["stature"]
    if told.dtype.kind not in "iuf" or told.size != 1:
        raise InputError(
            f"{path}: the array stature is {told.dtype}{list(told.shape)}; it must be one number"
        )
    return float(told.ravel()[0])


def load_body(path: Path) -> Body:
    """Read a body file.

    The arrays are those of `Body`, in the model frame and the rest pose of `depth_pose.core.skeleton`:
    ``vertices`` (V, 3) metres, ``faces`` (F, 3), ``weights`` (V, 21), ``nodes`` (21, 3), and
    optionally ``stature``. The four largest weights of each vertex are kept. The body is scaled
    to the stature of the reference adult, which is a scale of 1.

    Raises
    ------
    InputError
        Where the file is missing or its arrays do not fit together.
    """
    try:
        arrays = load_arrays(path)
    except DamagedArrays as error:
        raise InputError(f"{path} cannot be read as a body: {error}") from error
    missing = [name for name in _FIELDS if name not in arrays]
    if missing:
        raise InputError(f"{path} is not a body file: the array {missing[0]} is missing")
    vertices, faces, weights, nodes = (arrays[name] for name in _FIELDS)
    shapes = {
        "vertices": (vertices, (vertices.shape[:1] + (3,))),
        "faces": (faces, (faces.shape[:1] + (3,))),
        "weights": (weights, (*vertices.shape[:1], len(NODES))),
        "nodes": (nodes, (len(NODES), 3)),
    }
    for name, (array, shape) in shapes.items():
        kinds = "iu" if name == "faces" else "iuf"
        if array.dtype.kind not in kinds or array.shape != shape or not np.isfinite(array).all():
            raise InputError(
                f"{path}: the array {name} is {array.dtype}{list(array.shape)}; it must be {list(shape)}, "
                + ("whole numbers" if name == "faces" else "numbers and finite")
            )
    if len(faces) == 0 or faces.min() < 0 or faces.max() >= len(vertices):
        raise InputError(f"{path}: the array faces has indices of vertices that do not exist")
    if weights.min() < 0 or weights.sum(axis=1).min() <= 0:
        raise InputError(f"{path}: the array weights must not be negative, and no row may be all zero")
    stature = _stature(path, arrays)
    if not 0.3 < stature < 3.0:
        raise InputError(f"{path}: the body is {stature:.2f} m tall; its unit must be metres, y up")
    scale = ADULT_STATURE_M / stature
    return Body(
        name=path.stem,
        vertices=np.ascontiguousarray(vertices, np.float64) * scale,
        faces=np.ascontiguousarray(faces, np.int32),
        weights=keep_largest(np.asarray(weights, np.float64)),
        nodes=np.ascontiguousarray(nodes, np.float64) * scale,
        stature=ADULT_STATURE_M,
    )
