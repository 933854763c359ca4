"""The kinematic model of people of REP-155: a URDF of a person's build, and the angles of its joints.

REP-155, *Conventions, Topics, Interfaces for Perception in Human-Robot Interaction* (section *Kinematic Model
of the Human*) names links and joints; the joint axes are those of the public package ``human_description``,
so that other clients interpret the angles correctly. Every name ends in ``_ID``.

Frames are REP-103's: in the standing posture x points forward, y to the person's left, z up. Arms and legs
hang along -z. ``body`` lies midway between the hips, ``torso`` midway between the shoulders.

The model has fewer joints than people: the trunk only bends forward and backward. The angles of arms, legs
and head reproduce their *directions*; twist and side bend of the trunk are lost, so shoulders and head are a
few centimetres off. `Posture.frames` are the measured poses, without this loss.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.angles import HANG
from depth_pose.core.result import Skeleton
from depth_pose.core.rotations import mirror_rotation, quat_to_matrix, rotation_y
from depth_pose.core.skeleton import JOINT_INDEX, NODE_INDEX

Array = NDArray[np.float64]

SIDES: tuple[tuple[str, str, float], ...] = (("l", "left", 1.0), ("r", "right", -1.0))
"""REP-155's letter, our word, and the sign of y of each side."""

LINKS: tuple[str, ...] = ("body", "waist", "torso", "head") + tuple(
    f"{letter}_{part}"
    for letter, _, _ in SIDES
    for part in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
)
"""The main links, in the order of `Posture.frames`."""

JOINTS: tuple[str, ...] = ("waist", "r_head", "y_head", "p_head") + tuple(
    f"{letter}_{name}"
    for letter, _, _ in SIDES
    for name in (
        *("y_shoulder", "p_shoulder", "r_shoulder", "elbow"),
        *("y_hip", "p_hip", "r_hip", "knee"),
    )
)
"""The movable joints, in the order of `Posture.angles`."""

_FORWARD, _LEFT, _UP = np.eye(3)[2], np.eye(3)[0], np.eye(3)[1]
"""Directions in the model frame of `depth_pose.core.skeleton`."""
_AXES = np.stack([_FORWARD, _LEFT, _UP], axis=1)
"""``R_model_link``: REP-103's axes in the model frame of `depth_pose.core.skeleton`."""

_STRAIGHT = 0.15
"""Relative weight of the segment's own twist; the bend direction dominates above 9 degrees, since a straight
limb has no bend plane."""

_RADIUS_M = 0.03
"""Radius of the limbs as drawn, metres."""

NEW_SIZES = 0.02
"""Relative change of a size above which the URDF is published again."""


@dataclass(frozen=True)
class Sizes:
    """Lengths of a person's links, metres; pairs are (forward, up)."""

    torso: tuple[float, float]
    neck: tuple[float, float]
    head: tuple[float, float]
    shoulder: float
    hip: float
    upper_arm: float
    forearm: float
    thigh: float
    shank: float

    @classmethod
    def of(cls, nodes_rest: Array, scale: float) -> Sizes:
        """Measure a body.

        Parameters
        ----------
        nodes_rest : (21, 3)
            Its nodes in the rest pose, model frame, metres.
        scale : float
            Factor on all lengths.
        """
        at = {name: scale * nodes_rest[i] for name, i in NODE_INDEX.items()}

        def length(start: str, end: str) -> float:
            return float(np.linalg.norm(at[f"left_{end}"] - at[f"left_{start}"]))

        def offset(start: Array, end: Array) -> tuple[float, float]:
            return float((end - start) @ _FORWARD), float((end - start) @ _UP)

        shoulders = 0.5 * (at["left_shoulder"] + at["right_shoulder"])
        return cls(
            torso=offset(0.5 * (at["left_hip"] + at["right_hip"]), shoulders),
            neck=offset(shoulders, at["neck"]),
            head=offset(at["neck"], at["head"]),
            shoulder=0.5 * float((at["left_shoulder"] - at["right_shoulder"]) @ _LEFT),
            hip=0.5 * float((at["left_hip"] - at["right_hip"]) @ _LEFT),
            upper_arm=length("shoulder", "elbow"),
            forearm=length("elbow", "wrist"),
            thigh=length("hip", "knee"),
            shank=length("knee", "ankle"),
        )

    def is_like(self, other: Sizes) -> bool:
        """Whether no length differs by more than `NEW_SIZES`."""
        a, b = (np.hstack([getattr(s, f.name) for f in fields(s)]) for s in (self, other))
        return bool((np.abs(a - b) <= NEW_SIZES * np.maximum(np.abs(a), _RADIUS_M)).all())


@dataclass(frozen=True)
class Posture:
    """Posture in the joint angles of REP-155.

    Attributes
    ----------
    angles : (20,) float64
        Of `JOINTS`, radians.
    frames : (16, 4, 4) float64
        ``T_camera_link`` of `LINKS`, as measured.
    """

    angles: Array
    frames: Array


def posture_of(skeleton: Skeleton, sizes: Sizes) -> Posture:
    """Find the angles of the model's joints, and the frames of its links.

    Parameters
    ----------
    skeleton : Skeleton
        Not lost.
    sizes : Sizes
        Of the same person.
    """
    at = {name: skeleton.positions[i] for name, i in JOINT_INDEX.items()}
    rotations = dict(zip(JOINT_INDEX, quat_to_matrix(skeleton.quats_xyzw), strict=True))
    hips, shoulders = (0.5 * (at[f"left_{n}"] + at[f"right_{n}"]) for n in ("hip", "shoulder"))
    body, chest, head = (rotations[n] @ _AXES for n in ("pelvis", "chest", "head"))
    bend = _pitch(body.T @ (shoulders - hips), sizes.torso)
    torso = body @ _turn(bend)
    angles = [bend, *_head_angles(torso.T @ head)]
    frames = [(body, hips), (torso, hips), (chest, shoulders), (head, at["head"])]
    for _, side, sign in SIDES:
        names = [f"{side}_{n}" for n in ("shoulder", "elbow", "wrist")]
        arm = _limb(at, rotations, names, sign, 1.0)
        names = [f"{side}_{n}" for n in ("hip", "knee", "ankle")]
        leg = _limb(at, rotations, names, sign, -1.0)
        angles += [*_shoulder_angles(torso.T @ arm.upper, sign), arm.bend]
        angles += [*_hip_angles(body.T @ leg.upper, sign), leg.bend]
        frames += [*arm.frames, *leg.frames]
    return Posture(np.array(angles), np.stack([_transform(*f) for f in frames]))


@dataclass(frozen=True)
class _Limb:
    upper: Array
    bend: float
    frames: list[tuple[Array, Array]]


def _limb(
    at: dict[str, Array], rotations: dict[str, Array], names: list[str], sign: float, forward: float
) -> _Limb:
    """Frames of an arm (bends forward) or a leg (backward): -z along the limb, the bend about -y."""
    start, middle, end = (at[n] for n in names)
    up = _unit(start - middle)
    lower = _unit(end - middle)
    hang = HANG[names[0].split("_")[1]]
    hang = hang if sign > 0 else mirror_rotation(hang)
    toward = forward * lower + _STRAIGHT * (rotations[names[0]] @ (hang.T @ _FORWARD))
    x = _unit(toward - (toward @ up) * up)
    upper = np.stack([x, _cross(up, x), up], axis=1)
    bend = float(np.arctan2(lower @ x, -(lower @ up)))
    under = upper @ _turn(-bend)
    return _Limb(upper, bend, [(upper, start), (under, middle), (under, end)])


def _pitch(toward: Array, rest: tuple[float, float]) -> float:
    """Rotation about y from the rest direction (forward, up) to another, seen from the side."""
    return float(np.arctan2(toward[0], toward[2]) - np.arctan2(*rest))


def _head_angles(R: Array) -> tuple[float, float, float]:
    """Roll, yaw and pitch of ``Rx(r) Rz(y) Ry(-p)``."""
    roll = np.arctan2(R[2, 1], R[1, 1])
    yaw = np.arcsin(np.clip(-R[0, 1], -1.0, 1.0))
    return float(roll), float(yaw), float(-np.arctan2(R[0, 2], R[0, 0]))


def _shoulder_angles(R: Array, sign: float) -> tuple[float, float, float]:
    """Return y, p, r of ``Rz(-s y) Rx(s p) Rz(s r)``, where s is the sign of the side; p is not negative."""
    lift = np.arccos(np.clip(R[2, 2], -1.0, 1.0))
    if np.sin(lift) < 1e-6:  # only the sum of the two rotations about the arm is determined
        return 0.0, float(lift), float(sign * np.arctan2(R[1, 0], R[0, 0]))
    first, last = np.arctan2(sign * R[0, 2], -sign * R[1, 2]), np.arctan2(sign * R[2, 0], sign * R[2, 1])
    return float(-sign * first), float(lift), float(sign * last)


def _hip_angles(R: Array, sign: float) -> tuple[float, float, float]:
    """Return y, p and r of ``Rz(-y) Rx(s p) Ry(-r)``."""
    swing = np.arcsin(np.clip(R[2, 1], -1.0, 1.0))
    turn, lift = np.arctan2(-R[0, 1], R[1, 1]), np.arctan2(-R[2, 0], R[2, 2])
    return float(-turn), float(sign * swing), float(-lift)


def _turn(angle: float) -> Array:
    """Rotation about y."""
    return rotation_y(np.array(angle))


def _cross(a: Array, b: Array) -> Array:
    """Cross product; for single vectors ten times as quick as numpy's."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def _unit(vector: Array) -> Array:
    return vector / max(float(np.linalg.norm(vector)), 1e-9)


def _transform(rotation: Array, origin: Array) -> Array:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation, origin
    return T


def make_urdf(body_id: str, sizes: Sizes) -> str:
    """Write the model of a person as URDF; names end in ``_ID``."""
    robot = ElementTree.Element("robot", name=f"human_{body_id}")
    made = _Urdf(robot, body_id)
    s = sizes
    made.link("body")
    made.joint("waist", "body", "waist", (0, 0, 0), (0, 1, 0))
    made.joint("torso", "waist", "torso", (s.torso[0], 0, s.torso[1]))
    made.rod("waist", s.torso[1], up=True)
    made.joint("r_head", "torso", "r_head", (s.neck[0], 0, s.neck[1]), (1, 0, 0))
    made.joint("y_head", "r_head", "y_head", (0, 0, 0), (0, 0, 1))
    made.joint("p_head", "y_head", "p_head", (0, 0, 0), (0, -1, 0))
    made.joint("head", "p_head", "head", (s.head[0], 0, s.head[1]))
    made.ball("head", 0.75 * s.forearm / 2.0)
    for letter, _, sign in SIDES:
        names = [f"{letter}_{n}" for n in ("y_shoulder", "p_shoulder", "r_shoulder", "shoulder")]
        axes = [(0, 0, -sign), (sign, 0, 0), (0, 0, sign)]
        made.ball_joint("torso", names, (0, sign * s.shoulder, 0), axes)
        made.lower(letter, ("shoulder", "elbow", "wrist"), s.upper_arm, s.forearm)
        names = [f"{letter}_{n}" for n in ("y_hip", "p_hip", "r_hip", "hip")]
        axes = [(0, 0, -1), (sign, 0, 0), (0, -1, 0)]
        made.ball_joint("body", names, (0, sign * s.hip, 0), axes)
        made.lower(letter, ("hip", "knee", "ankle"), s.thigh, s.shank)
    ElementTree.indent(robot)
    return '<?xml version="1.0"?>\n' + ElementTree.tostring(robot, encoding="unicode")


class _Urdf:
    """Adds links and joints to a robot."""

    def __init__(self, robot: ElementTree.Element, body_id: str) -> None:
        self._robot, self._id = robot, body_id
        self._links: dict[str, ElementTree.Element] = {}

    def link(self, name: str) -> None:
        self._links[name] = ElementTree.SubElement(self._robot, "link", name=f"{name}_{self._id}")

    def joint(
        self,
        name: str,
        parent: str,
        child: str,
        origin: tuple[float, float, float],
        axis: tuple[float, float, float] | None = None,
    ) -> None:
        """Add a joint that turns about an axis, or a fixed one, and the link beyond it."""
        self.link(child)
        kind = "revolute" if axis else "fixed"
        joint = ElementTree.SubElement(self._robot, "joint", name=f"{name}_{self._id}", type=kind)
        ElementTree.SubElement(joint, "parent", link=f"{parent}_{self._id}")
        ElementTree.SubElement(joint, "child", link=f"{child}_{self._id}")
        ElementTree.SubElement(joint, "origin", xyz=_text(origin), rpy="0 0 0")
        if axis:
            ElementTree.SubElement(joint, "axis", xyz=_text(axis))
            ElementTree.SubElement(
                joint, "limit", lower="-3.1416", upper="3.1416", effort="1000", velocity="20"
            )

    def ball_joint(
        self,
        parent: str,
        names: list[str],
        origin: tuple[float, float, float],
        axes: Sequence[tuple[float, float, float]],
    ) -> None:
        """Add three joints in one place; ``names`` are theirs, and the last link's."""
        links = [parent, *names[:2], names[3]]
        places = [origin, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)]
        for k, axis in enumerate(axes):
            self.joint(names[k], links[k], links[k + 1], places[k], axis)

    def lower(self, letter: str, names: tuple[str, str, str], upper: float, under: float) -> None:
        """Add the links below a shoulder or a hip."""
        first, middle, last = (f"{letter}_{n}" for n in names)
        self.joint(middle, first, middle, (0, 0, -upper), (0, -1, 0))
        self.joint(last, middle, last, (0, 0, -under))
        self.rod(first, upper)
        self.rod(middle, under)

    def rod(self, link: str, length: float, up: bool = False) -> None:
        """Draw a link as a rod from its origin down, or up."""
        shape = self._visual(link, 0.5 * length if up else -0.5 * length)
        ElementTree.SubElement(shape, "cylinder", length=f"{length:.4f}", radius=f"{_RADIUS_M}")

    def ball(self, link: str, radius: float) -> None:
        """Draw a ball about a link's origin."""
        ElementTree.SubElement(self._visual(link, 0.0), "sphere", radius=f"{radius:.4f}")

    def _visual(self, link: str, z: float) -> ElementTree.Element:
        visual = ElementTree.SubElement(self._links[link], "visual")
        ElementTree.SubElement(visual, "origin", xyz=_text((0.0, 0.0, z)), rpy="0 0 0")
        return ElementTree.SubElement(visual, "geometry")


def _text(xyz: tuple[float, float, float]) -> str:
    return " ".join(f"{v:.5g}" for v in xyz)
