"""What a recording of skeletons says about gait and function, with uncertainties; reports for people."""

from depth_pose.analysis.report import Report, analyse_recording
from depth_pose.analysis.write import write_report

__all__ = ["Report", "analyse_recording", "write_report"]
