"""The depth-pose command as a user runs it."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import depth_pose
from command import Done, caller, environment
from depth_pose.core.camera import Camera
from depth_pose.core.config import PersonalConfig, PipelineConfig, SegmentConfig
from depth_pose.core.errors import ConfigError, InputError
from depth_pose.core.options import options
from depth_pose.core.progress import loading
from depth_pose.core.settings_file import read_settings
from depth_pose.io.mcap_write import DepthWriter
from skeletons import make_skeleton

COMMANDS = (
    "run",
    "info",
    "up",
    "fuse",
    "pause",
    "resume",
    "play",
    "record",
    "demo",
    "topics",
    "echo",
    "hz",
    "tf",
    "param",
    "param list",
    "param get",
    "param set",
    "simulate",
    "eval",
    "overlay",
    "view",
    "export",
    "bank",
    "bank build",
    "bank info",
    "bank check",
    "volume",
    "volume train",
    "volume info",
    "volume run",
    "volume live",
    "volume demo",
)


@pytest.fixture
def call(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., Done]:
    return caller(monkeypatch, capsys)


def call_process(*arguments: str | Path, first: Path | None = None) -> Done:
    """Call the command in a process of its own, with a folder in front of the module path."""
    command = [sys.executable, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, env=environment(first or ""))
    return Done(done.returncode, done.stdout, done.stderr)


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    with DepthWriter(tmp_path / "in.mcap", Camera(64, 48, 60.0, 60.0, 31.5, 23.5), "optical") as writer:
        writer.write(1, np.ones((48, 64), np.float32))
    return tmp_path / "in.mcap"


def test_help_names_every_command() -> None:
    done = call_process("-m", "depth_pose.cli", "--help")
    assert done.returncode == 0
    for name in COMMANDS:
        assert name.split()[0] in done.stdout


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_examples(name: str, call: Callable[..., Done]) -> None:
    done = call(*name.split(), "--help")
    assert done.returncode == 0
    if name not in ("bank", "param"):
        assert f"depth-pose {name}" in done.stdout


@pytest.mark.parametrize("name", COMMANDS)
def test_paragraphs_of_help_fill_80_columns(
    name: str, call: Callable[..., Done], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A line ends where the next word does not fit, not where the source had its break."""
    monkeypatch.setenv("COLUMNS", "80")
    lines = [line.strip() for line in call(*name.split(), "--help").stdout.splitlines()]
    prose = lines[: next(i for i, line in enumerate(lines) if line.startswith("╭"))]
    assert max(map(len, prose)) <= 79
    for line, following in pairwise(prose):
        if line and following:
            assert len(line) + 1 + len(following.split()[0]) > 78, (line, following)
        assert not line.startswith("depth-pose") or not following, f"an example on two lines: {line}"
    assert not [line for line in lines if re.match(r"│ +\S{1,2} ", line) and "]" in line[:60].split()], name


def test_start_up_loads_only_what_help_needs() -> None:
    heavy = ["numba", "open3d", "scipy", "matplotlib", "mcap", "rclpy", "numpy"]
    code = f"import sys, depth_pose.cli; print([m for m in {heavy} if m in sys.modules])"
    done = call_process("-c", code)
    assert done.stdout.strip() == "[]", done.stderr


def test_version(call: Callable[..., Done]) -> None:
    assert call("--version").stdout.strip() == depth_pose.__version__


def test_defaults_are_those_of_the_configuration(call: Callable[..., Done]) -> None:
    near = next(o for o in options(SegmentConfig) if o.name == "near")
    done = call("run", "--help")
    assert f"{near.default} m" in done.stdout
    assert near.help in done.stdout


@pytest.mark.parametrize(
    ("arguments", "code", "says"),
    [
        (["run", "none.mcap", "-o", "out.mcap"], 1, "none.mcap cannot be read"),
        (
            ["run", "{in}", "-o", "out.mcap", "--method", "magic"],
            2,
            "error: refine.method is 'magic'; it is one of articulated, cpd",
        ),
        (["run", "{in}", "-o", "out.mcap", "--depth-topic", "/no"], 1, "no messages on /no"),
        (["run", "{in}", "-o", "out.mcap", "--bank", "none.npz"], 1, "none.npz"),
        (["run", "{in}", "-o", "out.mcap", "--near", "-1"], 2, "--near"),
        (["run", "{in}", "-o", "out.mcap", "--zone", "4"], 2, "zone is '4'"),
        (
            ["run", "{in}", "-o", "out.mcap", "--follow", "me"],
            2,
            "error: follow.whom is 'me'; it is one of first",
        ),
        (["run", "{in}", "-o", "out.mcap", "--people", "-1"], 2, "--people"),
        (["run", "{in}", "-o", "out.csv"], 2, "error: out.csv must be a recording (depth-pose export"),
        (["run", "{in}", "-o", "out.mcap", "--save-build", "b.txt"], 2, "its name ends in .json"),
        (["record", "-o", "out.bag"], 2, "error: out.bag must be a recording: its name ends in .mcap"),
        (["bank", "build", "-o", "bank.zip"], 2, "error: bank.zip must be a bank"),
        (["volume", "train", "-o", "model.h5"], 2, "error: model.h5 must be a model"),
        (["run", "{in}"], 2, "--output"),
        (["run", "{in}", "-o", "out.mcap", "--cluster", "tcp://x:1"], 2, "--cluster is for several"),
        (["run", "{in}", "{in}", "-o", "out.mcap"], 2, "out.mcap is a file's name"),
        (["run", "{in}", "none.mcap", "-o", "out"], 1, "none.mcap cannot be read"),
        (["run", "*.nothing", "-o", "out"], 1, "*.nothing"),
        (["run", "{in}", "{in}", "-o", "o", "--workers", "1", "--cluster", "tcp://x:1"], 2, "give either"),
        (["eval", "none.npz", "{in}"], 1, "none.npz"),
        (["eval", "joints.json", "{in}"], 2, "--recording"),
        (["eval", "joints.json", "{in}", "--recording", "{in}", "--plot", "e.png"], 2, "in pixels"),
        (["overlay", "{in}", "{in}", "-o", "out.png"], 1, "no skeletons on /depth_pose/skeleton"),
        (["simulate", "-o", "a.mcap", "--motion", "fly"], 2, "no motion 'fly'"),
        (["simulate", "-o", "a.mcap", "--sensor", "sonar"], 2, "no sensor 'sonar'"),
        (["simulate", "-o", "a.mcap", "--people", "2"], 2, "--people needs --room"),
        (["simulate", "-o", "a.mcap", "--room", "--stature", "1.5"], 2, "leave out --stature"),
        (["simulate", "-o", "a.mcap", "--home"], 2, "--home needs --room"),
        (["simulate", "-o", "a.mcap", "--camera-moves"], 2, "--camera-moves needs --room"),
        (["simulate", "-o", "a.mcap", "--room", "--sensor", "eye"], 2, "there is no sensor 'eye'"),
        (["simulate", "-o", "a.mcap", "--room", "--cameras", "2", "--home"], 2, "leave out --cameras"),
        (["bank", "info", "none.npz"], 1, "none.npz"),
        (["bank", "build", "-o", "a.npz", "--body", "cube"], 2, "no body 'cube'"),
        (["nonsense"], 2, "nonsense"),
    ],
)
def test_errors_are_one_line(
    tmp_path: Path,
    recording: Path,
    arguments: list[str],
    code: int,
    says: str,
    monkeypatch: pytest.MonkeyPatch,
    call: Callable[..., Done],
) -> None:
    monkeypatch.chdir(tmp_path)
    done = call(*(str(recording) if a == "{in}" else a for a in arguments))
    assert done.returncode == code, done.stdout + done.stderr
    assert says in done.stderr
    assert "Traceback" not in done.stderr
    if "Usage" not in done.stderr:
        assert len(done.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "out.mcap").exists()


def test_simulate_and_eval(tmp_path: Path, call: Callable[..., Done]) -> None:
    done = call(
        "simulate", "-o", tmp_path / "s.mcap", "--seconds", "0.08", "--motion", "wave", "--stature", "1.5"
    )
    assert done.returncode == 0, done.stderr
    assert "2 at 25 per second" in done.stdout
    from depth_pose.evaluate.truth import load_truth
    from depth_pose.io.mcap_write import SkeletonWriter

    truth = load_truth(tmp_path / "s.npz")
    with SkeletonWriter(tmp_path / "p.mcap") as writer:
        for stamp, joints in zip(truth.stamps_ns, truth.joints + np.array([0.03, 0, 0]), strict=True):
            writer.write(make_skeleton(joints, stamp_ns=int(stamp)))
    done = call("eval", tmp_path / "s.npz", tmp_path / "p.mcap", "--json", "--plot", tmp_path / "e.png")
    numbers = json.loads(done.stdout)
    assert numbers["mean_error_mm"] == pytest.approx(30, abs=1e-3)
    assert numbers["pck"]["0.05"] == 1.0
    assert (tmp_path / "e.png").exists()
    table = call("eval", tmp_path / "s.npz", tmp_path / "p.mcap").stdout
    assert "30.0" in table
    assert "left_wrist" in table
    done = call(
        "overlay",
        tmp_path / "s.mcap",
        tmp_path / "p.mcap",
        "-o",
        tmp_path / "o.png",
        "--truth",
        tmp_path / "s.npz",
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "o.png").exists()


def test_simulated_room_is_scored_for_everybody(tmp_path: Path, call: Callable[..., Done]) -> None:
    """Answers 30 mm beside everybody who takes part, and a skeleton too many in every frame."""
    options = ("--room", "--people", "2", "--seconds", "0.2", "--width", "96", "--seed", "4")
    done = call("simulate", "-o", tmp_path / "r.mcap", *options)
    assert done.returncode == 0, done.stderr
    assert "3 at 15 per second" in done.stdout
    from depth_pose.evaluate.truth import load_known_people
    from depth_pose.io.mcap_write import SkeletonWriter

    truth = load_known_people(tmp_path / "r.npz")
    assert truth.joints.shape[:2] == truth.visible.shape == (3, 2)
    with SkeletonWriter(tmp_path / "p.mcap") as writer:
        for stamp, joints in zip(truth.stamps_ns, truth.joints, strict=True):
            places = [*(joints + np.array([0.03, 0, 0])), joints[0] + 9]
            people = [make_skeleton(at, stamp_ns=int(stamp), body_id=f"b_{i}") for i, at in enumerate(places)]
            writer.write_people(people, int(stamp), "optical")
    numbers = json.loads(call("eval", tmp_path / "r.npz", tmp_path / "p.mcap", "--json").stdout)["total"]
    assert numbers["recall"] == 1.0
    assert numbers["mean_error_mm"] == pytest.approx(30, abs=1e-2)
    assert numbers["switches"] == 0
    assert numbers["false"] >= 3
    table = call("eval", tmp_path / "r.npz", tmp_path / "p.mcap").stdout
    assert "IDF1" in table
    assert "30.0" in table
    pictures = (tmp_path / "p.mcap", "-o", tmp_path / "o.png", "--truth", tmp_path / "r.npz")
    assert call("overlay", tmp_path / "r.mcap", *pictures).returncode == 0


def test_long_loading_is_told_where_there_is_no_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    with loading("the bank"):
        pass
    assert capsys.readouterr().err == ""
    said, end = "", time.monotonic() + 60.0
    with loading("the bank", long_s=0.01):
        while not said and time.monotonic() < end:
            time.sleep(0.02)
            said = capsys.readouterr().err
    assert said.startswith("loading the bank and compiling the kernels")


def test_settings_files(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text("segment: {near: 1.0}\nbuild:\n  scale: 0.8\n")
    config = PipelineConfig.from_mapping(read_settings(path))
    assert (config.segment.near, config.build.scale) == (1.0, 0.8)
    (tmp_path / "a.json").write_text('{"build": {"scale": 0.9}}')
    assert read_settings(tmp_path / "a.json") == {"build": {"scale": 0.9}}
    path.write_text(
        "/**:\n  ros__parameters:\n    bank: x.npz\n    build.scale: 0.7\n    segment: {far: 4.0}\n"
    )
    assert read_settings(path) == {"build": {"scale": 0.7}, "segment": {"far": 4.0}}
    path.write_text(
        "/**:\n  ros__parameters:\n    zone: '1:4'\n    follow: nearest\n    follow.patient: true\n"
    )
    config = PipelineConfig.from_mapping(read_settings(path))
    assert (config.segment.zone, config.follow.whom, config.follow.patient) == ("1:4", "nearest", True)
    path.write_text("")
    assert read_settings(path) == {}
    assert PersonalConfig().scale == PipelineConfig.from_mapping({}).build.scale


@pytest.mark.parametrize(
    ("name", "text", "error", "says"),
    [
        ("a.yaml", "a: [", ConfigError, "not YAML"),
        ("a.json", "{", ConfigError, "not JSON"),
        ("a.yaml", "near: 1", ConfigError, "by step"),
        ("b.yaml", None, InputError, "cannot be read"),
    ],
)
def test_bad_settings_files(tmp_path: Path, name: str, text: str | None, error: type, says: str) -> None:
    if text is not None:
        (tmp_path / name).write_text(text)
    with pytest.raises(error, match=says):
        read_settings(tmp_path / name)


LIVE = (
    "up",
    "up --auto",
    "fuse --topic /a/skeletons --topic /b/skeletons",
    "pause",
    "resume",
    "play {in}",
    "record -o out.mcap --seconds 1",
    "demo",
    "demo {in}",
    "topics",
    "echo",
    "hz",
    "tf",
    "param list",
    "view",
    "calibrate --live /a /b -o rig.yaml",
    "volume live",
)

WITHOUT_ROS = """
import sys
from depth_pose.cli import main
class Gone:
    def find_spec(self, name, path=None, target=None):
        package = name.partition(".")[0]
        if package in ("rclpy", "builtin_interfaces") or package.endswith("_msgs"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Gone())
for line in sys.stdin.read().splitlines():
    sys.argv = ["depth-pose", *line.split()]
    print(">", line, file=sys.stderr, flush=True)
    try:
        main()
    except SystemExit as end:
        assert end.code == 1, line
    for name in [n for n in sys.modules if n.startswith("depth_pose.ros")]:
        del sys.modules[name]
"""


def test_without_ros_every_live_command_ends_with_one_line(tmp_path: Path, recording: Path) -> None:
    lines = [line.replace("{in}", str(recording)) for line in LIVE]
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_ROS],
        input="\n".join(lines),
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=300,
        env=environment(),
    )
    assert done.returncode == 0, done.stderr
    told = [part.splitlines() for part in done.stderr.split("> ")[1:]]
    assert [line for line, *_ in told] == lines
    for line, *said in told:
        assert len(said) == 1 and "ROS 2 is not installed in this Python" in said[0], (line, said)
    assert "recording" in done.stdout or not done.stdout
    assert list(tmp_path.iterdir()) == [recording]


def test_messages_that_are_not_built_are_named(tmp_path: Path) -> None:
    (tmp_path / "depth_pose_msgs.py").write_text("raise ModuleNotFoundError('no', name='depth_pose_msgs')\n")
    done = call_process("-m", "depth_pose.cli", "up", first=tmp_path)
    assert done.returncode == 1 and done.stderr.count("\n") == 1
    assert "depth_pose_msgs are not built for this Python" in done.stderr
