"""A process that has everything loaded, and waits to become a node.

Most of a node's start is imports and compiled kernels that are read from the cache. The supervisor
keeps one such process beside the running nodes; in place of a node that dies, it becomes that node:
one line of JSON on its standard input, the node's name and its command line.
"""

from __future__ import annotations

import importlib
import json
import sys
from pathlib import Path

from depth_pose.ros.runner import end_with_parent

LOADED = "spare is loaded"
"""It prints this when it can take over at once."""


def main() -> int:
    """Load, wait, become a node; gives its exit code."""
    end_with_parent()
    from depth_pose.bank import Bank, default_bank_path
    from depth_pose.pipeline import PosePipeline
    from depth_pose.ros.supervisor import NODES

    mains = {name: importlib.import_module(f"depth_pose.ros.{name}_node").main for name in NODES}
    bank = sys.argv[1] if len(sys.argv) > 1 else ""
    PosePipeline(Bank.load(Path(bank) if bank else default_bank_path())).warm_up()
    print(LOADED, flush=True)
    line = sys.stdin.readline()
    if not line:
        return 0
    name, arguments = json.loads(line)
    return int(mains[name](arguments))


if __name__ == "__main__":
    sys.exit(main())
