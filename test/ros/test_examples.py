"""The examples run as they stand, in a process of their own."""

import ast
import asyncio
import json
import re
import select
import shutil
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from depth_pose_msgs.msg import Joint, Skeleton, SkeletonArray
from geometry_msgs.msg import Point
from peer import LIMIT_S, RELIABLE

from depth_pose.core.skeleton import BONES, JOINTS
from depth_pose.ros.messages.basics import make_header
from osc_reader import read_osc

EXAMPLES = Path(__file__).parents[2] / "examples"
EXAMPLE = EXAMPLES / "subscribe_skeleton.py"


def skeleton(body_id, confidence=0.9, state=Joint.SEEN):
    hand = Joint(
        name="right_wrist", position=Point(x=0.5, y=-0.25, z=2.0), confidence=confidence, state=state
    )
    header = make_header(1, "optical")
    return Skeleton(header=header, body_id=body_id, source=Skeleton.REFINED, joints=[hand])


def test_minimal_subscriber(start, peer):
    process = start(EXAMPLE)
    out = peer.publisher(SkeletonArray, "/depth_pose/skeletons", RELIABLE)
    both = [skeleton("body_7"), skeleton("body_8", confidence=0.2)]
    for skeletons, words in (
        (both, "body_7: right hand at 0.50 -0.25 2.00\nbody_8: right hand not seen\n"),
        ([skeleton("body_9", state=Joint.OUTSIDE_IMAGE)], "body_9: right hand not seen\n"),
        ([], "nobody\n"),
    ):
        frame = SkeletonArray(header=make_header(1, "optical"), skeletons=skeletons)
        peer.ask(
            lambda frame=frame: out.publish(frame),
            lambda words=words: words in process.output,
            what=lambda: process.output,
        )
    code, _ = process.end(signal.SIGINT)
    assert code == 0, process.output


def test_it_needs_only_the_messages():
    tree = ast.parse(EXAMPLE.read_text())
    names = {alias.name for n in ast.walk(tree) if isinstance(n, ast.Import) for alias in n.names}
    names |= {n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)}
    assert {name.partition(".")[0] for name in names} == {"rclpy", "depth_pose_msgs"}


def test_osc(start, peer):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(LIMIT_S)
        process = start(EXAMPLES / "osc_sender.py", "--port", receiver.getsockname()[1])
        out = peer.publisher(SkeletonArray, "/depth_pose/skeletons", RELIABLE)
        frame = SkeletonArray(header=make_header(1, "optical"), skeletons=[skeleton("body_7")])
        peer.ask(lambda: out.publish(frame), lambda: select.select([receiver], [], [], 0.0)[0])
        assert list(read_osc(receiver.recv(65536))) == [("/depth_pose/people", ["body_7"])]
        ((address, values),) = read_osc(receiver.recv(65536))
        assert address == "/depth_pose/body_7/right_wrist"
        assert values == pytest.approx([0.5, 0.25, 2.0, 0.9])  # y is up
        code, _ = process.end(signal.SIGINT)
        assert code == 0, process.output


def test_what_the_cpp_example_does_with_a_skeleton(tmp_path):
    """hands.hpp, compiled against the headers that the set-up built; rclcpp is not to be had."""
    include = Path(sys.prefix) / "include"
    if not (include / "depth_pose_msgs").is_dir():
        pytest.fail("the messages' C++ headers are missing; run: bash launch_scripts/setup.sh")
    (tmp_path / "main.cpp").write_text(
        """#include <cstdio>
#include "hands.hpp"
int main() {
  depth_pose_msgs::msg::Joint hand;
  hand.name = "right_wrist";
  hand.confidence = 0.9f;
  hand.position.z = 2.0;
  depth_pose_msgs::msg::Skeleton skeleton;
  skeleton.joints = {hand};
  const auto sure = find_joint(skeleton, "right_wrist", 0.5f);
  const bool unsure = find_joint(skeleton, "right_wrist", 0.95f).has_value();
  skeleton.joints[0].state = depth_pose_msgs::msg::Joint::OUTSIDE_IMAGE;
  const bool outside = find_joint(skeleton, "right_wrist", 0.5f).has_value();
  std::printf("%.1f %d %d %d", sure->position.z, unsure, outside,
    find_joint(skeleton, "left_wrist", 0.0f).has_value());
}
"""
    )
    folders = [f"-I{folder}" for folder in include.iterdir() if folder.is_dir()]
    command = ["c++", "-std=c++17", "-Wall", "-Wextra", "-Werror", *folders]
    command += [f"-I{EXAMPLES / 'cpp_subscriber' / 'src'}", "main.cpp", "-o", "main"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert subprocess.check_output([tmp_path / "main"], text=True) == "2.0 0 0 0"


def test_the_cpp_example_is_a_package_that_names_what_it_uses(tmp_path):
    folder = EXAMPLES / "cpp_subscriber"
    arguments = ["--log-base", str(tmp_path), "info", "--base-paths", str(folder)]
    done = subprocess.run(
        [Path(sys.prefix) / "bin" / "colcon", *arguments], capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr
    assert "type: ros.ament_cmake" in done.stdout and "name: depth_pose_cpp_subscriber" in done.stdout
    for package in ("depth_pose_msgs", "rclcpp"):
        assert package in done.stdout
        assert f"find_package({package} REQUIRED)" in (folder / "CMakeLists.txt").read_text()


NO_NODE = pytest.mark.skipif(shutil.which("node") is None, reason="Node.js is not installed")


def test_the_web_page_loads_nothing_from_elsewhere():
    page = (EXAMPLES / "web" / "index.html").read_text()
    sources = re.findall(r"""(?:src|href|from)\s*=?\s*["']([^"']+)["']""", page)
    assert sources == ["skeletons.js", "rosbridge.js"]
    assert all((EXAMPLES / "web" / source).is_file() for source in sources)


@NO_NODE
def test_how_the_web_page_subscribes(tmp_path):
    """By rosbridge's protocol, over a real WebSocket."""
    from aiohttp import WSMsgType, web

    asked = []

    async def serve(request):
        socket = web.WebSocketResponse()
        await socket.prepare(request)
        async for message in socket:
            if message.type != WSMsgType.TEXT:
                break
            asked.append(json.loads(message.data))
            await socket.send_json({"op": "publish", "topic": "/other", "msg": {"skeletons": 1}})
            await socket.send_json({"op": "publish", "topic": asked[-1]["topic"], "msg": {"skeletons": []}})
        return socket

    code = f"""
const page = require({json.dumps(str(EXAMPLES / "web" / "rosbridge.js"))});
const said = [];
const socket = page.subscribe(
  process.argv[1],
  {{ topic: "/depth_pose/skeletons", type: "depth_pose_msgs/msg/SkeletonArray", throttleMs: 40 }},
  {{
    onState: (text) => said.push(text),
    onMessage: (frame) => {{
      socket.onclose = () => {{ console.log(JSON.stringify([...said, frame])); process.exit(0); }};
      socket.close();
    }},
  }}
);
"""

    async def talk():
        app = web.Application()
        app.router.add_get("/", serve)
        runner = web.AppRunner(app)
        await runner.setup()
        site = web.TCPSite(runner, "127.0.0.1", 0)
        await site.start()
        url = f"ws://127.0.0.1:{runner.addresses[0][1]}/"
        command = ["node", "--experimental-websocket", "-e", code, url]
        process = await asyncio.create_subprocess_exec(*command, stdout=asyncio.subprocess.PIPE)
        out, _ = await asyncio.wait_for(process.communicate(), LIMIT_S)
        await runner.cleanup()
        return url, json.loads(out)

    url, said = asyncio.run(talk())
    assert said == [f"connected to {url}", {"skeletons": []}]
    (request,) = asked
    assert request["op"] == "subscribe" and request["topic"] == "/depth_pose/skeletons"
    assert request["type"] == "depth_pose_msgs/msg/SkeletonArray" and request["throttle_rate"] == 40


@NO_NODE
def test_what_the_web_page_draws():
    points = {"chest": (0.0, 0.0, 2.0, 0.9), "neck": (0.0, -0.3, 2.0, 0.5), "left_knee": (0.1, 0.5, 2.0, 1.0)}
    joints = [
        {"name": name, "position": {"x": x, "y": y, "z": z}, "confidence": c}
        for name, (x, y, z, c) in points.items()
    ]
    frame = {"skeletons": [{"body_id": "body_7", "joints": joints}]}
    code = f"""
const page = require({json.dumps(str(EXAMPLES / "web" / "skeletons.js"))});
const calls = [];
const context = new Proxy({{}}, {{
  get: (_, name) => (...values) => calls.push([name, ...values]),
  set: (_, name, value) => calls.push([name, value]),
}});
page.drawFrame(context, {json.dumps(frame)}, 1200, 600);
console.log(JSON.stringify({{ bones: page.BONES, calls }}));
"""
    done = subprocess.run(["node", "-e", code], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert {frozenset(bone) for bone in told["bones"]} == {
        frozenset((JOINTS[a], JOINTS[b])) for a, b in BONES
    }
    lines = [call for call in told["calls"] if call[0] in ("moveTo", "lineTo")]
    assert lines == [
        ["moveTo", 600, 300],
        ["lineTo", 600, 150],
    ]  # one bone: of the others an end is missing
    shades = [call[1] for call in told["calls"] if call[0] == "globalAlpha"]
    assert shades == pytest.approx([0.6, 1.0])
