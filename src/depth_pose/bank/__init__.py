"""The exemplar bank: poses, their partial views in canonical axes, and the PCA subspace (Sec. 5)."""

from depth_pose.bank.bank import Bank, default_bank_path
from depth_pose.bank.build import build_bank

__all__ = ["Bank", "build_bank", "default_bank_path"]
