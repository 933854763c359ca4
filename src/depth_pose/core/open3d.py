"""Import Open3D, which casts rays, only where a bank is built or a sensor is simulated.

The extra ``sim`` installs it.
"""

from __future__ import annotations

import ctypes
import importlib
from contextlib import suppress
from typing import Any

from depth_pose.core.errors import ConfigError
from depth_pose.core.extras import require


def load_open3d() -> Any:
    """Return the module ``open3d``.

    From 0.20 on it links to libusb; the copy in ``libusb-package`` serves where the system has none.

    Raises
    ------
    ConfigError
        Where it is not installed or cannot be loaded; the message says what to install.
    """
    require("open3d", "casting rays")
    with suppress(ImportError, OSError, TypeError):  # TypeError: a package without a library for this machine
        libusb = importlib.import_module("libusb_package").get_library_path()
        ctypes.CDLL(str(libusb), mode=ctypes.RTLD_GLOBAL)
    try:
        return importlib.import_module("open3d")
    except (ImportError, OSError) as error:
        raise ConfigError(
            f"Open3D, which banks and simulated sensors need, cannot be loaded: {error}. Its system "
            "libraries on Debian and Ubuntu: apt install libx11-6 libgl1 libegl1 libgomp1 libudev1; on arm64 "
            "also libgfortran5 libidn2-0"
        ) from error
