"""Write a known motion of the reference body as the files that motion libraries hold."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from depth_pose.core.skeleton import ADULT_STATURE_M, NODE_INDEX, rest_nodes
from depth_pose.motion.clip import Clip

MIXAMO = {
    "pelvis": "Hips", "spine": "Spine", "chest": "Spine1", "neck": "Neck", "head": "Head",
    "clavicle": "Shoulder", "shoulder": "Arm", "elbow": "ForeArm", "wrist": "Hand",
    "hip": "UpLeg", "knee": "Leg", "ankle": "Foot", "foot": "ToeBase",
}  # fmt: skip
BANDAI = MIXAMO | {
    "chest": "Chest", "shoulder": "UpperArm", "elbow": "LowerArm", "hip": "UpperLeg", "knee": "LowerLeg",
    "foot": "Toes",
}  # fmt: skip
BIOVISION = MIXAMO | {
    "chest": "Chest", "clavicle": "Collar", "shoulder": "Shoulder", "elbow": "Elbow", "wrist": "Wrist",
    "hip": "Hip", "knee": "Knee", "ankle": "Ankle", "foot": "Toe",
}  # fmt: skip
ACCLAIM = {
    "pelvis": "root", "spine": "upperback", "chest": "thorax", "neck": "lowerneck", "head": "head",
    "clavicle": "clavicle", "shoulder": "humerus", "elbow": "radius", "wrist": "wrist",
    "hip": "femur", "knee": "tibia", "ankle": "foot", "foot": "toes",
}  # fmt: skip

CHILDREN = {
    "pelvis": ("spine", "left_hip", "right_hip"),
    "spine": ("chest",),
    "chest": ("neck", "left_clavicle", "right_clavicle"),
    "neck": ("head",),
} | {
    f"{side}_{a}": (f"{side}_{b}",)
    for side in ("left", "right")
    for a, b in (("clavicle", "shoulder"), ("shoulder", "elbow"), ("elbow", "wrist"), ("hip", "knee"),
                 ("knee", "ankle"), ("ankle", "foot"))
}  # fmt: skip


def rest_to_t_pose() -> dict[str, np.ndarray]:
    """Rotation of each node's segment from our rest pose to a T pose."""
    turn = {name: np.eye(3) for name in NODE_INDEX}
    for side, angle in (("left", 45), ("right", -45)):
        for part in ("shoulder", "elbow", "wrist"):
            turn[f"{side}_{part}"] = Rotation.from_euler("z", angle, degrees=True).as_matrix()
    return turn


def t_pose_nodes() -> np.ndarray:
    """Node positions of the T pose, metres, (21, 3)."""
    at, turn = rest_nodes() * ADULT_STATURE_M, rest_to_t_pose()
    out = at.copy()
    for parent, children in CHILDREN.items():
        for child in children:
            p, c = NODE_INDEX[parent], NODE_INDEX[child]
            out[c] = out[p] + turn[parent] @ (at[c] - at[p])
    return out


def source_rotations(clip: Clip) -> np.ndarray:
    """Rotations of the T-posed skeleton's segments, (T, 21, 3, 3)."""
    turn = rest_to_t_pose()
    return np.stack([clip.rotations[:, i] @ turn[name].T for name, i in NODE_INDEX.items()], axis=1)


def named(node: str, names: dict[str, str], style: str) -> str:
    """Name of a node in a library's convention; style holds {side} and {part}."""
    side, _, part = node.rpartition("_")
    if not side:
        return names[node]
    return style.format(Side=side.capitalize(), s=side[0], S=side[0].upper(), part=names[part])


def write_bvh(
    path: Path,
    clip: Clip,
    names: dict[str, str] = MIXAMO,
    style: str = "{Side}{part}",
    order: str = "ZXY",
    unit: float = 0.01,
    axes: np.ndarray | None = None,
) -> Path:
    """Write a clip as BVH in some convention of names, channel order, unit and world axes."""
    axes = np.eye(3) if axes is None else axes
    nodes, turns = t_pose_nodes() @ axes.T / unit, axes @ source_rotations(clip) @ axes.T
    lines, columns = ["HIERARCHY"], []

    def block(node: str, parent: str | None, depth: int) -> None:
        pad, i = "  " * depth, NODE_INDEX[node]
        offset = nodes[i] - (nodes[NODE_INDEX[parent]] if parent else nodes[i])
        lines.append(f"{pad}{'JOINT' if parent else 'ROOT'} {named(node, names, style)}")
        lines.append(f"{pad}{{")
        lines.append(f"{pad}  OFFSET {offset[0]:.7f} {offset[1]:.7f} {offset[2]:.7f}")
        rotations = " ".join(f"{axis}rotation" for axis in order)
        prefix = "CHANNELS 3" if parent else "CHANNELS 6 Xposition Yposition Zposition"
        lines.append(f"{pad}  {prefix} {rotations}")
        local = (
            turns[:, i] if parent is None else turns[:, NODE_INDEX[parent]].transpose(0, 2, 1) @ turns[:, i]
        )
        if parent is None:
            columns.append(clip.roots @ axes.T / unit)
        columns.append(Rotation.from_matrix(local).as_euler(order, degrees=True))
        for child in CHILDREN.get(node, ()):
            block(child, node, depth + 1)
        if node not in CHILDREN:
            lines.extend([f"{pad}  End Site", f"{pad}  {{", f"{pad}    OFFSET 0 0 1", f"{pad}  }}"])
        lines.append(f"{pad}}}")

    block("pelvis", None, 0)
    lines += ["MOTION", f"Frames: {len(clip)}", f"Frame Time: {1 / clip.fps:.7f}"]
    lines += [" ".join(f"{v:.6f}" for v in row) for row in np.concatenate(columns, axis=1)]
    path.write_text("\n".join(lines) + "\n")
    return path


def write_asf_amc(folder: Path, clip: Clip, seed: int = 0) -> tuple[Path, Path]:
    """Write a clip as Acclaim files, in inches, with an axis frame of its own for every bone."""
    rng = np.random.default_rng(seed)
    nodes, turns = t_pose_nodes() / 0.0254, source_rotations(clip)
    bones, hierarchy, poses = [], [], {}

    def name(node: str) -> str:
        return named(node, ACCLAIM, "{s}{part}")

    def bone(label: str, start: str, offset: np.ndarray, rotation: np.ndarray | None) -> None:
        length = float(np.linalg.norm(offset))
        direction = offset / length if length else np.array([0.0, 1.0, 0.0])
        axis = rng.uniform(-90, 90, 3)
        c = Rotation.from_euler("xyz", axis, degrees=True).as_matrix()
        text = [f"  begin\n     id {len(bones) + 1}\n     name {label}"]
        text.append(
            "     direction " + " ".join(f"{v:.9f}" for v in direction) + f"\n     length {length:.9f}"
        )
        text.append("     axis " + " ".join(f"{v:.9f}" for v in axis) + "  XYZ")
        if rotation is not None:
            text.append(
                "    dof rx ry rz\n    limits (-180 180)\n           (-180 180)\n           (-180 180)"
            )
            poses[label] = Rotation.from_matrix(c.T @ rotation @ c).as_euler("xyz", degrees=True)
        bones.append("\n".join([*text, "  end"]))

    def walk(node: str, owner: str) -> None:
        """A node's bone runs to its first child; further children hang on fixed bones."""
        i = NODE_INDEX[node]
        children = CHILDREN.get(node, ())
        for k, child in enumerate(children):
            offset = nodes[NODE_INDEX[child]] - nodes[i]
            if node in ("pelvis", "chest"):
                label = f"{child}joint"
                hierarchy.append(f"{owner} {label}")
                bone(label, owner, offset, None)
                hang(child, label, i)
            else:
                assert k == 0
                hang(child, owner, i)

    def hang(child: str, owner: str, parent: int) -> None:
        j = NODE_INDEX[child]
        local = turns[:, parent].transpose(0, 2, 1) @ turns[:, j]
        kids = CHILDREN.get(child, ())
        single = len(kids) == 1
        offset = (
            nodes[NODE_INDEX[kids[0]]] - nodes[j]
            if single
            else np.zeros(3)
            if kids
            else np.array([0, 0, 1.0])
        )
        hierarchy.append(f"{owner} {name(child)}")
        bone(name(child), owner, offset, local)
        walk(child, name(child))

    walk("pelvis", "root")
    asf, amc = folder / "07.asf", folder / "07_01.amc"
    asf.write_text(
        ":version 1.10\n:name test\n:units\n  mass 1.0\n  length 1.0\n  angle deg\n:root\n"
        "   order TX TY TZ RX RY RZ\n   axis XYZ\n   position 0 0 0\n   orientation 0 0 0\n:bonedata\n"
        + "\n".join(bones)
        + "\n:hierarchy\n  begin\n    "
        + "\n    ".join(hierarchy)
        + "\n  end\n"
    )
    root = np.concatenate(
        [clip.roots / 0.0254, Rotation.from_matrix(turns[:, 0]).as_euler("xyz", degrees=True)], axis=1
    )
    lines = ["#!OML:ASF test", ":FULLY-SPECIFIED", ":DEGREES"]
    for t in range(len(clip)):
        lines += [str(t + 1), "root " + " ".join(f"{v:.7f}" for v in root[t])]
        lines += [f"{label} " + " ".join(f"{v:.7f}" for v in rows[t]) for label, rows in poses.items()]
    amc.write_text("\n".join(lines) + "\n")
    return asf, amc
