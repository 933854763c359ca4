"""The figures of docs/volume.md.

    python benchmarks/volume.py dances accuracy --out docs/images   # tables and plots, about ten minutes
    python benchmarks/volume.py dances depth --out docs/images      # 1, 2 and 4 depth cameras, ten minutes
    python benchmarks/volume.py dances cost                         # time by voxel, particles, cameras
    python benchmarks/volume.py dances constants --dance swing      # numbers halved and doubled
    python benchmarks/volume.py live                                # the node, with models of the first

``volume.py PART --help`` says more.
"""

from __future__ import annotations

import one_thread  # noqa: F401
from command_line import run_part

if __name__ == "__main__":
    run_part(__doc__, {"dances": "dances", "live": "volume_live"})
