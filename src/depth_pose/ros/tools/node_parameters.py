"""List, read and set parameters of running nodes, for machines without the ``ros2`` command."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import yaml
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient

from depth_pose.core.errors import ConfigError, DepthPoseError
from depth_pose.ros.process.shared_memory import with_account_advice
from depth_pose.ros.tools.listener import listener, wait_until

_ANSWER_S = 10.0
"""Seconds to wait for a node's answer: it answers between two frames."""

_HOME = "/depth_pose/"
"""Namespace of a node that is given without one."""


def list_parameters(node: str | None = None) -> dict[str, dict[str, Any]]:
    """Return the parameters of a node with their values; of all nodes of the suite without one.

    Raises
    ------
    DepthPoseError
        If the node does not run or does not answer.
    """
    with listener("param") as (own, turns):
        nodes = [_full_name(node)] if node is not None else _suite(own, turns)
        values = {}
        for name in nodes:
            client = _client(own, turns, name)
            names = sorted(_answer(turns, client.list_parameters([], 0), name).result.names)
            values[name] = _values(turns, client, name, names)
        return values


def get_parameter(node: str, parameter: str) -> Any:
    """Return the value of a parameter.

    Raises
    ------
    ConfigError
        If the node has no such parameter.
    DepthPoseError
        If the node does not run or does not answer.
    """
    name = _full_name(node)
    with listener("param") as (own, turns):
        client = _client(own, turns, name)
        found = _values(turns, client, name, [parameter])
        if parameter not in found:
            names = _answer(turns, client.list_parameters([], 0), name).result.names
            raise ConfigError(f"{name} has no parameter {parameter}; it has {', '.join(sorted(names))}")
        return found[parameter]


def set_parameter(node: str, parameter: str, value: str) -> Any:
    """Set a parameter to a value in YAML; return the value that it then has.

    Raises
    ------
    ConfigError
        If the node refuses it; with the node's reason.
    DepthPoseError
        If the node does not run or does not answer.
    """
    name = _full_name(node)
    with listener("param") as (own, turns):
        client = _client(own, turns, name)
        try:
            wanted = yaml.safe_load(value)
        except yaml.YAMLError:
            wanted = value
        before = _values(turns, client, name, [parameter]).get(parameter)
        if isinstance(before, str) or wanted is None:
            wanted = value  # 1:4.5 is a zone, and a number in YAML
        elif isinstance(before, float) and type(wanted) is int:
            wanted = float(wanted)
        try:
            asked = Parameter(parameter, value=wanted)
        except TypeError as error:
            raise ConfigError(f"{value!r} is not a value of a parameter: {error}") from error
        (result,) = _answer(turns, client.set_parameters([asked]), name).results
        if not result.successful:
            raise ConfigError(f"{name} refuses {parameter}: {result.reason}")
        return _values(turns, client, name, [parameter])[parameter]


def _full_name(node: str) -> str:
    return node if node.startswith("/") else f"{_HOME}{node}"


def _names(own: Any) -> list[str]:
    found = own.get_node_names_and_namespaces()
    return sorted(f"{space.rstrip('/')}/{name}" for name, space in found if name != own.get_name())


def _suite(own: Any, turns: Callable[..., Any]) -> list[str]:
    wait_until(lambda: any(_HOME in name for name in _names(own)), turns)
    next(turns(0.5), None)  # the others follow
    found = [name for name in _names(own) if _HOME in name and own.count_services(f"{name}/get_parameters")]
    if not found:
        what = "no node of depth_pose runs in this domain; start them with: depth-pose up"
        raise DepthPoseError(with_account_advice(what))
    return found


def _client(own: Any, turns: Callable[..., Any], name: str) -> AsyncParameterClient:
    client = AsyncParameterClient(own, name)
    if not wait_until(client.services_are_ready, turns):
        there = ", ".join(_names(own)) or "none"
        raise DepthPoseError(f"no node {name} runs in this domain; there are: {there}")
    return client


def _answer(turns: Callable[..., Any], future: Any, name: str) -> Any:
    began = time.monotonic()
    for _ in turns(0.02):
        if future.done():
            return future.result()
        if time.monotonic() - began > _ANSWER_S:
            break
    raise DepthPoseError(f"{name} did not answer in {_ANSWER_S:.0f} s")


def _values(
    turns: Callable[..., Any], client: AsyncParameterClient, name: str, names: list[str]
) -> dict[str, Any]:
    """Return the values of those parameters that are set."""
    values = _answer(turns, client.get_parameters(names), name).values
    return {
        key: parameter_value_to_python(value)
        for key, value in zip(names, values, strict=False)
        if value.type != Parameter.Type.NOT_SET.value
    }
