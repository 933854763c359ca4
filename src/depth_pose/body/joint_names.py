"""Identify the joints of a recorded skeleton by name patterns and by the shape of the tree."""

from __future__ import annotations

import re

import numpy as np

from depth_pose.body.source_motion import SourceMotion
from depth_pose.core.errors import InputError

_PARTS = {
    "elbow": ("forearm", "lowerarm", "lowarm", "elbow", "radius"),
    "wrist": ("wrist", "hand"),
    "knee": ("leg", "lowerleg", "lowleg", "calf", "shin", "knee", "tibia"),
    "ankle": ("foot", "ankle"),
    "toe": ("toebase", "toes", "toe", "ball", "toe0", "toeend"),
}
"""Names, without their side, of the joints at which each segment begins."""

_PREFIX = re.compile(r"^(mixamorig\d*|bip\d*|biped\d*|character\d*|.*:)[:_ ]?", re.IGNORECASE)
_SIDES = (
    ("left", re.compile(r"^left(.*)$|^(.*)left$|^l(?:_|\.|-| )(.*)$|^(.*)(?:_|\.|-| )l$")),
    ("right", re.compile(r"^right(.*)$|^(.*)right$|^r(?:_|\.|-| )(.*)$|^(.*)(?:_|\.|-| )r$")),
)
_SHORT = re.compile(r"^([lr])([a-z]+)$")


def split_name(name: str) -> tuple[str, str]:
    """Return a joint's side ('left', 'right' or '') and its bare lower-case name."""
    bare = _PREFIX.sub("", name.strip()).lower() or name.lower()
    bare = re.sub(r"^_+|_+$", "", bare)
    for side, pattern in _SIDES:
        found = pattern.match(bare)
        if found:
            rest = next(group for group in found.groups() if group is not None)
            return side, re.sub(r"[^a-z0-9]", "", rest)
    flat = re.sub(r"[^a-z0-9]", "", bare)
    short = _SHORT.match(flat)
    known = {part for parts in _PARTS.values() for part in parts} | {"femur", "humerus", "clavicle", "thigh"}
    if short and short.group(2) in known:
        return {"l": "left", "r": "right"}[short.group(1)], short.group(2)
    return "", flat


def _ancestors(source: SourceMotion, joint: int) -> list[int]:
    out = [joint]
    while source.parents[out[-1]] >= 0:
        out.append(int(source.parents[out[-1]]))
    return out


def _parent_apart(source: SourceMotion, joint: int) -> int:
    """Nearest ancestor at another position (twist joints in between are skipped)."""
    size = np.linalg.norm(source.offsets, axis=1).max()
    child = joint
    while source.parents[child] >= 0:
        apart = np.linalg.norm(source.offsets[child]) > 0.02 * size
        child = int(source.parents[child])
        if apart and not re.search("twist|roll", source.joints[child].lower()):
            return child
    return child


def _common(source: SourceMotion, a: int, b: int) -> int:
    others = set(_ancestors(source, b))
    for j in _ancestors(source, a):
        if j in others:
            return j
    raise InputError(f"{source.name}: {source.joints[a]} and {source.joints[b]} hang on no common joint")


def _child(source: SourceMotion, joint: int) -> int | None:
    """Descendant at which the joint's segment ends, if the file has one."""
    for j in range(joint + 1, len(source.joints)):
        if source.parents[j] == joint and np.linalg.norm(source.offsets[j]) > 1e-6:
            return j
    return None


def find_joints(source: SourceMotion) -> dict[str, int]:
    """Find the joints that retargeting needs.

    Parameters
    ----------
    source : SourceMotion

    Returns
    -------
    dict
        Row of each of: pelvis, chest, head, left_/right_ shoulder, elbow, wrist, hip, knee,
        ankle; and, where the file has them, toe, clavicle.

    Raises
    ------
    InputError
        Naming the joint that was not found and the names that there are.
    """
    names = [split_name(name) for name in source.joints]
    found: dict[str, int] = {}
    for side in ("left", "right"):
        for part, patterns in _PARTS.items():
            rows = [names.index((side, p)) for p in patterns if (side, p) in names]
            if rows:
                found[f"{side}_{part}"] = rows[0]
            elif part != "toe":
                raise InputError(
                    f"{source.name}: no joint for the {side} {part} (looked for {', '.join(patterns)}); "
                    f"there are {', '.join(n for n in source.joints if not n.endswith('/end'))[:300]}"
                )
        found[f"{side}_shoulder"] = _parent_apart(source, found[f"{side}_elbow"])
        found[f"{side}_hip"] = _parent_apart(source, found[f"{side}_knee"])
        clavicle = int(source.parents[found[f"{side}_shoulder"]])
        if clavicle >= 0 and names[clavicle][0] == side:
            found[f"{side}_clavicle"] = clavicle
        toe = _child(source, found[f"{side}_ankle"])
        if f"{side}_toe" not in found and toe is not None:
            found[f"{side}_toe"] = toe
    found["pelvis"] = _common(source, found["left_hip"], found["right_hip"])
    found["chest"] = _common(source, found["left_shoulder"], found["right_shoulder"])
    heads = [j for j, (side, bare) in enumerate(names) if not side and bare == "head"]
    if not heads:
        raise InputError(f"{source.name}: no joint called Head")
    found["head"] = heads[0]
    return found


def joints_between(source: SourceMotion, below: int, above: int) -> list[int]:
    """Rows of the joints strictly between one (the pelvis) and another above it (the chest)."""
    chain = _ancestors(source, above)
    if below not in chain:
        return []
    return chain[1 : chain.index(below)][::-1]
