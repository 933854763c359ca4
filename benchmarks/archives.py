"""Archive runs: frames a second with 1 and 2 workers and on a Dask cluster, and each worker's memory.

    python benchmarks/archives.py --recordings 200 --frames 10

The recordings are simulated: parts of a few movements of one person, 176 x 144. On a machine with other load
only the processor times can be compared.
"""

from __future__ import annotations

import argparse
import os
import resource
import signal
import tempfile
import time
from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from depth_pose.archive.inputs import find_sources
from depth_pose.archive.jobs import Setting
from depth_pose.archive.process import process_archive
from depth_pose.bank import Bank, default_bank_path
from depth_pose.core.config import PipelineConfig
from depth_pose.io.mcap_read import DepthReader
from depth_pose.io.mcap_write import DepthWriter, SkeletonWriter
from depth_pose.sim.config import Person
from depth_pose.sim.motion import load_motion
from depth_pose.sim.simulate import simulate

MOTIONS = ("stand_casual", "wave", "walk", "raise_arms")
CLIP_FRAMES = 30
"""Frames of each simulated clip; a recording is a part of one."""
STEP_NS = 60_000_000_000
"""Gap between two clips in a recording, nanoseconds."""
PIPELINE_KB = 250_000
"""A process with more memory than this holds a pipeline."""


def make_archive(folder: Path, recordings: int, frames: int) -> None:
    """Write recordings of a few frames each, no two the same."""
    clips = []
    for seed, motion in enumerate(MOTIONS[: max(1, min(len(MOTIONS), recordings // 10))]):
        path = folder.parent / "clips" / f"{motion}.mcap"
        path.parent.mkdir(exist_ok=True)
        simulate(path, Person().body(), load_motion(motion, 25.0, CLIP_FRAMES / 25.0), seed=seed)
        clips.append(list(DepthReader(path)))
    for k in range(recordings):
        clip = clips[k % len(clips)]
        start = k // len(clips) % (CLIP_FRAMES - frames + 1)
        with DepthWriter(folder / f"clip_{k:04d}.mcap", clip[0].camera, "optical") as writer:
            for frame in clip[start : start + frames]:
                writer.write(frame.stamp_ns + k * STEP_NS, frame.depth)


@dataclass
class Run:
    """Times and memory of one run."""

    name: str
    seconds: float = 0.0
    cpu: float = 0.0
    steady: float = 0.0
    memory: dict[int, list[int]] = field(default_factory=lambda: defaultdict(list))


def family() -> list[int]:
    """List this process and its descendants."""
    parents = {int(path.parent.name): stat_fields(path) for path in Path("/proc").glob("[0-9]*/stat")}
    found, new = [], [os.getpid()]
    while new:
        found += new
        new = [pid for pid, fields in parents.items() if fields and int(fields[1]) in new]
    return found


def stat_fields(path: Path) -> list[str]:
    """Return the fields of a process's /proc stat, from its state on; empty if it has ended."""
    try:
        return path.read_text().rpartition(")")[2].split()
    except OSError:
        return []


def resident(pid: int) -> int:
    """Return a process's resident memory, kB."""
    try:
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    except OSError:
        return 0
    return next((int(line.split()[1]) for line in lines if line.startswith("VmRSS")), 0)


def cpu_of(pid: int) -> float:
    """Return the processor time of a process, seconds."""
    fields = stat_fields(Path(f"/proc/{pid}/stat"))
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK") if fields else 0.0


def measure(name: str, sources, out: Path, setting: Setting, kill=None, **how) -> tuple[Run, list]:
    """Run the archive, sample its processes after each recording, and call ``kill`` midway."""
    run = Run(name)
    began: list[tuple[float, float, int]] = []
    frames = 0
    cpu: dict[int, float] = {}

    def collect(row) -> None:
        nonlocal frames
        frames += row.frames
        for pid in family():
            cpu[pid] = max(cpu.get(pid, 0.0), cpu_of(pid))  # those that have ended count on
            size = resident(pid)
            if size > PIPELINE_KB and pid != os.getpid():
                run.memory[pid].append(size)
        if kill and len(began) == len(sources) // 2:
            kill()
        began.append((time.monotonic(), sum(cpu.values()), frames))

    start = time.monotonic()
    rows = process_archive(sources, out, setting, collect=collect, **how)
    run.seconds = time.monotonic() - start
    # without the start: from the tenth part of the recordings on
    first, last = began[len(began) // 10], began[-1]
    run.steady = (last[2] - first[2]) / (last[0] - first[0])
    run.cpu = (last[1] - first[1]) / (last[2] - first[2])
    return run, rows


def measure_on_cluster(name: str, sources, out: Path, setting: Setting) -> tuple[Run, list]:
    """Run the archive on two processes of a Dask cluster; ``killed`` kills one of them midway."""
    import distributed

    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None, host="127.0.0.1"
        ) as cluster,
        distributed.Client(cluster) as client,
    ):

        def kill() -> None:
            os.kill(max(client.run(os.getpid).values()), signal.SIGKILL)

        address = cluster.scheduler_address
        return measure(name, sources, out, setting, kill if name == "killed" else None, scheduler=address)


def share_of_parts(sources, setting: Setting) -> tuple[float, float]:
    """Measure the processor time per frame of reading it and of writing a skeleton, ms."""
    begin = time.process_time()
    count = sum(1 for s in sources for _ in DepthReader(s.path))
    reading = (time.process_time() - begin) / count * 1e3
    from depth_pose.pipeline import PosePipeline

    frame = next(iter(DepthReader(sources[0].path)))
    result = PosePipeline(Bank.load(setting.bank or default_bank_path())).process_frame(frame)
    begin = time.process_time()
    with tempfile.TemporaryDirectory() as folder, SkeletonWriter(Path(folder) / "a.mcap") as writer:
        for k in range(500):
            writer.write_people(result.skeletons, frame.stamp_ns + k, frame.frame_id)
            writer.write(result.skeleton)
    return reading, (time.process_time() - begin) / 500 * 1e3


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--recordings", type=int, default=200)
    parser.add_argument("--frames", type=int, default=10)
    parser.add_argument("--archive", type=Path, help="Existing recordings to use.")
    parser.add_argument("--runs", nargs="+", default=["1", "2", "dask", "killed"])
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        archive = options.archive or Path(folder) / "archive"
        if not archive.exists() or not any(archive.glob("*.mcap")):
            archive.mkdir(parents=True, exist_ok=True)
            make_archive(archive, options.recordings, options.frames)
        sources = find_sources([archive])[: options.recordings]
        setting = Setting(None, Bank.load(default_bank_path()).bank_id, PipelineConfig())
        for number, name in enumerate(options.runs):
            out = Path(folder) / f"out_{number}"
            if name in ("dask", "killed"):
                run, rows = measure_on_cluster(name, sources, out, setting)
            else:
                run, rows = measure(name, sources, out, setting, workers=int(name))
            print_run(run, rows)
        reading, writing = share_of_parts(sources[:20], setting)
        print(f"reading {reading:.2f} ms a frame, writing {writing:.2f} ms")
        print(f"this process: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024} MB at most")


def print_run(run: Run, rows: list) -> None:
    """Print a run's line."""
    states = {state: sum(row.state == state for row in rows) for state in ("done", "skipped", "failed")}
    ms = np.nanmedian([row.ms for row in rows])
    print(f"{run.name}: {states}, {run.seconds:.1f} s in all; then {run.steady:.1f} frames a second,")
    print(f"  {run.cpu * 1e3:.1f} ms of processor time a frame; {ms:.1f} ms a frame in the pipeline")
    for pid, sizes in run.memory.items():
        tenth = max(1, len(sizes) // 10)
        middle = [int(np.median(part)) // 1024 for part in (sizes[tenth : 2 * tenth], sizes[-tenth:])]
        print(f"  worker {pid}: {middle[0]} MB after a tenth, {middle[1]} MB at the end, {len(sizes)} looks")


if __name__ == "__main__":
    main()
