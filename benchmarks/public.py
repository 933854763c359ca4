"""Score the tracker on public data sets, from their files as they are published.

    python benchmarks/public.py utd-mhad DIR          # UTD-MHAD: Kinect v1; Depth/ and Skeleton/
    python benchmarks/public.py itop DIR [--view side|top]    # ITOP: single frames; needs h5py
    python benchmarks/public.py msr-action3d DIR      # MSR Action3D: Kinect v1; .bin and .txt
    python benchmarks/public.py eval DIR              # EVAL: Kinect v1 with markers; seq_*.bin
    python benchmarks/public.py smmc DIR              # SMMC-10: recordings and .npz, converted by yourself

Nothing is tuned to them. Where the reference is another tracker (utd-mhad, msr-action3d) or markers (eval,
smmc), the constant offset of each joint or marker is removed, since it is a matter of definition.
``--clips N`` takes N clips, evenly spread; ``--frames N`` at most N frames of each.
"""

from __future__ import annotations

from pathlib import Path

import one_thread  # noqa: F401
from command_line import make_parser
from parts.public_readers import READERS
from parts.public_score import PUBLISHED, run_clip, summary

if __name__ == "__main__":
    parser = make_parser(__doc__)
    parser.add_argument("set", choices=["utd-mhad", "itop", "msr-action3d", "eval", "smmc"])
    parser.add_argument("folder", type=Path, metavar="DIR")
    parser.add_argument("--view", choices=["side", "top"], default="side", help="of itop")
    parser.add_argument("--clips", type=int, metavar="N", help="number of clips, evenly spread; default: all")
    parser.add_argument("--frames", type=int, metavar="N", help="most frames of a clip; default: all")
    given = parser.parse_args()
    clips = READERS[given.set](given.folder, given.view)
    if given.clips and given.clips < len(clips):
        clips = [clips[i * len(clips) // given.clips] for i in range(given.clips)]
    results = []
    for clip in clips:
        results.append(run_clip(clip, given.frames))
        print(results[-1].line(), flush=True)
    print(summary(results))
    for what, figure, source in PUBLISHED[given.set]:
        print(f"published: {what}: {figure} ({source})")
