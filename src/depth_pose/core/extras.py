"""Packages that only optional parts need: each is installed by an extra of this package."""

from __future__ import annotations

from importlib.util import find_spec

from depth_pose.core.errors import ConfigError

EXTRAS = {
    "anny": "anny",
    "c3d": "c3d",
    "distributed": "dask",
    "matplotlib": "pictures",
    "open3d": "sim",
    "pandas": "pandas",
    "pygltflib": "gltf",
    "pythonosc": "live",
    "viser": "view",
    "websockets": "live",
}
"""Modules and the extras of ``pyproject.toml`` that install them."""


def require(module: str, what: str) -> None:
    """Check that an optional package is installed, before any work that needs it.

    Parameters
    ----------
    module : str
        One of `EXTRAS`.
    what : str
        Feature that needs it, for instance ``a picture``.

    Raises
    ------
    ConfigError
        Where it is not installed; names the extra.
    """
    if find_spec(module) is None:
        extra = EXTRAS[module]
        raise ConfigError(f"{what} needs {module}, which is not installed: pip install 'depth_pose[{extra}]'")
