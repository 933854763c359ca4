"""The exemplar bank: poses, their partial views in canonical axes, and the PCA subspace (Sec. 5)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from depth_pose.bank.bank import Bank, default_bank_path

if TYPE_CHECKING:
    from depth_pose.bank.build import build_bank

__all__ = ["Bank", "build_bank", "default_bank_path"]


def __getattr__(name: str) -> Any:
    """Import the builder, and SciPy with it, on first use."""
    if name == "build_bank":
        from depth_pose.bank.build import build_bank

        return build_bank
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
