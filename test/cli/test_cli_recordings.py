"""The commands on damaged recordings, and on recordings of all formats."""

from __future__ import annotations

import sqlite3
import subprocess
import sys
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import Writer

from command import Done, caller, environment
from depth_pose.core.camera import Camera
from depth_pose.core.outputs import own_folder
from depth_pose.io import schemas
from depth_pose.io.mcap_write import DepthWriter
from depth_pose.io.messages import write_camera_info, write_image
from depth_pose.io.schemas import DEPTH_TOPIC
from depth_pose.io.skeleton_cdr import write_people
from depth_pose.io.skeleton_read import read_people
from little_memory import little_memory
from skeletons import make_skeleton

CAMERA = Camera(64, 48, 60.0, 60.0, 31.5, 23.5)


@pytest.fixture
def call(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], bank_path: Path
) -> Callable[..., Done]:
    monkeypatch.setenv("DEPTH_POSE_BANK", str(bank_path))
    return caller(monkeypatch, capsys)


def _write(path: Path, frames: int = 300) -> Path:
    rng = np.random.default_rng(0)
    with DepthWriter(path, CAMERA, "optical") as writer:
        for i in range(frames):
            writer.write(i * 40_000_000, rng.uniform(2.0, 4.0, (48, 64)).astype(np.float32))
    return path


def _damage(path: Path) -> Path:
    data = bytearray(path.read_bytes())
    data[len(data) // 3] ^= 8
    path.write_bytes(data)
    return path


def test_run_on_a_damaged_recording(tmp_path: Path, call: Callable[..., Done]) -> None:
    path, output = _damage(_write(tmp_path / "in.mcap")), tmp_path / "out.mcap"
    done = call("run", path, "-o", output)
    assert done.returncode == 3
    assert done.stderr.count("1 damaged chunk, left out") == 1 and str(path) in done.stderr
    assert "error: a recording is damaged" in done.stderr
    assert 0 < len(list(read_people(output))) < 300
    for arguments in (("run", path, "-o", output, "--lenient"), ("--lenient", "run", path, "-o", output)):
        done = call(*arguments)
        assert done.returncode == 0 and "1 damaged chunk" in done.stderr and "error" not in done.stderr
    done = call("run", _write(tmp_path / "whole.mcap", 3), "-o", output)
    assert done.returncode == 0 and done.stderr == ""


def test_one_bad_stamp_is_a_counted_drop(tmp_path: Path, call: Callable[..., Done]) -> None:
    recording, output = tmp_path / "in.mcap", tmp_path / "out.mcap"
    with recording.open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros2", "test")
        kinds = (
            (DEPTH_TOPIC, schemas.IMAGE),
            (DEPTH_TOPIC.replace("image_raw", "camera_info"), schemas.CAMERA_INFO),
        )
        channels = [
            writer.register_channel(
                topic, "cdr", writer.register_schema(kind, "ros2msg", schemas.schema_text(kind).encode())
            )
            for topic, kind in kinds
        ]
        for i, ns in enumerate((0, 40_000_000, -1, 120_000_000)):
            image = write_image(ns, "optical", np.full((48, 64), 2000, np.uint16))
            for channel, data in zip(
                channels, (image, write_camera_info(ns, "optical", CAMERA)), strict=True
            ):
                writer.add_message(channel, i, data, i)
        writer.finish()
    done = call("run", recording, "-o", output)
    assert done.returncode == 0 and "stamp is below 0" in done.stderr, done.stderr
    assert [message.stamp_ns for message in read_people(output)] == [0, 40_000_000, 120_000_000]


def test_run_on_many_of_which_one_is_damaged(tmp_path: Path, call: Callable[..., Done]) -> None:
    (tmp_path / "in").mkdir()
    _write(tmp_path / "in/whole.mcap", 3)
    _damage(_write(tmp_path / "in/damaged.mcap"))
    for again in range(2):  # the second time all is done already
        done = call("run", tmp_path / "in", "-o", tmp_path / "out", "--workers", "0")
        assert done.returncode == 3, again
        assert "damaged.mcap has 1 damaged chunk" in done.stderr
    assert call("run", tmp_path / "in", "-o", tmp_path / "out", "--lenient").returncode == 0


def test_two_runs_into_one_folder(tmp_path: Path, call: Callable[..., Done]) -> None:
    (tmp_path / "in").mkdir()
    _write(tmp_path / "in/whole.mcap", 3)
    _write(tmp_path / "in/other.mcap", 3)
    with own_folder(tmp_path / "out"):
        done = call("run", tmp_path / "in", "-o", tmp_path / "out", "--workers", "0")
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert line.startswith("error: another command writes its outputs into")
    assert not (tmp_path / "out").exists()
    assert call("run", tmp_path / "in", "-o", tmp_path / "out", "--workers", "0").returncode == 0


def test_hostile_files_cost_an_archive_only_themselves(tmp_path: Path, call: Callable[..., Done]) -> None:
    folder = tmp_path / "in"
    folder.mkdir()
    _write(folder / "whole.mcap", 3)
    with (_write(folder / "zeros.mcap", 3)).open("r+b") as stream:
        stream.truncate(4 << 40)
    with closing(sqlite3.connect(folder / "view.db3")) as database:
        endless = "WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c) SELECT x AS id FROM c"
        for table in ("topics", "messages"):
            database.execute(f"CREATE VIEW {table} AS {endless}")
    (folder / "empty.bag").write_bytes(b"#ROSBAG V2.0\n" + bytes(5000))
    done = call("run", folder, "-o", tmp_path / "out", "--workers", "0", "--lenient")
    assert done.returncode == 1
    assert {path.name for path in (tmp_path / "out").glob("*.mcap")} == {"whole.mcap", "zeros.mcap"}
    lines = done.stderr.splitlines()
    for name, says in (("view", "is a view"), ("empty", "is damaged"), ("zeros", "ends too early")):
        assert sum(f"{name}" in line and says in line for line in lines) == 1, (name, lines)


def test_reading_skeletons_of_a_damaged_recording(tmp_path: Path, call: Callable[..., Done]) -> None:
    recording, skeletons = _write(tmp_path / "in.mcap"), tmp_path / "out.mcap"
    assert call("run", recording, "-o", skeletons).returncode == 0
    done = call("overlay", recording, skeletons, "-o", tmp_path / "a.png")
    assert done.returncode == 0, done.stderr
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(skeletons.read_bytes()[:-30])
    done = call("overlay", recording, cut, "-o", tmp_path / "a.png")
    assert done.returncode == 3 and "cut.mcap ends too early" in done.stderr
    assert call("--lenient", "overlay", recording, cut, "-o", tmp_path / "a.png").returncode == 0


def test_a_folder_of_images_gives_the_skeletons_of_its_recording(
    tmp_path: Path, call: Callable[..., Done]
) -> None:
    """The same file, byte for byte, by options and by camera.json, alone and among others."""
    images = tmp_path / "images"
    images.mkdir()
    depth = np.random.default_rng(0).integers(2000, 4000, (5, 48, 64)).astype(np.uint16)
    with DepthWriter(tmp_path / "in.mcap", CAMERA, "camera_depth_optical_frame") as writer:
        for i in range(5):
            np.save(images / f"{i}.npy", depth[i])
            writer.write(1_000_000_000 + i * 40_000_000, depth[i] / np.float32(1000))
    assert call("run", tmp_path / "in.mcap", "-o", tmp_path / "wanted.mcap").returncode == 0
    wanted = (tmp_path / "wanted.mcap").read_bytes()
    done = call("run", images, "-o", tmp_path / "a.mcap")
    assert done.returncode == 1 and "--intrinsics" in done.stderr
    options = ("--intrinsics", "60,60,31.5,23.5", "--fps", "25")
    done = call("run", images, "-o", tmp_path / "a.mcap", *options)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "a.mcap").read_bytes() == wanted
    (images / "camera.json").write_text('{"fx": 60, "fy": 60, "cx": 31.5, "cy": 23.5, "fps": 25}')
    assert call("run", images, "-o", tmp_path / "b.mcap").returncode == 0
    assert (tmp_path / "b.mcap").read_bytes() == wanted
    assert call("run", images, "-o", tmp_path / "c.mcap", "--fps", "0").returncode == 2


def test_a_folder_of_one_recording_is_as_one_of_two(tmp_path: Path, call: Callable[..., Done]) -> None:
    (tmp_path / "in").mkdir()
    frame = np.full((48, 64), 2.0, np.float32)
    for count, name in enumerate(("day.mcap", "night.mcap"), 1):
        with DepthWriter(tmp_path / "in" / name, CAMERA, "optical") as writer:
            writer.write(1_000_000_000, frame)
        out = tmp_path / f"out_{count}"
        done = call("run", tmp_path / "in", "-o", out, "--workers", "0")
        assert done.returncode == 0, done.stderr
        assert {path.stem for path in out.glob("*.mcap")} == {"day", "night"} if count == 2 else {"day"}
        refused = call("run", tmp_path / "in", "-o", tmp_path / "one.mcap")
        assert refused.returncode == 2 and "one.mcap is a file's name" in refused.stderr


def test_an_output_that_ends_in_a_slash_is_a_folder(tmp_path: Path, call: Callable[..., Done]) -> None:
    (tmp_path / "in").mkdir()
    with DepthWriter(tmp_path / "in/day.mcap", CAMERA, "optical") as writer:
        writer.write(1_000_000_000, np.full((48, 64), 2.0, np.float32))
    day = tmp_path / "in/day.mcap"
    done = call("run", day, "-o", f"{tmp_path}/out/", "--workers", "0")
    assert done.returncode == 0, done.stderr
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"day.mcap", "report.csv"}
    assert call("run", day, "-o", tmp_path / "one.mcap").returncode == 0
    assert (tmp_path / "one.mcap").is_file()


def test_info(tmp_path: Path, call: Callable[..., Done]) -> None:
    path = _write(tmp_path / "in.mcap")
    done = call("info", path)
    assert done.returncode == 0 and done.stderr == ""
    assert "300 messages, sensor_msgs/msg/Image" in done.stdout and "11.96 s" in done.stdout
    assert "64 x 48" in done.stdout and "fx 60.00" in done.stdout
    done = call("info", _damage(path))
    assert done.returncode == 3 and "1 damaged chunk" in done.stderr
    assert call("info", path, "--lenient").returncode == 0
    done = call("info", tmp_path / "none.mcap")
    assert done.returncode == 1 and "No such file" in done.stderr


ODD = "a\x1b[2J\x1b]0;owned\x07\nwrote forged\u202e"
"""A name that clears the screen, sets the window's title, and forges a line."""


def _is_plain(done: Done) -> bool:
    lines = (done.stdout + done.stderr).split("\n")
    return all(line.isprintable() for line in lines) and not any(line.startswith("wrote f") for line in lines)


def test_names_of_others_do_nothing_to_the_terminal(tmp_path: Path, call: Callable[..., Done]) -> None:
    """Topics, types, ids and files: what is said of a recording, of skeletons, in tables and in errors."""
    recording = tmp_path / f"{ODD}.mcap"
    with recording.open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros2", "test")
        schema = writer.register_schema(f"{ODD}/msg/{ODD}", "ros2msg", b"")
        for topic, encoding in ((f"/{ODD}", "cdr"), (f"/others/{ODD}", f"json{ODD}")):
            writer.add_message(writer.register_channel(topic, encoding, schema), 1, b"\0\1\0\0", 1)
        writer.finish()
    cut = tmp_path / f"cut {ODD}.mcap"
    cut.write_bytes(_write(tmp_path / "a.mcap").read_bytes()[:-30])
    (tmp_path / "in").mkdir()
    for name in ("one", ODD):
        _write(tmp_path / "in" / f"{name}.mcap", 3)
    (tmp_path / "in" / f"bad {ODD}.mcap").write_bytes(recording.read_bytes())
    (tmp_path / f"{ODD}.yaml").write_text(f'"{ODD!a}": {{"a": 1}}'.replace("'", ""))
    for arguments in (
        ("info", recording),
        ("info", cut),
        ("run", recording, "-o", tmp_path / "out.mcap"),
        ("run", tmp_path / "a.mcap", "-o", tmp_path / "out.mcap", "--depth-topic", ODD),
        ("run", tmp_path / "a.mcap", "-o", tmp_path / f"out {ODD}.mcap"),
        ("run", tmp_path / "a.mcap", "-o", tmp_path / "out.mcap", "--params", tmp_path / f"{ODD}.yaml"),
        ("run", tmp_path / "in", "-o", tmp_path / f"out {ODD}", "--workers", "0"),
        ("run", tmp_path / "in", "-o", tmp_path / f"out {ODD}", "--workers", "0"),  # from the report
        ("run", tmp_path / f"no {ODD}.mcap", "-o", tmp_path / "out.mcap"),
        ("overlay", recording, recording, "-o", tmp_path / "a.png"),
        ("export", recording, "-o", tmp_path / f"{ODD}.bvh"),
        ("eval", recording, recording),
        ("bank", "info", recording),
        ("view", recording, "--host", ODD),
    ):
        done = call(*arguments)
        assert _is_plain(done), (arguments, done)
        assert "\\x1b" in done.stdout + done.stderr, (arguments, done)


def test_people_with_odd_names(tmp_path: Path, call: Callable[..., Done]) -> None:
    """Ids of skeletons, in a recording of them that is exported and scored."""
    with (tmp_path / "people.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros2", "test")
        text = schemas.schema_text(schemas.SKELETON_ARRAY).encode()
        kind = writer.register_schema(schemas.SKELETON_ARRAY, "ros2msg", text)
        channel = writer.register_channel(schemas.PEOPLE_TOPIC, "cdr", kind)
        for i in range(20):
            ns = 1_000_000_000 + i * 40_000_000
            people = [make_skeleton(np.random.default_rng(0).normal(size=(19, 3)), stamp_ns=ns, body_id=ODD)]
            writer.add_message(channel, ns, write_people(people, ns, "optical"), ns)
        writer.finish()
    done = call("export", tmp_path / "people.mcap", "-o", tmp_path / "a.csv")
    assert done.returncode == 0 and _is_plain(done), done
    assert "\\x1b" in done.stdout


def test_too_little_memory_is_one_line(
    tmp_path: Path, call: Callable[..., Done], monkeypatch: pytest.MonkeyPatch
) -> None:
    """By ``ulimit -v`` from the start, or where it ends within the work."""
    recording = _write(tmp_path / "a.mcap")
    command = [sys.executable, "-m", "depth_pose.cli", "run", recording, "-o", tmp_path / "o.mcap"]
    for megabytes in (150, 400, 900):
        limit = f'ulimit -v {megabytes * 1000}; exec "$@"'
        done = subprocess.run(
            ["bash", "-c", limit, "bash", *command],
            env=environment(),
            capture_output=True,
            text=True,
            timeout=300,
        )
        assert done.returncode == 1
        (line,) = done.stderr.splitlines()
        assert line.startswith("error: there is too little memory: ulimit -v allows")
    for name, side in (("small", 64), ("images", 4096)):
        (tmp_path / name).mkdir()
        np.save(tmp_path / name / "1.npy", np.full((side, side), 2000, np.uint16))
    monkeypatch.setattr("depth_pose.cli.LEAST_MEMORY_MB", 0)
    done = call("info", tmp_path / "small", "--intrinsics", "60,60,32,32")  # loads the modules
    assert done.returncode == 0
    with little_memory(40):
        done = call("info", tmp_path / "images", "--intrinsics", "2000,2000,2048,2048")
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert line.startswith("error: there is too little memory")
