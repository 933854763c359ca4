"""Bodies by name: the embedded one, optional ones, and the user's own from a file."""

from __future__ import annotations

from pathlib import Path

from depth_pose.body.body import Body
from depth_pose.body.files import load_body
from depth_pose.core.errors import ConfigError
from depth_pose.core.extras import require

BODIES = ("embedded", "anny")
"""Names that `find_body` knows; anything that ends in .npz, .glb or .gltf is a file."""


def find_body(name: str) -> Body:
    """Return a body by its name, or from a file.

    Parameters
    ----------
    name : str
        One of `BODIES`, or the path of a body file (`load_body`) or of a rigged human
        (`depth_pose.body.gltf.load_gltf_body`). For the body of a bank, see
        `depth_pose.bank.bodies.find_body_or_bank`.

    Raises
    ------
    ConfigError
        If there is no such body, or a package that it needs is not installed.
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
        require("pygltflib", f"the body {name!r}")
        from depth_pose.body.gltf import load_gltf_body

        return load_gltf_body(Path(name))
    raise ConfigError(
        f"there is no body {name!r}; there are {', '.join(BODIES)}, or a .npz, .glb or .gltf file"
    )
