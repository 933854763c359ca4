r"""Writer of Biovision hierarchy files (.bvh).

The format: M. Meredith and S. Maddock, *Motion Capture File Formats Explained*, University of Sheffield,
2001. y is up, the rest pose faces z, angles are degrees, intrinsic, in the order z, x, y.

The hierarchy is `depth_pose.core.skeleton.NODES`: the 19 joints, and the two sterno-clavicular joints
that carry the shoulders, as animation rigs have them. OFFSETs are the person's own, estimated from their
motion: with :math:`R_j` the rotation of the segment that begins in joint *j* and :math:`p` positions,

.. math:: o_i = \mathrm{median}_t \, R_j(t)^\top (p_i(t) - p_j(t)), \qquad j \text{ the parent of } i,

at the median length. It equals the bone of the person's build in all frames that were fitted with it. Every
segment with one child is then turned, by the smallest rotation, to point to that child's position.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.rotations import quat_to_matrix, rotation_between, unit_vectors
from depth_pose.core.skeleton import JOINT_INDEX, JOINT_NODES, NODE_INDEX, NODE_PARENTS, NODES, rest_nodes
from depth_pose.export.tracks import Track

Array = NDArray[np.float64]

_SURE = 0.5
"""Minimum confidence of both ends of a bone in the frames used for its length, if there are such frames."""

_ENDS = {"head": (0.0, 0.063, 0.0), "wrist": (0.108, 0.0, 0.0), "foot": (0.0, 0.0, 0.062)}
"""End sites beyond the last joints as shares of stature: top of the head, finger tips along the forearm,
toes; Drillis and Contini 1966, as `rest_nodes`: head 1 - .937, hand .108, foot .152 less .090 to the toe
base."""

_CLAVICLES = tuple(NODE_INDEX[f"{side}_clavicle"] for side in ("left", "right"))
_PARENT_JOINT = {NODE_INDEX[f"{side}_shoulder"]: NODE_INDEX["chest"] for side in ("left", "right")}
_CHANNELS = "Zrotation Xrotation Yrotation"


def rest_offsets(track: Track) -> Array:
    """Offset of every node from its parent in the rest pose, model frame, metres, (21, 3).

    The pelvis has none. The clavicles are those of the average body with the same trunk.
    """
    there = track.present
    positions, turns = track.positions[there], quat_to_matrix(track.quats_xyzw[there])
    sure = track.joint_confidence[there] >= _SURE
    average = rest_nodes()
    offsets = np.zeros((len(NODES), 3))
    for joint, node in enumerate(JOINT_NODES):
        if NODE_PARENTS[node] < 0:
            continue
        parent = _PARENT_JOINT.get(int(node), int(NODE_PARENTS[node]))
        before = int(np.flatnonzero(parent == JOINT_NODES)[0])
        good = sure[:, joint] & sure[:, before]
        good = good if good.any() else np.ones(len(good), np.bool_)
        bones = positions[good, joint] - positions[good, before]
        local = np.median(np.einsum("tji,tj->ti", turns[good, before], bones), axis=0)
        length = np.median(np.linalg.norm(bones, axis=1))
        offsets[node] = local * length / max(float(np.linalg.norm(local)), 1e-9)
    trunk = np.linalg.norm(offsets[NODE_INDEX["neck"]])
    trunk /= np.linalg.norm(average[NODE_INDEX["neck"]] - average[NODE_INDEX["chest"]])
    for node in _CLAVICLES:
        offsets[node] = trunk * (average[node] - average[NODE_INDEX["chest"]])
        offsets[node + 1] -= offsets[node]  # the parent of the shoulder
    return offsets


def segment_rotations(track: Track, offsets: Array) -> Array:
    """Rotations of all nodes' segments, rest pose to the track's frame, (T, 21, 3, 3).

    The track has no gaps.
    """
    rotations = np.zeros((len(track), len(NODES), 3, 3))
    rotations[:, JOINT_NODES] = quat_to_matrix(track.quats_xyzw)
    for node in _CLAVICLES:
        rotations[:, node] = rotations[:, NODE_INDEX["chest"]]
    found = np.zeros((len(track), len(NODES), 3))
    found[:, JOINT_NODES] = track.positions
    posed = np.zeros_like(found)
    posed[:, 0] = found[:, 0]
    for node in range(len(NODES)):
        children = np.flatnonzero(node == NODE_PARENTS)
        if len(children) == 1:
            (child,) = children
            bone = unit_vectors(rotations[:, node] @ offsets[child])
            aim = rotation_between(bone, unit_vectors(found[:, child] - posed[:, node]))
            rotations[:, node] = aim @ rotations[:, node]
        for child in children:
            posed[:, child] = posed[:, node] + rotations[:, node] @ offsets[child]
    return rotations


def bvh_text(track: Track, step_s: float, factor: float = 1.0) -> str:
    """Return the text of a BVH file for a motion without gaps, in a frame with y up.

    Parameters
    ----------
    track : Track
        Motion at an even rate.
    step_s : float
        Time between frames, seconds.
    factor : float
        Length units in a metre: 100 for centimetres.
    """
    offsets = rest_offsets(track)
    rotations = segment_rotations(track, offsets)
    lines = ["HIERARCHY", *_hierarchy(0, offsets * factor, 0)]
    lines += ["MOTION", f"Frames: {len(track)}", f"Frame Time: {step_s:.9f}"]
    angles = _angles(rotations)
    roots = track.positions[:, JOINT_INDEX["pelvis"]] * factor
    values = np.concatenate([roots, angles[:, _file_order(0)].reshape(len(track), -1)], axis=1)
    lines += [" ".join(f"{v:.6f}" for v in row) for row in values]
    return "\n".join(lines) + "\n"


def _file_order(node: int) -> list[int]:
    """Nodes in the order of the file: a node, then all below its first child, and so on."""
    return [node] + [n for child in np.flatnonzero(node == NODE_PARENTS) for n in _file_order(int(child))]


def _hierarchy(node: int, offsets: Array, depth: int) -> Iterator[str]:
    tab, inner = "\t" * depth, "\t" * (depth + 1)
    yield f"{tab}{'JOINT' if depth else 'ROOT'} {NODES[node]}"
    yield f"{tab}{{"
    yield f"{inner}OFFSET {_numbers(offsets[node])}"
    positions = "" if depth else "Xposition Yposition Zposition "
    yield f"{inner}CHANNELS {3 if depth else 6} {positions}{_CHANNELS}"
    children = np.flatnonzero(node == NODE_PARENTS)
    for child in children:
        yield from _hierarchy(int(child), offsets, depth + 1)
    if not len(children):
        yield f"{inner}End Site"
        yield f"{inner}{{"
        yield f"{inner}\tOFFSET {_numbers(_end(node, offsets))}"
        yield f"{inner}}}"
    yield f"{tab}}}"


def _end(node: int, offsets: Array) -> Array:
    """Offset of the end site beyond a last joint, scaled with the shank's length."""
    average = rest_nodes()
    knee, ankle = NODE_INDEX["left_knee"], NODE_INDEX["left_ankle"]
    stature = np.linalg.norm(offsets[ankle]) / np.linalg.norm(average[ankle] - average[knee])
    share = np.array(_ENDS[NODES[node].rpartition("_")[2]])
    if NODES[node].endswith("wrist"):
        return np.asarray(stature * share[0] * unit_vectors(offsets[node]))
    return np.asarray(stature * share)


def _angles(rotations: Array) -> Array:
    """Angles of every node's rotation against its parent's, degrees, z, x, y, without jumps, (T, 21, 3)."""
    local = rotations.copy()
    for node in range(1, len(NODES)):
        local[:, node] = rotations[:, NODE_PARENTS[node]].swapaxes(-1, -2) @ rotations[:, node]
    return np.asarray(np.unwrap(_euler_zxy(local), axis=0, period=360.0))


def _euler_zxy(r: Array) -> Array:
    """Angles of ``Rz(a) Rx(b) Ry(c)``, degrees, (..., 3, 3) to (..., 3); c is 0 where b is 90 degrees."""
    cosine = np.hypot(r[..., 2, 0], r[..., 2, 2])
    locked = cosine < 1e-7
    z = np.where(locked, np.arctan2(r[..., 1, 0], r[..., 0, 0]), np.arctan2(-r[..., 0, 1], r[..., 1, 1]))
    x = np.arctan2(r[..., 2, 1], cosine)
    y = np.where(locked, 0.0, np.arctan2(-r[..., 2, 0], r[..., 2, 2]))
    return np.degrees(np.stack([z, x, y], axis=-1))


def _numbers(values: Array) -> str:
    return " ".join(f"{v:.6f}" for v in values)
