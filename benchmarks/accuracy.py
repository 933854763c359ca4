"""The figures of docs/accuracy.md and docs/method.md.

    python benchmarks/accuracy.py table1 DATA -o docs/images     # the paper's Table 1 and Fig. 10
    python benchmarks/accuracy.py ablation --data DATA           # one part left out at a time
    python benchmarks/accuracy.py constants DATA                 # each constant halved and doubled
    python benchmarks/accuracy.py tracks DATA                    # the same for the tracks' on all frames
    python benchmarks/accuracy.py confidence --check DATA        # fits and checks the confidence of joints
    python benchmarks/accuracy.py builds --people 10             # bone lengths found, against the true ones
    python benchmarks/accuracy.py proposals DATA                 # the answer beside the joint net's joints
    python benchmarks/accuracy.py deviations --check DATA        # the deviations that the joint net states
    python benchmarks/accuracy.py spread --check DATA            # published covariances and velocities

DATA is a folder of recordings with truth files beside them. ``accuracy.py PART --help`` says more.
"""

from __future__ import annotations

import one_thread  # noqa: F401
from command_line import run_part

if __name__ == "__main__":
    parts = (
        "table1",
        "ablation",
        "constants",
        "tracks",
        "confidence",
        "builds",
        "proposals",
        "deviations",
        "spread",
    )
    run_part(__doc__, {name: name for name in parts})
