"""``depth-pose run --rig``: the recordings of several cameras in one room."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from depth_pose.cli import STOPPED
from depth_pose.cli.console import check_ending, loading, print_facts, progress_bar, tell_stopped, warn
from depth_pose.core.config import PipelineConfig
from depth_pose.core.errors import ConfigError
from depth_pose.core.outputs import check_targets
from depth_pose.io.damage import tell_damage
from depth_pose.io.image_options import ImageOptions

if TYPE_CHECKING:
    from depth_pose.rooms.offline import RoomSummary
    from depth_pose.rooms.rigfile import Rig
    from depth_pose.rooms.watching import Watch, Watched


def check_room_options(**given: Any) -> None:
    """Raise ConfigError for options that cannot be combined with ``--rig``."""
    for name, value in given.items():
        if value is not None:
            raise ConfigError(f"--{name.replace('_', '-')} does not go with --rig")


def run_room(
    recordings: Sequence[Path],
    rig_file: Path,
    output: Path,
    bank: Path | None,
    depth_topic: str | None,
    images: ImageOptions,
    config: PipelineConfig,
    workers: int | None,
    markers: bool,
) -> None:
    """Run the recordings of a rig's cameras to one file."""
    from depth_pose.rooms.rigfile import load_rig

    check_targets([output], [*recordings, rig_file, bank])
    check_ending(output, ".mcap", "a recording")
    rig = load_rig(rig_file)
    _check(rig, rig_file, recordings)

    from depth_pose.bank import Bank, default_bank_path
    from depth_pose.io.mcap_write import PartlyWritten
    from depth_pose.rooms.fusion import RoomFusion
    from depth_pose.rooms.offline import correct_clocks, misfits, process_room
    from depth_pose.rooms.watching import Watch, watch_all

    bank = bank or default_bank_path()
    watch = Watch(bank, config, depth_topic, images)
    _check_cameras(rig, recordings, watch)
    with tempfile.TemporaryDirectory(prefix="depth_pose_") as folder:
        with progress_bar("each camera", 100 * len(recordings)) as update:
            watched = watch_all(recordings, watch, Path(folder), workers, _share_of(len(recordings), update))
        with loading("the bank"):
            fusion = RoomFusion(Bank.load(bank), rig, config)
        warn(correct_clocks(watched, fusion))
        warn(f"{rig_file}: {line}" for line in misfits(watched, fusion))
        try:
            with progress_bar("the room", sum(len(w.stamps_ns) for w in watched)) as update:
                summary = process_room(watched, fusion, output, update, markers=markers)
        except PartlyWritten as stopped:
            tell_stopped(stopped)
            raise typer.Exit(STOPPED) from None
    _tell(recordings, output, watched, summary)
    tell_damage(line for one in watched for line in one.damage)


def _check(rig: Rig, rig_file: Path, recordings: Sequence[Path]) -> None:
    """Check that there is one recording for each camera."""
    names = ", ".join(camera.name for camera in rig.cameras)
    if len(rig.cameras) != len(recordings):
        raise ConfigError(
            f"{rig_file} has {len(rig.cameras)} cameras ({names}), and {len(recordings)} recordings are "
            "given: give one for each, in this order"
        )
    if len({path.resolve() for path in recordings}) < len(recordings):
        raise ConfigError("the same recording is given twice; each camera needs its own")


def _check_cameras(rig: Rig, recordings: Sequence[Path], watch: Watch) -> None:
    """Check before the work that each recording is of the rig's camera."""
    from depth_pose.io.mcap_read import DepthReader
    from depth_pose.rooms.rig_checks import check_recorded

    first = [
        next(iter(DepthReader(path, watch.depth_topic, watch.images, tell=False))).camera
        for path in recordings
    ]
    check_recorded([c.name for c in rig.cameras], [c.camera for c in rig.cameras], recordings, first)


def _share_of(count: int, update: Callable[[int], None]) -> Callable[[int, float], None]:
    """Return a progress listener that sums the shares of several recordings, in percent."""
    shares = [0.0] * count

    def listen(index: int, share: float) -> None:
        shares[index] = share
        update(round(100 * sum(shares)))

    return listen


def _tell(recordings: Sequence[Path], output: Path, watched: Sequence[Watched], summary: RoomSummary) -> None:
    """Print the facts of a run."""
    for path, one in zip(recordings, watched, strict=True):
        warn(line if str(path) in line else f"{path}: {line}" for line in one.warnings)
    sources = ", ".join(f"{n} {name.lower()}" for name, n in summary.sources.items())
    frames = ", ".join(f"{one.frames} of {path.name}" for path, one in zip(recordings, watched, strict=True))
    answered = summary.moments - summary.empty
    print_facts(
        f"{len(recordings)} cameras -> {output}",
        [
            ("frames", frames),
            ("answered", f"{answered} of {summary.moments}, at the rate of {summary.leader}"),
            ("people", f"{summary.ids}; at most {summary.most_people} at once"),
            ("skeletons", sources or "none"),
            ("fitted to several cameras", f"{summary.shared:.0%} of them"),
            ("time of the fusion", f"{summary.fuse_ms:.1f} ms a frame"),
        ],
    )
