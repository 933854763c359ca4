"""Tables of the viewer's panel: people and state of the nodes."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from depth_pose.core.printable import printable
from depth_pose.core.result import Skeleton
from depth_pose.core.skeleton import ADULT_STATURE_M, JOINT_INDEX, JointState
from depth_pose.core.zone import Zone

if TYPE_CHECKING:
    from depth_pose.ros.tools.watch import NodeState

_MARKS = re.compile(r"[\\`*{}\[\]()#+!|<>&~$:]")
"""Characters with a meaning in Markdown and in links."""

_PELVIS = JOINT_INDEX["pelvis"]


def distance_m(skeleton: Skeleton) -> float:
    """Distance of the pelvis from the sensor."""
    return float(np.linalg.norm(skeleton.positions[_PELVIS]))


def chosen(skeletons: Sequence[Skeleton], zone: Zone, most: int) -> tuple[Skeleton, ...]:
    """Return the people in a zone, at most this many, the nearest; 0: all."""
    inside = [s for s in skeletons if not s.is_lost and zone.holds(*s.positions[_PELVIS])]
    if most:
        inside = sorted(inside, key=distance_m)[:most]
    return tuple(inside)


def people_table(skeletons: Sequence[Skeleton] | None, followed: str, stamp_ns: int | None = None) -> str:
    """Return the table of people in Markdown; it marks skeletons older than the frame's stamp."""
    if skeletons is None:
        return "*no answer to this frame*"
    if not skeletons:
        return "*nobody in view*"
    lines = ["| | id | m away | m tall | sure | state | seen |", "|-|-|-|-|-|-|-|"]
    for s in skeletons:
        seen = int((s.joint_states == JointState.SEEN).sum())
        mark = "●" if s.body_id == followed else ""
        state = s.source.name.lower()
        if stamp_ns is not None and s.stamp_ns != stamp_ns:
            state = f"{(stamp_ns - s.stamp_ns) * 1e-9:.1f} s ago"
        lines.append(
            f"| {mark} | {_plain(s.body_id)} | {distance_m(s):.1f} | {_size(s)} | {s.confidence:.2f} "
            f"| {state} | {seen}/{len(s.positions)} |"
        )
    return "\n".join([*lines, "", "● followed, \\* own build known"])


def _size(skeleton: Skeleton) -> str:
    """Stature of the average build of the person's size, and a star where their own is known."""
    own = "\\*" if skeleton.build.any() else ""
    return f"{skeleton.scale * ADULT_STATURE_M:.2f}{own}"


def nodes_table(nodes: Sequence[NodeState]) -> str:
    """Make the table of the nodes' rates, times and drops, Markdown."""
    if not nodes:
        return "*nothing on /diagnostics yet: `depth-pose up` starts the nodes*"
    lines = ["| node | a second | ms a frame | ms late | dropped |", "|-|-|-|-|-|"]
    for node in sorted(nodes, key=lambda n: _ORDER.get(_short(n), 9)):
        v = node.values
        lines.append(
            f"| {_short(node)} | {_plain(v.get('rate_hz', ''))} | {_plain(v.get('process_ms_median', ''))} "
            f"| {_plain(v.get('latency_ms_median', ''))} | {_drops(v)} |"
        )
    unwell = [f"{_short(n)}: {_plain(n.message)}" for n in nodes if n.message and n.message != "ok"]
    return "\n".join([*lines, "", *unwell])


_ORDER = {name: i for i, name in enumerate(("denoise", "matcher", "refine", "recovery", "volume"))}


def _short(node: NodeState) -> str:
    return _plain(node.name.rpartition("/")[2])


def _plain(text: str) -> str:
    """Escape an untrusted name, so that Markdown shows it literally."""
    return _MARKS.sub(r"\\\g<0>", printable(text))


def _drops(values: Mapping[str, str]) -> str:
    """Return the dropped frames by reason; 0 if there are none."""
    reasons = {k.removeprefix("dropped: "): v for k, v in values.items() if k.startswith("dropped: ")}
    return _plain(", ".join(f"{count} {reason}" for reason, count in reasons.items())) or "0"
