"""Reader of Biovision hierarchy files (.bvh): any hierarchy, channels in any order.

The format is described by M. Meredith and S. Maddock, *Motion Capture File Formats Explained*,
University of Sheffield, 2001: a HIERARCHY of ROOT, JOINT and End Site blocks with OFFSET and
CHANNELS, then MOTION with one line of channel values a frame. Rotations are intrinsic, in the
order of the channels, in degrees.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.source_motion import MOST_MOTION_BYTES, SourceMotion, check_motion_size
from depth_pose.core.errors import InputError
from depth_pose.core.reading import read_text
from depth_pose.core.rotations import rotation_x, rotation_y, rotation_z
from depth_pose.motion.clip import Clip

Array = NDArray[np.float64]

_CHANNELS = tuple(f"{axis}{kind}" for kind in ("position", "rotation") for axis in "xyz")
_TURN = {"xrotation": rotation_x, "yrotation": rotation_y, "zrotation": rotation_z}


@dataclass
class _Hierarchy:
    joints: list[str] = field(default_factory=list)
    parents: list[int] = field(default_factory=list)
    offsets: list[list[float]] = field(default_factory=list)
    channels: list[list[str]] = field(default_factory=list)


def read_bvh(path: str | Path) -> Clip:
    """Read a BVH file and retarget its motion to the reference body.

    Parameters
    ----------
    path : path
        The file.

    Returns
    -------
    Clip

    Raises
    ------
    InputError
        If the file is not BVH, is cut off or damaged, or its skeleton is not a person's; the
        message names file and line, or the joint that is missing.
    """
    from depth_pose.motion.retarget import retarget

    return retarget(parse_bvh(path)).clip


def parse_bvh(path: str | Path) -> SourceMotion:
    """Read a BVH file on its own skeleton, in its own units and axes."""
    path = Path(path)
    text = read_text(path, MOST_MOTION_BYTES, errors="replace")
    head, keyword, motion = text.partition("MOTION")
    if not head.lstrip().startswith("HIERARCHY"):
        raise InputError(f"{path}: line 1: not a BVH file, it does not begin with HIERARCHY")
    if not keyword:
        raise InputError(f"{path}: no MOTION section; the file is cut off or not BVH")
    hierarchy = _parse_hierarchy(head, path)
    frames, frame_s, numbers = _parse_motion_head(motion, path, head.count("\n") + 1)
    check_motion_size(path, frames, len(hierarchy.joints))
    values = _parse_values(numbers, frames, sum(map(len, hierarchy.channels)), path)
    return _assemble(path.stem, hierarchy, frame_s, values)


def _parse_hierarchy(head: str, path: Path) -> _Hierarchy:
    out = _Hierarchy()
    stack: list[int] = []
    pending: str | None = None
    for number, line in enumerate(head.splitlines(), start=1):
        words = line.split()
        if not words or words[0] == "HIERARCHY":
            continue
        try:
            pending = _parse_line(words, out, stack, pending)
        except (ValueError, IndexError) as error:
            raise InputError(
                f"{path}: line {number}: {line.strip()!r} is not understood ({error})"
            ) from error
    if stack:
        raise InputError(f"{path}: HIERARCHY: {len(stack)} joints are not closed; the file is damaged")
    if not out.joints:
        raise InputError(f"{path}: HIERARCHY: there are no joints")
    if not np.isfinite(np.array(out.offsets)).all():
        raise InputError(f"{path}: HIERARCHY: an OFFSET is not finite")
    return out


def _parse_line(words: list[str], out: _Hierarchy, stack: list[int], pending: str | None) -> str | None:
    """Parse one line of the hierarchy; return the name of the block that opens next."""
    key = words[0].lower()
    if key in ("root", "joint"):
        if key == "joint" and not stack:
            raise ValueError("a JOINT outside of a ROOT")
        name = " ".join(w for w in words[1:] if w != "{")
        pending = name
        if words[-1] != "{":
            return pending
        key = "{"
    elif key == "end":
        pending = f"{out.joints[stack[-1]]}/end"
        if words[-1] != "{":
            return pending
        key = "{"
    if key == "{":
        if pending is None:
            raise ValueError("a block without a name")
        out.parents.append(stack[-1] if stack else -1)
        out.joints.append(pending)
        out.offsets.append([0.0, 0.0, 0.0])
        out.channels.append([])
        stack.append(len(out.joints) - 1)
    elif key == "}":
        stack.pop()
    elif key == "offset":
        out.offsets[stack[-1]] = [float(w) for w in words[1:4]]
        if len(out.offsets[stack[-1]]) != 3:
            raise ValueError("an OFFSET needs three numbers")
    elif key == "channels":
        names = [w.lower() for w in words[2:]]
        if len(names) != int(words[1]):
            raise ValueError(f"{words[1]} channels are announced, {len(names)} named")
        for name in names:
            if name not in _CHANNELS:
                raise ValueError(f"unknown channel {name}")
        out.channels[stack[-1]] = names
    else:
        raise ValueError(f"unknown keyword {words[0]}")
    return None


def _parse_motion_head(text: str, path: Path, line: int) -> tuple[int, float, str]:
    """Return the number of frames, the seconds between them, and the text of their values."""
    lines = text.strip().split("\n", 2)
    try:
        frames = int(lines[0].split(":")[1])
        frame_s = float(lines[1].split(":")[1])
    except (IndexError, ValueError) as error:
        raise InputError(
            f"{path}: after line {line}: MOTION needs 'Frames: N' and 'Frame Time: S'"
        ) from error
    if frames < 1 or not 0 < frame_s < 10:
        raise InputError(f"{path}: MOTION: {frames} frames of {frame_s} s make no motion")
    return frames, frame_s, lines[2] if len(lines) > 2 else ""


def _parse_values(text: str, frames: int, width: int, path: Path) -> Array:
    if width == 0:
        raise InputError(f"{path}: HIERARCHY: no joint has channels, so nothing moves")
    try:
        values = np.array(text.split(), dtype=np.float64)
    except ValueError as error:
        raise InputError(f"{path}: MOTION: a value is not a number ({error})") from error
    if values.size != frames * width:
        raise InputError(
            f"{path}: MOTION: {frames} frames of {width} channels need {frames * width} values, "
            f"there are {values.size}; the file is cut off or damaged"
        )
    if not np.isfinite(values).all():
        raise InputError(f"{path}: MOTION: there are values that are not finite")
    return values.reshape(frames, width)


def _assemble(name: str, hierarchy: _Hierarchy, frame_s: float, values: Array) -> SourceMotion:
    count = len(hierarchy.joints)
    offsets = np.array(hierarchy.offsets, dtype=np.float64)
    rotations = np.empty((len(values), count, 3, 3))
    root = np.tile(offsets[0], (len(values), 1))
    column = 0
    for j in range(count):
        parent = hierarchy.parents[j]
        rotation = np.broadcast_to(np.eye(3), (len(values), 3, 3))
        if parent >= 0:
            rotation = rotations[:, parent]
        for channel in hierarchy.channels[j]:
            value = values[:, column]
            column += 1
            if channel in _TURN:
                rotation = rotation @ _TURN[channel](np.radians(value))
            elif j == 0:
                # Positions of other joints would stretch bones; files repeat their offsets there.
                root[:, "xyz".index(channel[0])] = value
        rotations[:, j] = rotation
    parents = np.array(hierarchy.parents, dtype=np.int64)
    return SourceMotion(name, 1.0 / frame_s, tuple(hierarchy.joints), parents, offsets, rotations, root)
