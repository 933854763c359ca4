"""Bodies by name: the embedded one, optional ones, and the user's own from a file."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np

from depth_pose.body.body import Body, keep_largest
from depth_pose.core.errors import ConfigError, InputError
from depth_pose.core.skeleton import ADULT_STATURE_M, NODES

BODIES = ("embedded", "anny")
"""Names that `find_body` knows; anything that ends in .npz, .glb or .gltf is a file."""

_FIELDS = ("vertices", "faces", "weights", "nodes")


def find_body(name: str) -> Body:
    """Give a body by its name, or from a file.

    Parameters
    ----------
    name : str
        One of `BODIES`, or the path of a body file (`load_body`), of a bank, whose body is taken, or of a
        rigged human (`depth_pose.body.gltf.load_gltf_body`).

    Raises
    ------
    ConfigError
        Where there is no such body, or what it needs is not installed.
    InputError
        Where the file cannot be used.
    """
    if name in ("embedded", "procedural"):
        from depth_pose.body.procedural import make_body

        return make_body()
    if name == "anny":
        from depth_pose.body.anny_body import make_anny_body

        return make_anny_body()
    if name.lower().endswith(".npz"):
        return load_body(Path(name))
    if name.lower().endswith((".glb", ".gltf")):
        from depth_pose.body.gltf import load_gltf_body

        return load_gltf_body(Path(name))
    raise ConfigError(
        f"there is no body {name!r}; there are {', '.join(BODIES)}, or a .npz, .glb or .gltf file"
    )


def save_body(body: Body, path: Path) -> None:
    """Write a body file: arrays ``vertices``, ``faces``, ``weights``, ``nodes``, ``stature``."""
    arrays = {name: getattr(body, name) for name in _FIELDS}
    np.savez_compressed(path, stature=np.float64(body.stature), **arrays)


def load_body(path: Path) -> Body:
    """Read a body from a ``.npz`` file, or take that of a bank.

    The arrays are those of `Body`, in the model frame and the rest pose of `depth_pose.core.skeleton`:
    ``vertices`` (V, 3) metres, ``faces`` (F, 3), ``weights`` (V, 21), ``nodes`` (21, 3), and
    optionally ``stature``. Of each vertex's weights the largest four are kept. The body is scaled
    to the stature of the reference adult, which is a scale of 1.

    Raises
    ------
    InputError
        Where the file is missing or its arrays do not fit together.
    BankError
        Where it is a damaged bank.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(f"{path} cannot be read as a body: {error}") from error
    if "body_vertices" in arrays:
        from depth_pose.bank.bank import Bank

        return Bank.load(path).body
    missing = [name for name in _FIELDS if name not in arrays]
    if missing:
        raise InputError(f"{path} is no body: the array {missing[0]} is missing")
    vertices, faces, weights, nodes = (arrays[name] for name in _FIELDS)
    shapes = {
        "vertices": (vertices, (len(vertices), 3)),
        "faces": (faces, (len(faces), 3)),
        "weights": (weights, (len(vertices), len(NODES))),
        "nodes": (nodes, (len(NODES), 3)),
    }
    for name, (array, shape) in shapes.items():
        if array.shape != shape or not np.isfinite(array).all():
            raise InputError(
                f"{path}: the array {name} is {list(array.shape)}; it must be {list(shape)} and finite"
            )
    if len(faces) == 0 or faces.min() < 0 or faces.max() >= len(vertices):
        raise InputError(f"{path}: the array faces names vertices that there are not")
    if weights.min() < 0 or weights.sum(axis=1).min() <= 0:
        raise InputError(f"{path}: the array weights must not be negative, and no row may be all zero")
    stature = float(arrays["stature"]) if "stature" in arrays else float(np.ptp(vertices[:, 1]))
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
