"""Bodies by name, banks among them."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np

from depth_pose.bank.bank import Bank
from depth_pose.body.bodies import find_body
from depth_pose.body.body import Body


def find_body_or_bank(name: str) -> Body:
    """Give a body by its name or from a file (`depth_pose.body.bodies.find_body`), or a bank's body.

    Raises
    ------
    ConfigError
        Where there is no such body, or what it needs is not installed.
    InputError
        Where the file cannot be used.
    BankError
        Where it is a damaged bank.
    """
    path = Path(name)
    return Bank.load(path).body if path.suffix.lower() == ".npz" and _is_bank(path) else find_body(name)


def _is_bank(path: Path) -> bool:
    """Whether a file has the arrays of a bank's body; false where it cannot be read."""
    try:
        with np.load(path, allow_pickle=False) as file:
            return "body_vertices" in file.files
    except (OSError, ValueError, EOFError, zipfile.BadZipFile):
        return False
