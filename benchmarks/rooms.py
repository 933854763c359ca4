"""Several cameras in one room, measured on simulated recordings.

    depth-pose simulate --room --people 2 --cameras 2 --seconds 60 --width 320 --seed 1 -o rooms/pair1.mcap
    python benchmarks/rooms.py calibration rooms/ --seconds 20 60
    python benchmarks/rooms.py fusion rooms/
    python benchmarks/rooms.py constants rooms/ --only merge room_person

``calibration``: for each NAME.yaml of a folder, the true rig, calibrates NAME_0.mcap, NAME_1.mcap and so on;
prints how far each camera is off against the first: mean displacement of points where people were (0 to 1.8 m
above the floor), of the camera itself, and the turn; beside what the calibration states itself. ``fusion``:
errors of joints hidden from a camera and seen by it, from that camera alone and from several, on the same
people at the same moments; found people, ids, and the time of the fusion. ``constants``: each number of the
fusion and of the calibration halved and doubled, and what that changes.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from parts.displacement import displacement
from parts.room_constants import sweep
from parts.room_fusion import fusion

from depth_pose.bank import default_bank_path
from depth_pose.cli.rooms import read_all
from depth_pose.core.errors import InputError
from depth_pose.rooms.calibration import RoomCalibration
from depth_pose.rooms.calibration_record import RecordSetting


def calibration(folder: Path, seconds: list[float], names: list[str]) -> None:
    """Calibrate every simulated room of a folder, and print a table."""
    bank = str(default_bank_path())
    columns = f"{'room':10} {'s':>4} {'camera':>6} {'mm':>6} {'place':>6} {'deg':>5}"
    print(f"{columns}   said mm   deg  clock ms (true)")
    for length in seconds:
        rows = []
        for rig in sorted(folder.glob("*.yaml")):
            if names and rig.stem not in names:
                continue
            truth = dict(np.load(rig.with_suffix(".npz")))
            if len(truth["stamps_ns"]) and np.ptp(truth["stamps_ns"]) < 0.9e9 * length:
                continue
            recordings = sorted(folder.glob(f"{rig.stem}_?.mcap"))
            try:
                settings = [RecordSetting(bank, None, length)] * len(recordings)
                read = read_all(recordings, [path.stem for path in recordings], settings, None)
                found = RoomCalibration([one.record for one in read]).solve()
            except InputError as error:
                print(f"{rig.stem:10} {length:4.0f} refused: {error}")
                continue
            for c in range(1, len(recordings)):
                moved, place, turned = displacement(found, truth, c)
                rows.append((moved, place, turned))
                print(
                    f"{rig.stem:10} {length:4.0f} {c:6} {moved:6.1f} {place:6.1f} {turned:5.2f}   "
                    f"{1e3 * found.deviation_m[c]:7.1f} {found.deviation_deg[c]:5.2f}  "
                    f"{1e3 * found.offsets[c]:+.1f} ({1e3 * truth['clock_offsets_s'][c]:+.1f})"
                )
        if rows:
            moved, place, turned = np.median(rows, axis=0)
            print(f"{'median':10} {length:4.0f} {len(rows):6} {moved:6.1f} {place:6.1f} {turned:5.2f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parts = parser.add_subparsers(dest="part", required=True)
    one = parts.add_parser("calibration")
    one.add_argument("folder", type=Path)
    one.add_argument("--seconds", type=float, nargs="+", default=[20.0, 60.0])
    one.add_argument("--names", nargs="*", default=[], help="rooms, by default all")
    two = parts.add_parser("fusion")
    two.add_argument("folder", type=Path)
    two.add_argument("--rigs", type=Path, help="folder of rig files in place of the true ones")
    two.add_argument("--names", nargs="*", default=[], help="rooms, by default all")
    three = parts.add_parser("constants")
    three.add_argument("folder", type=Path)
    three.add_argument("--seconds", type=float, default=20.0, help="of the calibration")
    three.add_argument("--only", nargs="*", default=[""], help="beginnings of names")
    given = parser.parse_args()
    if given.part == "calibration":
        calibration(given.folder, given.seconds, given.names)
    elif given.part == "constants":
        sweep(given.folder, given.seconds, given.only)
    else:
        fusion(given.folder, given.names, given.rigs)


if __name__ == "__main__":
    main()
