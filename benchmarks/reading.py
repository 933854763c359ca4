"""Constants of reading: each one halved and doubled, and which recordings are then read otherwise.

    python benchmarks/reading.py RECORDINGS --frames 40

RECORDINGS is a folder of recordings, good and bad ones: files and folders of any kind that `depth-pose run`
reads. Every number in a module of `depth_pose.io`, limits of sizes and times included, is a row. The columns:
recordings whose first frames (depth, camera, stamps), warnings or errors differ, for half and for double.
"""

from __future__ import annotations

from hashlib import sha256
from pathlib import Path

from command_line import make_parser
from parts.changed_constant.factors import FACTORS, times
from parts.constants import changed, constants, shown

from depth_pose.core.errors import InputError
from depth_pose.io.mcap_read import DepthReader


def digest_of(path: Path, most: int) -> str:
    """Return a digest of what is read of a recording, or of why it cannot be read."""
    digest = sha256()
    try:
        reader = DepthReader(path, tell=False)
        for _, frame in zip(range(most), reader, strict=False):
            digest.update(frame.depth.tobytes() + f"{frame.camera} {frame.stamp_ns}".encode())
        digest.update("".join(reader.warnings).encode())
    except InputError as error:
        digest.update(str(error).encode())
    return digest.hexdigest()


def main() -> None:
    """Read and report."""
    parser = make_parser(__doc__)
    parser.add_argument("recordings", type=Path)
    parser.add_argument("--frames", type=int, default=40, help="of each recording, from its beginning")
    parser.add_argument("--only", nargs="*", default=[""], help="beginnings of names")
    arguments = parser.parse_args()
    paths = sorted(path for path in arguments.recordings.iterdir() if path.suffix not in (".npz", ".yaml"))
    base = {path: digest_of(path, arguments.frames) for path in paths}
    print(f"{len(paths)} recordings; those that are read otherwise, with half and with double:")
    print("| | value | half | double |\n|---|---|---|---|", flush=True)
    for name, module, variable, value in constants(("io",)):
        if name.removeprefix("io.").startswith(tuple(arguments.only)):
            told = []
            for factor in FACTORS:
                with changed(module, variable, times(value, factor)):
                    others = [p.stem for p in paths if digest_of(p, arguments.frames) != base[p]]
                told.append(", ".join(others) or "same")
            print(f"| {name} | {shown(value)} | {' | '.join(told)} |", flush=True)


if __name__ == "__main__":
    main()
