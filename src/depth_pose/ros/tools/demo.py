"""The demo: play a recording in real time through the four live nodes, and report the results.

`replay_live` plays a recording's depth topic, records the skeletons, and returns the figures;
`run_demo` is that as a command, with a table and a picture at the end.
"""

from __future__ import annotations

import os
import random
import time
from collections.abc import Callable, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from depth_pose.core.outputs import check_targets
from depth_pose.core.printable import printable
from depth_pose.io.depth_topics import DepthTopic
from depth_pose.io.mcap_read import DepthReader
from depth_pose.io.recording import RawMessage
from depth_pose.io.schemas import PEOPLE_TOPIC, POINT_CLOUD, SKELETON_TOPIC
from depth_pose.io.skeleton_read import read_people
from depth_pose.ros import PROFILE_PATH, PROFILE_VARIABLE, stay_local
from depth_pose.ros.process.supervisor import Suite
from depth_pose.ros.tools.bag import Player, Recorder, header_stamp_ns
from depth_pose.ros.tools.player import Played

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rich.console import Console

    from depth_pose.evaluate.score import Score

_QUIET_S, _FIRST_S = 3.0, 15.0
"""Seconds without a further, or the first, answer after which the rest counts as dropped."""


@dataclass(frozen=True)
class DemoResult:
    """Result of a recording that was replayed live.

    Attributes
    ----------
    recording, skeletons : Path
        The depth recording, and that of its skeletons.
    frames, answered, occupied : int
        Frames played; those answered; those of them with a person in view.
    people : int
        People in the recording, by their ids.
    input_hz, output_hz : float
        Frames and answers a second; NaN for fewer than two.
    latency_s : (answered,) float64
        Wall time from publishing a frame to receiving its complete answer, seconds.
    wall_s : float
        From the first frame to the last answer.
    restarts : int
        Number of restarts of nodes that died.
    damage : tuple of str
        Damage of the recording, and topics that could not be played.
    """

    recording: Path
    skeletons: Path
    frames: int
    answered: int
    occupied: int
    people: int
    input_hz: float
    output_hz: float
    latency_s: np.ndarray
    wall_s: float
    restarts: int
    damage: tuple[str, ...]


class _Timing:
    """Wall times of published frames and received answers, by stamp.

    An answer is complete once both of its messages are in: all skeletons, and the followed person's.
    """

    def __init__(self, depth_topic: str, told: Callable[[int], None]) -> None:
        self._depth_topic, self._told = depth_topic, told
        self.sent_ns: dict[int, int] = {}
        self.received_ns: dict[int, int] = {}
        self._half: dict[int, str] = {}
        self.changed_s = time.monotonic()

    def sent(self, message: RawMessage, now_ns: int) -> None:
        if message.topic == self._depth_topic:
            self.sent_ns[header_stamp_ns(message.data)] = now_ns
            self.changed_s = time.monotonic()

    def received(self, topic: str, data: bytes, now_ns: int) -> None:
        stamp_ns = header_stamp_ns(data)
        if self._half.setdefault(stamp_ns, topic) == topic:
            return
        self.received_ns.setdefault(stamp_ns, now_ns)
        self.changed_s = time.monotonic()
        self._told(len(self.received_ns))

    def wait_until_drained(self) -> None:
        while len(self.received_ns) < len(self.sent_ns):
            latency_s = float(np.max(self.latency_s(), initial=0.0))
            patience_s = max(_QUIET_S, 2.0 * latency_s) if self.received_ns else _FIRST_S
            if time.monotonic() - self.changed_s > patience_s:
                return
            time.sleep(0.05)

    def latency_s(self) -> np.ndarray:
        received = self.received_ns.copy()  # the recorder's thread continues
        return np.array([(received[s] - self.sent_ns[s]) / 1e9 for s in received if s in self.sent_ns])


def replay_live(
    recording: Path | str,
    skeletons: Path | str,
    bank: Path | str | None = None,
    *,
    parameters: Mapping[str, Any] | None = None,
    on_ready: Callable[[], None] | None = None,
    progress: Callable[[int], None] | None = None,
    sink: Callable[[str], None] | None = None,
) -> DemoResult:
    """Play a recording at its own rate to four live nodes and record their skeletons.

    Parameters
    ----------
    recording : Path or str
        MCAP file with a depth image and its CameraInfo, or a point cloud.
    skeletons : Path or str
        MCAP file for the skeletons.
    bank : Path or str, optional
        Exemplar bank; the set-up's by default.
    parameters : mapping, optional
        Further parameters of the nodes.
    on_ready : callable, optional
        Called when the nodes are ready, before the first frame.
    progress : callable, optional
        Called with the number of answers so far.
    sink : callable, optional
        Receives every line that the nodes print.

    Raises
    ------
    InputError
        If the recording cannot be used.
    ConfigError, NodeDiedError
        If a node cannot start.
    """
    topic = DepthReader(recording).topic
    timing = _Timing(topic.name, progress or (lambda done: None))
    suite = Suite(
        bank=bank,
        parameters={**_topic_parameters(topic), **(parameters or {})},
        sink=sink or (lambda line: None),
    )
    recorder = Recorder(skeletons, [PEOPLE_TOPIC, SKELETON_TOPIC], on_message=timing.received)
    topics = [name for name in (topic.name, topic.info_topic) if name]
    player = Player(recording, topics=topics, wait_for_subscribers=topics, on_message=timing.sent)
    with suite, recorder:
        recorder.wait_subscribed()
        if on_ready is not None:
            on_ready()
        started_s = time.monotonic()
        played = player.run()
        timing.wait_until_drained()
        wall_s = timing.changed_s - started_s
        restarts = sum(suite.restarts.values())
    seen = _people_of(Path(skeletons)) if timing.received_ns else []
    return DemoResult(
        recording=Path(recording),
        skeletons=Path(skeletons),
        frames=played.messages[topic.name],
        answered=len(timing.received_ns),
        occupied=sum(map(bool, seen)),
        people=len(set().union(*seen)),
        input_hz=_rate(timing.sent_ns),
        output_hz=_rate(timing.received_ns),
        latency_s=timing.latency_s(),
        wall_s=wall_s,
        restarts=restarts,
        damage=_damage(played),
    )


def _topic_parameters(topic: DepthTopic) -> dict[str, str | bool]:
    names = (
        {"cloud_topic": topic.name}
        if topic.kind == POINT_CLOUD
        else {"image_topic": topic.name, "info_topic": topic.info_topic}
    )
    return {**names, "use_sim_time": True}


def _people_of(path: Path) -> list[set[str]]:
    """Read the people's ids in each frame."""
    return [{s.body_id for s in frame.skeletons} for frame in read_people(path)]


def _rate(times_ns: dict[int, int]) -> float:
    span_s = (max(times_ns.values()) - min(times_ns.values())) / 1e9 if len(times_ns) > 1 else 0.0
    return (len(times_ns) - 1) / span_s if span_s > 0.0 else float("nan")


def _damage(played: Played) -> tuple[str, ...]:
    lines = [f"{topic} was not played: {why}" for topic, why in played.skipped.items()]
    return (*lines, *played.damage)


def run_demo(recording: Path | str | None = None, output: Path | str = Path("results")) -> int:
    """Replay a recording live; print a table, write the skeletons and a picture of them.

    Parameters
    ----------
    recording : Path or str, optional
        MCAP file; known joints are taken from the ``.npz`` beside it where there is one. By
        default ``bags/demo.mcap``, which is simulated first if need be.
    output : Path or str
        Folder of the results, ``NAME_skeleton.mcap``, ``NAME_nodes.log`` and ``NAME.png``.

    Returns
    -------
    int
        Exit code: 0 if there were answers, else 1.
    """
    from rich.console import Console

    console = Console()
    recording = Path(recording) if recording is not None else _simulated(console)
    skeletons = Path(output) / f"{recording.stem}_skeleton.mcap"
    log = Path(output) / f"{recording.stem}_nodes.log"
    picture = Path(output) / f"{recording.stem}.png"
    frames = len(DepthReader(recording))
    check_targets([skeletons, log, picture], inputs=[recording])
    _choose_domain(console)
    with _log(log) as sink, _progress(console, frames) as (on_ready, progress):
        result = replay_live(recording, skeletons, on_ready=on_ready, progress=progress, sink=sink)
    _finish(console, result, picture, log)
    return 0 if result.answered else 1


@contextmanager
def _log(path: Path) -> Iterator[Callable[[str], None]]:
    """Yield a function that writes lines at once; a full disk is reported by the file of skeletons."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb", buffering=0) as stream:

        def write(line: str) -> None:
            with suppress(OSError):
                stream.write(line.encode(errors="replace") + b"\n")

        yield write


def _choose_domain(console: Console) -> None:
    """Isolate the demo on this machine, and from other nodes on the same topics, unless the user chose."""
    if (
        os.environ[PROFILE_VARIABLE] == str(PROFILE_PATH)
        and "ROS_AUTOMATIC_DISCOVERY_RANGE" not in os.environ
    ):
        stay_local()
    if "ROS_DOMAIN_ID" not in os.environ:
        os.environ["ROS_DOMAIN_ID"] = str(random.randint(1, 100))
        console.print(f"topics are in ROS_DOMAIN_ID={os.environ['ROS_DOMAIN_ID']}, on this machine only")


def _simulated(console: Console) -> Path:
    """Return the simulated recording; make it if it is missing."""
    from rich.progress import Progress

    from depth_pose.body.procedural import make_body
    from depth_pose.sim.motion import load_motion
    from depth_pose.sim.simulate import Stage, simulate

    path = Path("bags/demo.mcap")
    if path.is_file() and path.with_suffix(".npz").is_file():
        return path
    stage = Stage()
    clip = load_motion("play", stage.sensor.fps, 10.0)
    with Progress(console=console, transient=True) as bar:
        task = bar.add_task("simulating a time-of-flight sensor", total=len(clip))
        simulate(path, make_body(), clip, stage, progress=lambda done, _: bar.update(task, completed=done))
    console.print(f"simulated a person in front of a time-of-flight sensor: {printable(path)}", markup=False)
    return path


@contextmanager
def _progress(console: Console, frames: int) -> Iterator[tuple[Callable[[], None], Callable[[int], None]]]:
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        SpinnerColumn,
        TextColumn,
        TimeElapsedColumn,
    )

    columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, TimeElapsedColumn(), console=console, transient=True) as bar:
        task = bar.add_task("starting the nodes", total=frames)
        started = time.monotonic()

        def on_ready() -> None:
            console.print(f"the nodes were ready after {time.monotonic() - started:.1f} s")
            bar.update(task, description="frames answered")

        yield on_ready, lambda done: bar.update(task, completed=done)


def _finish(console: Console, result: DemoResult, picture: Path, log: Path) -> None:
    """Score, draw and print."""
    from depth_pose.evaluate.overlay import save_overlay
    from depth_pose.evaluate.score import score

    def say(line: str) -> None:
        console.print(printable(line), highlight=False, markup=False, soft_wrap=True)

    truth = result.recording.with_suffix(".npz")
    known = truth if truth.is_file() else None
    errors: Score | None = None
    if result.answered:
        errors = score(known, result.skeletons) if known else None
    console.print(_table(result, errors))
    for line in result.damage:
        say(f"note: {line}")
    if result.answered < result.frames or result.restarts:
        say(f"log of the nodes: {log}")
    if result.answered:
        say(f"skeletons: {result.skeletons}")
        save_overlay(result.recording, result.skeletons, picture, truth_path=known)
        say(f"picture:   {picture}")


def _table(result: DemoResult, errors: Score | None) -> object:
    from rich.markup import escape
    from rich.table import Table

    table = Table(
        title=escape(printable(result.recording)), title_justify="left", title_style="bold", show_header=False
    )
    table.add_column(style="dim")
    table.add_column()
    for name, value in _rows(result, errors):
        table.add_row(name, value)
    return table


def _rows(result: DemoResult, errors: Score | None) -> Iterator[tuple[str, str]]:
    rate = f" at {result.input_hz:.1f} a second" if np.isfinite(result.input_hz) else ""
    yield "frames played", f"{result.frames}{rate}"
    share = result.answered / result.frames if result.frames else 0.0
    yield "answered", f"{result.answered} ({share:.1%}), {result.occupied} with somebody in view"
    yield "people", f"{result.people}"
    if np.isfinite(result.output_hz):
        yield "answers", f"{result.output_hz:.1f} a second"
    if result.latency_s.size:
        median, p95 = np.percentile(result.latency_s * 1e3, [50, 95])
        yield "latency", f"median {median:.0f} ms, 95 % below {p95:.0f} ms"
    yield "time", f"{result.wall_s:.1f} s"
    if result.restarts:
        yield "nodes restarted", str(result.restarts)
    if errors is not None:
        mean, centred = errors.mean_error_mm, errors.offset_free_mm
        yield "error of the answered", f"mean {mean:.0f} mm, {centred:.0f} mm without the joints' offsets"
        yield "joints within 10 cm, of all frames", f"{errors.pck10:.1%}"
