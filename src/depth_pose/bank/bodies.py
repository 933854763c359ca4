"""Bodies by name, banks among them."""

from __future__ import annotations

from pathlib import Path

from depth_pose.bank.bank import Bank
from depth_pose.body.bodies import find_body
from depth_pose.body.body import Body
from depth_pose.core.arrays import array_names


def find_body_or_bank(name: str) -> Body:
    """Return a body by its name or from a file (`depth_pose.body.bodies.find_body`), or a bank's body.

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
    is_bank = path.suffix.lower() == ".npz" and "body_vertices" in array_names(path)
    return Bank.load(path).body if is_bank else find_body(name)
