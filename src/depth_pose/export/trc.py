"""Writer of track row column files (.trc), as OpenSim reads markers.

The format: *Marker (.trc) Files*, OpenSim documentation (simtk-confluence.stanford.edu). Columns are
separated by tabs. Unknown values are ``NaN``: OpenSim refuses a line that ends in empty cells.
"""

from __future__ import annotations

import numpy as np

from depth_pose.core.skeleton import JOINTS
from depth_pose.export.tracks import Track


def trc_text(track: Track, step_s: float, name: str, unit: str, factor: float) -> str:
    """Build a TRC file's text for a motion at an even rate; gaps are NaN.

    Parameters
    ----------
    track : Track
    step_s : float
        Time between frames, seconds.
    name : str
        The file's name, which its first line repeats.
    unit : str
        ``m``, ``cm`` or ``mm``.
    factor : float
        Units in a metre.
    """
    rate = f"{1 / step_s:.6g}"
    count = len(track)
    axes = [f"{axis}{i + 1}" for i in range(len(JOINTS)) for axis in "XYZ"]
    lines = [
        f"PathFileType\t4\t(X/Y/Z)\t{name}",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        f"{rate}\t{rate}\t{count}\t{len(JOINTS)}\t{unit}\t{rate}\t1\t{count}",
        "Frame#\tTime\t" + "\t\t\t".join(JOINTS) + "\t\t",
        "\t\t" + "\t".join(axes),
        "",
    ]
    for i, row in enumerate(track.positions.reshape(count, -1) * factor):
        values = ("NaN" if np.isnan(v) else f"{v:.6f}" for v in row)
        lines.append(f"{i + 1}\t{i * step_s:.6f}\t" + "\t".join(values))
    return "\n".join(lines) + "\n"
