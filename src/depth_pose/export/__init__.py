"""Skeletons for other tools: BVH for animation, TRC for OpenSim, CSV for spreadsheets, NPZ for NumPy."""

from depth_pose.export.export import FORMATS, Exported, export_skeletons

__all__ = ["FORMATS", "Exported", "export_skeletons"]
