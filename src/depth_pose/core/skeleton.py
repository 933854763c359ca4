"""The skeleton that everything else shares: joints, nodes, bones and their rest positions.

Frames
------
*Model frame* (``model``): metres, x to the person's left, y up, z forward (the way the
person faces), origin on the floor below the pelvis in the rest pose. *Camera frame*
(``camera``): the optical frame of the depth image, x right, y down, z forward.

Joints and nodes
----------------
`JOINTS` are the 19 published joints. `NODES` are those and the two sterno-clavicular
joints, in an order in which a parent comes before its children: the tree that forward
kinematics and skinning walk. The rotation of a node is the rotation of the body segment
that begins there, from the rest pose to the posed one, in one common frame; it is *not*
relative to the parent. The two feet carry the rotation of their ankle.

The rest pose stands upright, arms straight and 45 degrees below the horizontal, legs
slightly apart.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Any, Literal, NewType, get_args

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.rotations import mirror_rotation

JointName = Literal[
    "pelvis",
    "spine",
    "chest",
    "neck",
    "head",
    "left_shoulder",
    "left_elbow",
    "left_wrist",
    "right_shoulder",
    "right_elbow",
    "right_wrist",
    "left_hip",
    "left_knee",
    "left_ankle",
    "left_foot",
    "right_hip",
    "right_knee",
    "right_ankle",
    "right_foot",
]
"""Names of the published joints."""

JOINTS: tuple[JointName, ...] = get_args(JointName)
"""The published joints, in the order of every (19, ...) array."""

_TREE: tuple[tuple[str, str | None], ...] = (
    ("pelvis", None),
    ("spine", "pelvis"),
    ("chest", "spine"),
    ("neck", "chest"),
    ("head", "neck"),
    ("left_clavicle", "chest"),
    ("left_shoulder", "left_clavicle"),
    ("left_elbow", "left_shoulder"),
    ("left_wrist", "left_elbow"),
    ("right_clavicle", "chest"),
    ("right_shoulder", "right_clavicle"),
    ("right_elbow", "right_shoulder"),
    ("right_wrist", "right_elbow"),
    ("left_hip", "pelvis"),
    ("left_knee", "left_hip"),
    ("left_ankle", "left_knee"),
    ("left_foot", "left_ankle"),
    ("right_hip", "pelvis"),
    ("right_knee", "right_hip"),
    ("right_ankle", "right_knee"),
    ("right_foot", "right_ankle"),
)

NODES: tuple[str, ...] = tuple(name for name, _ in _TREE)
"""The kinematic tree's nodes, in the order of every (21, ...) array."""

NODE_INDEX: dict[str, int] = {name: i for i, name in enumerate(NODES)}
JOINT_INDEX: dict[str, int] = {name: i for i, name in enumerate(JOINTS)}

NODE_PARENTS: NDArray[np.int64] = np.array(
    [-1 if parent is None else NODE_INDEX[parent] for _, parent in _TREE]
)
"""Index of each node's parent, -1 for the pelvis, shape (21,)."""

JOINT_NODES: NDArray[np.int64] = np.array([NODE_INDEX[name] for name in JOINTS])
"""Index among `NODES` of each joint, shape (19,)."""

BONES: tuple[tuple[int, int], ...] = tuple(
    (JOINT_INDEX["chest" if parent.endswith("clavicle") else parent], JOINT_INDEX[name])
    for name, parent in _TREE
    if parent is not None and name in JOINT_INDEX
)
"""Pairs of joint indices (parent, child) that a drawn skeleton connects, 18 of them."""


def _mirror_name(name: str) -> str:
    if name.startswith("left_"):
        return "right_" + name.removeprefix("left_")
    if name.startswith("right_"):
        return "left_" + name.removeprefix("right_")
    return name


MIRROR_NODES: NDArray[np.int64] = np.array([NODE_INDEX[_mirror_name(name)] for name in NODES])
"""Index of each node's mirror image, shape (21,)."""

MIRROR_JOINTS: NDArray[np.int64] = np.array([JOINT_INDEX[_mirror_name(name)] for name in JOINTS])
"""Index of each joint's mirror image, shape (19,)."""

LANDMARKS: tuple[str, ...] = (*JOINTS, "left_heel", "right_heel")
"""Landmarks that the joint net measures: the joints, and the rearmost points of the heels."""

MIRROR_LANDMARKS: NDArray[np.int64] = np.array([LANDMARKS.index(_mirror_name(n)) for n in LANDMARKS])
"""Index of each landmark's mirror image, shape (21,)."""

Landmarks = NewType("Landmarks", np.ndarray[Any, np.dtype[np.float64]])
"""Positions (21, 3) of the `LANDMARKS`, metres. There are as many `NODES`, in another order."""

Nodes = NewType("Nodes", np.ndarray[Any, np.dtype[np.float64]])
"""Places (21, 3) of the body's `NODES`, metres."""


_MEASURED = np.array(
    [
        (JOINT_INDEX[a], JOINT_INDEX[b])
        for a, b in (
            ("pelvis", "neck"),
            ("neck", "head"),
            ("left_shoulder", "right_shoulder"),
            ("left_hip", "left_knee"),
            ("left_knee", "left_ankle"),
            ("right_hip", "right_knee"),
            ("right_knee", "right_ankle"),
        )
    ]
).T


def body_length(joints: NDArray[np.floating]) -> float:
    """Return the sum of the lengths of trunk, neck, thighs and shanks and the shoulder width, metres.

    The sum measures a person's size in any pose; ``joints`` are (19, 3), metres.
    """
    start, end = _MEASURED
    return float(np.linalg.norm(joints[end] - joints[start], axis=1).sum())


class JointState(IntEnum):
    """How a joint was seen; the values are those of ``depth_pose_msgs/Joint``."""

    SEEN = 0
    OCCLUDED = 1
    OUTSIDE_IMAGE = 2
    LOST = 3


class Source(IntEnum):
    """Source of a skeleton; the values are those of ``depth_pose_msgs/Skeleton``."""

    MATCHED = 0
    REFINED = 1
    RECOVERED = 2
    VOLUME = 3
    LOST = 4


class Tracking(IntEnum):
    """How a person is followed; the values are those of ``depth_pose_msgs/Skeleton``."""

    UNKNOWN = 0
    NEW = 1
    TRACKED = 2
    LOST = 3


ADULT_STATURE_M = 1.75
"""Stature of the reference adult, metres: a body scale of 1."""


def rest_nodes() -> NDArray[np.float64]:
    """Node positions of the rest pose, as fractions of stature.

    Heights, half-widths and segment lengths are the project's joint definition (rounded from
    R. Drillis and R. Contini, *Body segment parameters*, 1966, as reprinted by D. A. Winter,
    *Biomechanics and Motor Control of Human Movement*).

    Returns
    -------
    (21, 3) float64
        Positions in the model frame, in units of stature.
    """
    slope = np.sqrt(0.5)
    at: dict[str, tuple[float, float, float]] = {
        "pelvis": (0.0, 0.564, 0.0),
        "spine": (0.0, 0.647, -0.014),
        "chest": (0.0, 0.775, -0.019),
        "neck": (0.0, 0.877, -0.005),
        "head": (0.0, 0.937, 0.016),
        "left_clavicle": (0.014, 0.826, 0.005),
        "left_shoulder": (0.100, 0.820, 0.003),
        "left_hip": (0.063, 0.557, -0.005),
    }
    x, y, z = at["left_shoulder"]
    for name, reach in (("left_elbow", 0.155), ("left_wrist", 0.155 + 0.140)):
        at[name] = (x + slope * reach, y - slope * reach, z)
    x, y, z = at["left_hip"]
    for name, height, length, forward in (
        ("left_knee", 0.318, 0.241, 0.008),
        ("left_ankle", 0.072, 0.248, -0.016),
    ):
        aside = np.sqrt(length**2 - (y - height) ** 2 - forward**2)
        x, y, z = x + aside, height, z + forward
        at[name] = (x, y, z)
    at["left_foot"] = (x, 0.044, z + float(np.sqrt(0.090**2 - (0.072 - 0.044) ** 2)))
    for name in NODES:
        if name.startswith("right_"):
            left = at[_mirror_name(name)]
            at[name] = (-left[0], left[1], left[2])
    return np.array([at[name] for name in NODES], dtype=np.float64)


def forward_kinematics(
    rotations: NDArray[np.float64],
    root: NDArray[np.float64],
    nodes_rest: NDArray[np.float64],
    scale: float = 1.0,
) -> NDArray[np.float64]:
    """Positions of all nodes from their segments' rotations.

    Parameters
    ----------
    rotations : (..., 21, 3, 3)
        Rotation of each node's segment, model rest pose to target frame.
    root : (..., 3)
        Position of the pelvis in the target frame, metres.
    nodes_rest : (21, 3)
        Rest positions in the model frame, metres.
    scale : float
        Factor on all lengths.

    Returns
    -------
    (..., 21, 3) float64
        Node positions in the target frame, metres.
    """
    nodes = np.empty(rotations.shape[:-2] + (3,))
    nodes[..., 0, :] = root
    for i in range(1, len(NODES)):
        parent = NODE_PARENTS[i]
        offset = scale * (nodes_rest[i] - nodes_rest[parent])
        nodes[..., i, :] = nodes[..., parent, :] + rotations[..., parent, :, :] @ offset
    return nodes


def mirror_rotations(rotations: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mirror segment rotations in the person's mid-plane (left and right change places).

    Parameters
    ----------
    rotations : (..., 21, 3, 3)
        Segment rotations whose target frame is the model frame.

    Returns
    -------
    (..., 21, 3, 3)
        ``S R S`` with ``S = diag(-1, 1, 1)``, with the two sides exchanged.
    """
    return mirror_rotation(rotations[..., MIRROR_NODES, :, :])
