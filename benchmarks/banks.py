"""The figures of docs/method.md.

    python benchmarks/banks.py match DATA embedded=a.npz recorded=b.npz   # error and flips of the best match
    python benchmarks/banks.py size DATA embedded=a.npz recorded=b.npz    # by the number of poses (Fig. 14)
    python benchmarks/banks.py views BANK                                 # by the view (Fig. 11)
    python benchmarks/banks.py score embedded=a.npz recorded=b.npz        # fits the confidence of a match
    python benchmarks/banks.py coverage FOLDER_OF_BVH docs/images         # recorded motion covered by poses

``banks.py PART --help`` says more.
"""

from __future__ import annotations

import one_thread  # noqa: F401
from command_line import run_part

PARTS = {
    "match": "bank_match",
    "size": "bank_size",
    "views": "bank_views",
    "score": "bank_score",
    "coverage": "motion_coverage",
}

if __name__ == "__main__":
    run_part(__doc__, PARTS)
