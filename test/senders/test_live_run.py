"""``depth-pose run`` sends what it finds while it runs, at the pace of the recording."""

from __future__ import annotations

import json
import shutil
import socket
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from command import Done, caller
from depth_pose import People, WebSocketSender
from depth_pose.detect.sample_frame import sample_frame
from depth_pose.io.mcap_write import DepthWriter
from depth_pose.io.skeleton_read import read_people
from depth_pose.offline import Paced
from osc_reader import read_osc
from skeletons import random_skeleton

EXAMPLES = Path(__file__).parents[2] / "examples"
STEP_NS = 40_000_000


@pytest.fixture
def call(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], bank_path: Path
) -> Callable[..., Done]:
    monkeypatch.setenv("DEPTH_POSE_BANK", str(bank_path))
    return caller(monkeypatch, capsys)


def test_what_is_found_is_sent_and_written(tmp_path: Path, call: Callable[..., Done]) -> None:
    frame = sample_frame()
    with DepthWriter(tmp_path / "in.mcap", frame.camera, "optical") as writer:
        for k in range(3):
            writer.write(k * STEP_NS, frame.depth)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(5.0)
        port = receiver.getsockname()[1]
        done = call("run", tmp_path / "in.mcap", "-o", tmp_path / "out.mcap", "--osc", port, "--websocket", 0)
        assert done.returncode == 0, done.stderr
        for written in read_people(tmp_path / "out.mcap"):
            assert list(read_osc(receiver.recv(65536))) == [("/depth_pose/people", ["body_1"])]
            told = dict(read_osc(receiver.recv(65536)))
            x, y, z = written.skeletons[0]["head"].position
            np.testing.assert_allclose(told["/depth_pose/body_1/head"][:3], [x, -y, z], rtol=1e-6)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--osc", "nowhere"), "--osc is 'nowhere'; give HOST:PORT"),
        (("--websocket", "1", "--passes", "2"), "--websocket cannot be combined with --passes 2"),
        (("--real-time", "-o", "{folder}/"), "--real-time: only for one recording that goes to one file"),
    ],
)
def test_what_cannot_be_sent_is_refused(
    tmp_path: Path, call: Callable[..., Done], options: tuple[str, ...], says: str
) -> None:
    with DepthWriter(tmp_path / "in.mcap", sample_frame().camera, "optical") as writer:
        writer.write(0, sample_frame().depth)
    given = [option.format(folder=tmp_path / "out") for option in options]
    output = () if "-o" in given else ("-o", tmp_path / "out.mcap")
    done = call("run", tmp_path / "in.mcap", *output, *given)
    assert done.returncode == 2 and says in done.stderr


class Recording(list):
    """Frames of a recording with a problem."""

    path, dropped, warnings = Path("in.mcap"), 2, ("w",)


def test_frames_keep_the_pace_of_the_recording() -> None:
    """A gap of an hour is no pause; who is late goes on at once."""
    stamps = [0, STEP_NS, 2 * STEP_NS, 3_600_000_000_000, 3_600_000_000_000 + STEP_NS]
    frames = [SimpleNamespace(stamp_ns=stamp) for stamp in stamps]
    paced = Paced(Recording(frames))
    start = time.monotonic()
    assert list(paced) == frames
    assert 3 * STEP_NS * 1e-9 <= time.monotonic() - start < 60.0
    assert (paced.path, paced.dropped, paced.warnings) == (Path("in.mcap"), 2, ("w",))


@pytest.mark.skipif(shutil.which("node") is None, reason="Node.js is not there")
def test_the_web_page_reads_it() -> None:
    code = f"""
const page = require({json.dumps(str(EXAMPLES / "live" / "websocket.js"))});
const socket = page.listen(process.argv[1], {{
  onState: () => 0,
  onFrame: (frame) => {{
    console.log(JSON.stringify([frame.people.map(page.describe), page.asMessage(frame)]));
    process.exit(0);
  }},
}});
"""
    person = random_skeleton(np.random.default_rng(2), body_id="body_7")
    with WebSocketSender(0) as sender:
        sender.send(People([person]))
        command = ["node", "--experimental-websocket", "-e", code, f"ws://127.0.0.1:{sender.port}"]
        done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    (words,), message = json.loads(done.stdout)
    assert words == f"body_7 at {person.centre[2]:.1f} m, {np.linalg.norm(person.velocity):.1f} m/s"
    (drawn,) = message["skeletons"]
    assert [joint["name"] for joint in drawn["joints"]] == [joint.name for joint in person]
    np.testing.assert_allclose(
        list(drawn["joints"][4]["position"].values()), person["head"].position, atol=1e-4
    )
