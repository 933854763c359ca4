"""Constants of several cameras: each one halved and doubled, and what that changes: `benchmarks/rooms.py`.

Every number that a module of ``depth_pose.rooms`` defines is a row. Of each room the cameras' recordings are
run and recorded once; then a value is changed, the skeletons are fused (one body fitted to all; merged by
covariances), and the cameras calibrated. The columns: mean error (mm) and found people of both fusions, false
people of both, and how far the cameras are off (mm). What watches cameras live, by the clock, does nothing
here.
"""

from __future__ import annotations

import pickle
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

import numpy as np

from depth_pose.bank import Bank, default_bank_path
from depth_pose.cli.rooms import read_all
from depth_pose.core.config import PipelineConfig
from depth_pose.core.errors import InputError
from depth_pose.core.frame import DepthFrame
from depth_pose.io.image_options import ImageOptions
from depth_pose.io.mcap_read import DepthReader
from depth_pose.pipeline import PosePipeline
from depth_pose.rooms.background import BackgroundBuilder, EmptyRoom
from depth_pose.rooms.calibration import RoomCalibration
from depth_pose.rooms.calibration_input import CameraRecord
from depth_pose.rooms.calibration_record import RecordSetting
from depth_pose.rooms.rigfile import Rig, load_rig
from depth_pose.rooms.watching import Watch, Watched, watch_all
from depth_pose.track.person_view import FramePeople
from parts.changed_constant.factors import FACTORS, times
from parts.constants import changed, constants, shown
from parts.displacement import displacement
from parts.room_fusion import fitted, merged, scored

STEP_NS = 500_000_000
"""Time from one image of the empty room to the next."""

HEAD = "fit mm | found | merged mm | found | false | cameras mm |"
"""Columns of a change."""


@dataclass(frozen=True)
class Room:
    """A simulated room: its true rig and people, each camera's run, and the records of a calibration."""

    rig: Rig
    truth: Mapping[str, np.ndarray]
    watched: list[Watched]
    records: bytes
    """Pickled: a calibration writes into them."""
    images: list[list[tuple[DepthFrame, FramePeople]]]
    """Each camera's images of the empty room with their people."""

    def fused(self, bank: Bank) -> tuple[list[float], str]:
        """Return the numbers of the fusions, and a digest of their skeletons."""
        cameras = range(len(self.rig.cameras))
        answers = [how for how, _ in (fitted(bank, self.rig, self.watched), merged(self.rig, self.watched))]
        digest = sha256()
        for how in answers:
            for skeletons in how.values():
                for skeleton in skeletons:
                    digest.update(f"{skeleton.body_id} {skeleton.confidence}".encode())
                    digest.update(skeleton.positions.tobytes())
        fit, merge = (scored(how, self.truth, cameras) for how in answers)
        numbers = [fit.mean_error_mm, fit.recall, merge.mean_error_mm, merge.recall, fit.false + merge.false]
        return numbers, digest.hexdigest()

    def calibrated(self) -> tuple[list[float], str]:
        """Return how far the cameras are off (mm), and a digest of the calibration."""
        records: list[CameraRecord] = pickle.loads(self.records)
        for record, images in zip(records, self.images, strict=True):
            record.background = background(images)
        try:
            found = RoomCalibration(records).solve()
        except InputError as error:
            return [float("nan")], str(error)
        cameras = range(1, len(self.rig.cameras))
        off = float(np.mean([displacement(found, self.truth, c)[0] for c in cameras]))
        return [off], sha256(found.T_room_camera.tobytes() + found.deviation_m.tobytes()).hexdigest()


def images_of(recording: Path, seconds: float) -> list[tuple[DepthFrame, FramePeople]]:
    """Return an image in each half second with its people."""
    people, kept = PosePipeline(Bank.load(default_bank_path())).perception, []
    for frame in DepthReader(recording, tell=False):
        found = people.perceive(frame)
        if not kept or frame.stamp_ns - kept[-1][0].stamp_ns >= STEP_NS:
            kept.append((frame, found))
        if frame.stamp_ns - kept[0][0].stamp_ns > 1e9 * seconds:
            break
    return kept


def background(images: list[tuple[DepthFrame, FramePeople]]) -> EmptyRoom | None:
    """Return the empty room that images show."""
    builder = BackgroundBuilder()
    for frame, people in images:
        builder.add(frame, people)
    return builder.room()


def load_rooms(folder: Path, seconds: float, stack: ExitStack) -> Iterator[Room]:
    """Run and record every simulated room of a folder."""
    for file in sorted(folder.glob("*.yaml")):
        truth = dict(np.load(file.with_suffix(".npz")))
        rig = load_rig(file)
        recordings = sorted(folder.glob(f"{file.stem}_?.mcap"))
        spools = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        watch = Watch(default_bank_path(), PipelineConfig(), None, ImageOptions())
        watched = watch_all(recordings, watch, spools, 0)
        settings = [RecordSetting(str(default_bank_path()), None, seconds)] * len(recordings)
        read = read_all(recordings, [path.stem for path in recordings], settings, None)
        images = [images_of(recording, seconds) for recording in recordings]
        yield Room(rig, truth, watched, pickle.dumps([one.record for one in read]), images)


def sweep(folder: Path, seconds: float, only: list[str]) -> None:
    """Print a table."""
    bank = Bank.load(default_bank_path())
    with ExitStack() as stack:
        rooms = list(load_rooms(folder, seconds, stack))
        fused = [room.fused(bank) for room in rooms]

        def measure(fuses: bool) -> tuple[np.ndarray, list[str]]:
            parts = [room.fused(bank) for room in rooms] if fuses else fused
            others = [room.calibrated() for room in rooms]
            numbers = [one + other for (one, _), (other, _) in zip(parts, others, strict=True)]
            return np.mean(numbers, axis=0), [digest for _, digest in parts + others]

        base, digests = measure(False)
        print("{:.1f} mm, {:.3f} found; merged {:.1f} mm, {:.3f}; {:.1f} false; cameras {:.1f} mm off; half, "
              "double:".format(*base))  # fmt: skip
        print(f"| | value | {HEAD} {HEAD}\n|{'---|' * 14}", flush=True)

        def change(fuses: bool) -> str:
            try:
                numbers, now = measure(fuses)
            except (ValueError, IndexError) as error:
                return f"out of range: {error} | | | | |"
            if now == digests:
                return "same | | | | |"
            return "{:+.1f} | {:+.3f} | {:+.1f} | {:+.3f} | {:+.1f} | {:+.1f}".format(*(numbers - base))

        for name, module, variable, value in constants(("rooms",)):
            short = name.removeprefix("rooms.")
            if short.startswith(tuple(only)):
                told = []
                for factor in FACTORS:
                    with changed(module, variable, times(value, factor)):
                        told.append(change(fuses=not short.startswith(("calibration", "background"))))
                print(f"| {name} | {shown(value)} | {' | '.join(told)} |", flush=True)
