"""Skeletons for other tools: BVH, TRC, C3D, OpenSim, CSV, JSON, NPZ."""

from depth_pose.export.export import FORMATS, Exported, export_skeletons

__all__ = ["FORMATS", "Exported", "export_skeletons"]
