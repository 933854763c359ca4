"""Skeletons over OSC and WebSocket, read by other programs' means."""

from __future__ import annotations

import asyncio
import json
import socket
from dataclasses import replace

import aiohttp
import numpy as np
import pytest

from depth_pose import ConfigError, OscSender, People, WebSocketSender
from depth_pose.core.result import Skeleton
from depth_pose.core.skeleton import JOINTS
from depth_pose.senders.address import parse_address
from osc_reader import read_osc
from skeletons import random_skeleton

LIMIT_S = 20.0


@pytest.fixture
def people() -> People:
    rng = np.random.default_rng(4)
    found = [random_skeleton(rng, stamp_ns=1_500_000_000, body_id=f"body_{n}") for n in (3, 8)]
    new = replace(found[1], velocities=np.zeros((0, 3)))
    return People([found[0], new], 1_500_000_000, "camera")


@pytest.mark.parametrize(
    ("text", "address"),
    [("9000", ("127.0.0.1", 9000)), ("studio:9000", ("studio", 9000)), ("[::1]:9", ("::1", 9))],
)
def test_addresses(text: str, address: tuple[str, int]) -> None:
    assert parse_address(text, "--osc") == address


@pytest.mark.parametrize("text", ["", "studio", "studio:", "studio:osc", "studio:70000", "::1:9000", "-1"])
def test_what_is_no_address_is_refused(text: str) -> None:
    with pytest.raises(ConfigError, match=r"--osc is .*; give HOST:PORT"):
        parse_address(text, "--osc")


def test_osc_is_read_by_another_reader(people: People) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(LIMIT_S)
        with OscSender(receiver.getsockname()[1]) as sender:
            sender.send(people)
            sender.send((Skeleton.lost(0, "camera"),))
        assert list(read_osc(receiver.recv(65536))) == [("/depth_pose/people", ["body_3", "body_8"])]
        for person in people:
            told = dict(read_osc(receiver.recv(65536)))
            root = f"/depth_pose/{person.body_id}"
            assert set(told) == {f"{root}/{name}" for name in (*JOINTS, "centre")}
            for joint in person:
                x, y, z = joint.position
                np.testing.assert_allclose(
                    told[f"{root}/{joint.name}"], [x, -y, z, joint.confidence], rtol=1e-6
                )
            x, y, z = person.centre
            moving = [0.0] * 3 if np.isnan(person.velocity).any() else person.velocity * [1, -1, 1]
            np.testing.assert_allclose(told[f"{root}/centre"], [x, -y, z, *moving], rtol=1e-6)
        assert list(read_osc(receiver.recv(65536))) == [("/depth_pose/people", [])]


def test_osc_to_nobody_is_no_error(people: People) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as closed:
        closed.bind(("127.0.0.1", 0))
        port = closed.getsockname()[1]
    with OscSender(port) as sender:
        for _ in range(3):
            sender.send(people)
    with pytest.raises(ConfigError, match=r"OSC cannot be sent to no\.such\.host\.invalid:9000"):
        OscSender(9000, "no.such.host.invalid")


def frames_of(port: int, sender: WebSocketSender, sent: list[People], **options: object) -> list[dict]:
    """What a client of another library receives while frames are sent one by one."""

    async def read() -> list[dict]:
        async with aiohttp.ClientSession() as session:
            url = f"http://127.0.0.1:{port}/"
            async with session.ws_connect(
                url, timeout=aiohttp.ClientWSTimeout(ws_close=LIMIT_S), **options
            ) as socket:
                received = []
                for one in sent:
                    sender.send(one)
                    received.append(json.loads(await socket.receive_str(timeout=LIMIT_S)))
                return received

    return asyncio.run(read())


def test_websocket_is_read_by_another_library(people: People) -> None:
    later = People(people[:1], 1_533_000_000, "camera")
    with WebSocketSender(0) as sender:
        first, second = frames_of(sender.port, sender, [people, later])
    assert [p["body_id"] for p in first["people"]] == ["body_3", "body_8"]
    assert (second["stamp_ns"], len(second["people"])) == (1_533_000_000, 1)
    for told, person in zip(first["people"], people, strict=True):
        assert set(told) == set(person.to_dict())
        for joint in person:
            np.testing.assert_allclose(told["joints"][joint.name]["position"], joint.position, atol=1e-4)
            np.testing.assert_allclose(told["joints"][joint.name]["covariance"], joint.covariance, atol=1e-6)
    assert first["people"][1]["velocity"] is None
    assert len(json.dumps(first)) < 20_000


@pytest.mark.parametrize(
    ("origin", "is_welcome"),
    [("http://localhost:8000", True), ("http://127.0.0.1", True), ("https://evil.example", False),
     ("http://localhost.evil.example", False)],
)  # fmt: skip
def test_pages_of_other_sites_may_not_listen(people: People, origin: str, is_welcome: bool) -> None:
    with WebSocketSender(0) as sender:
        if is_welcome:
            assert len(frames_of(sender.port, sender, [people], origin=origin)) == 1
        else:
            with pytest.raises(aiohttp.WSServerHandshakeError):
                frames_of(sender.port, sender, [people], origin=origin)


def test_a_port_in_use_is_named() -> None:
    with (
        WebSocketSender(0) as sender,
        pytest.raises(ConfigError, match=f"cannot use 127.0.0.1:{sender.port}"),
    ):
        WebSocketSender(sender.port)
