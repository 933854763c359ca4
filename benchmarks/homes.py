"""Evaluate the whole pipeline in unseen homes.

    python benchmarks/homes.py views --homes 500 --results build/views.jsonl   # who is found, by what is seen
    python benchmarks/homes.py cameras build/homes          # paired: a standing camera, and one that moves

``homes.py PART --help`` says more.
"""

from __future__ import annotations

import one_thread  # noqa: F401
from command_line import run_part

if __name__ == "__main__":
    run_part(__doc__, {"views": "home_views", "cameras": "home_cameras"})
