"""Reader of Acclaim motion capture: a skeleton (.asf) and its motions (.amc).

The format is described by M. Meredith and S. Maddock, *Motion Capture File Formats Explained*,
University of Sheffield, 2001, and by J. Lander, *Working with Motion Capture File Formats*, Game
Developer, January 1998. A bone has a direction and length in the rest pose and an axis frame C
in which its degrees of freedom turn it: its segment's rotation is its parent's times ``C M C^-1``.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
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

AMC_FPS = 120.0
"""Rate assumed for .amc files, which do not store it: that of the CMU library."""

_TURN = {"x": rotation_x, "y": rotation_y, "z": rotation_z}


@dataclass
class _Bone:
    direction: Array = field(default_factory=lambda: np.zeros(3))
    length: float = 0.0
    axis: Array = field(default_factory=lambda: np.eye(3))
    dof: tuple[str, ...] = ()
    parent: str = ""


@dataclass
class _Skeleton:
    bones: dict[str, _Bone]
    root_order: tuple[str, ...]
    degrees: bool


def read_asf_amc(asf: str | Path, amc: str | Path) -> Clip:
    """Read an Acclaim motion and retarget it to the reference body.

    Parameters
    ----------
    asf, amc : path
        Skeleton and motion.

    Raises
    ------
    InputError
        If a file is damaged or they do not belong together; the message names file and line.
    """
    from depth_pose.motion.retarget import retarget

    return retarget(parse_asf_amc(asf, amc)).clip


def find_skeleton(amc: Path) -> Path:
    """Find the skeleton of a motion in its folder: ``07.asf`` for ``07_01.amc``, or the only one."""
    there = sorted(amc.parent.glob("*.[aA][sS][fF]"))
    fitting = [asf for asf in there if amc.stem == asf.stem or amc.stem.startswith(asf.stem + "_")]
    candidates = fitting or there
    if len(candidates) != 1:
        raise InputError(f"{amc}: needs its skeleton, one .asf beside it; found {len(candidates)}")
    return candidates[0]


def parse_asf_amc(asf: str | Path, amc: str | Path) -> SourceMotion:
    """Read an Acclaim motion on its own skeleton, in its own units and axes."""
    skeleton = _parse_asf(Path(asf))
    frames = _parse_amc(Path(amc), skeleton)
    check_motion_size(amc, len(frames["root"]), 2 * len(skeleton.bones))
    return _assemble(Path(amc).stem, skeleton, frames)


def _lines(path: Path) -> Iterator[tuple[int, list[str]]]:
    text = read_text(path, MOST_MOTION_BYTES, errors="replace")
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.split("#")[0].replace("(", " ").replace(")", " ").split()
        if words:
            yield number, words


def _parse_asf(path: Path) -> _Skeleton:
    skeleton = _Skeleton({"root": _Bone()}, ("tx", "ty", "tz", "rx", "ry", "rz"), degrees=True)
    parser = _AsfParser(skeleton)
    for number, words in _lines(path):
        try:
            parser.take(words)
        except (ValueError, IndexError, KeyError) as error:  # noqa: PERF203
            raise InputError(
                f"{path}: line {number}: {' '.join(words)!r} is not understood ({error})"
            ) from error
    loose = [n for n, b in skeleton.bones.items() if n != "root" and b.parent not in skeleton.bones]
    if len(skeleton.bones) < 2 or loose:
        raise InputError(f"{path}: not a complete skeleton; bones outside of the hierarchy: {loose[:5]}")
    for name, bone in skeleton.bones.items():
        if not np.isfinite([*bone.direction, bone.length, *bone.axis.ravel()]).all():
            raise InputError(f"{path}: the bone {name!r:.80} has a value that is not finite")
    return skeleton


class _AsfParser:
    """Takes the lines of an .asf file one by one."""

    def __init__(self, skeleton: _Skeleton) -> None:
        self.skeleton = skeleton
        self.section, self.bone, self.name = "", _Bone(), ""

    def take(self, words: list[str]) -> None:
        """Parse one line; raise ValueError, IndexError or KeyError if it makes no sense."""
        if words[0].startswith(":"):
            self.section = words[0].lower()
        elif self.section == ":units" and words[0].lower() == "angle":
            self.skeleton.degrees = words[1].lower().startswith("deg")
        elif self.section == ":root":
            _root_line(words, self.skeleton)
        elif self.section == ":bonedata":
            self._bonedata(words)
        elif self.section == ":hierarchy" and words[0] not in ("begin", "end"):
            for child in words[1:]:
                self.skeleton.bones[child].parent = words[0]

    def _bonedata(self, words: list[str]) -> None:
        if words[0] == "begin":
            self.bone, self.name = _Bone(), ""
        elif words[0] == "name":
            self.name = words[1]
        elif words[0] == "end":
            self.skeleton.bones[self.name] = self.bone
        else:
            _bone_line(words, self.bone, self.skeleton.degrees)


def _root_line(words: list[str], skeleton: _Skeleton) -> None:
    if words[0].lower() == "order":
        skeleton.root_order = tuple(w.lower() for w in words[1:])
        if len(words) != 7 or set(skeleton.root_order) != {"tx", "ty", "tz", "rx", "ry", "rz"}:
            raise ValueError("the root's order is to name tx, ty, tz, rx, ry, rz")
    elif words[0].lower() == "orientation" and any(float(w) for w in words[1:4]):
        # Every frame stores the root's orientation; files with a rotated rest pose besides are not in use.
        raise ValueError("a root orientation other than zero is not supported")


def _bone_line(words: list[str], bone: _Bone, degrees: bool) -> None:
    key = words[0].lower()
    if key == "direction":
        bone.direction = np.array([float(words[k]) for k in (1, 2, 3)])
    elif key == "length":
        bone.length = float(words[1])
    elif key == "axis":
        order = words[4].lower() if len(words) > 4 else "xyz"
        bone.axis = _compose(order, np.array([[float(words[k]) for k in (1, 2, 3)]]), degrees)[0]
    elif key == "dof":
        bone.dof = tuple(w.lower() for w in words[1:])


def _compose(order: str, values: Array, degrees: bool) -> Array:
    """Return the rotation about fixed axes in the given order: the last letter is the leftmost factor."""
    out = np.broadcast_to(np.eye(3), (len(values), 3, 3))
    for i, axis in enumerate(order):
        out = _TURN[axis](np.radians(values[:, i]) if degrees else values[:, i]) @ out
    return np.asarray(out)


def _parse_amc(path: Path, skeleton: _Skeleton) -> dict[str, Array]:
    values: dict[str, list[list[float]]] = {name: [] for name, b in skeleton.bones.items() if b.dof}
    values["root"] = []
    frames = 0
    for number, words in _lines(path):
        if words[0].startswith(":"):
            continue
        if re.fullmatch(r"\d+", words[0]) and len(words) == 1:
            frames += 1
            continue
        name = words[0]
        wanted = len(skeleton.root_order if name == "root" else skeleton.bones.get(name, _Bone()).dof)
        if name not in values or len(words) != wanted + 1:
            raise InputError(
                f"{path}: line {number}: {name!r} with {len(words) - 1} values is not of this skeleton"
            )
        try:
            values[name].append([float(w) for w in words[1:]])
        except ValueError as error:
            raise InputError(f"{path}: line {number}: a value is not a number ({error})") from error
    short = [name for name, rows in values.items() if len(rows) != frames]
    if frames == 0 or short:
        raise InputError(
            f"{path}: {frames} frames, incomplete for {short[:5]}; the file is cut off or damaged"
        )
    frames_of = {name: np.array(rows) for name, rows in values.items()}
    for name, rows in frames_of.items():
        if not np.isfinite(rows).all():
            raise InputError(f"{path}: {name!r:.80} has values that are not finite")
    return frames_of


def _assemble(name: str, skeleton: _Skeleton, frames: dict[str, Array]) -> SourceMotion:
    order = _ordered(skeleton)
    count = len(frames["root"])
    leaves = [n for n in order if n != "root" and not any(b.parent == n for b in skeleton.bones.values())]
    names = [*order, *(f"{n}/end" for n in leaves)]
    parents = [-1 if n == "root" else order.index(skeleton.bones[n].parent) for n in order]
    offsets = [skeleton.bones[order[p]].direction * skeleton.bones[order[p]].length if p >= 0 else np.zeros(3)
               for p in parents]  # fmt: skip
    rotations = np.empty((count, len(names), 3, 3))
    column = {key: i for i, key in enumerate(skeleton.root_order)}
    root = frames["root"][:, [column["tx"], column["ty"], column["tz"]]]
    turns = [key for key in skeleton.root_order if key.startswith("r")]
    rotations[:, 0] = _compose(
        "".join(key[1] for key in turns), frames["root"][:, [column[key] for key in turns]], skeleton.degrees
    )
    for j, bone_name in enumerate(order[1:], start=1):
        bone = skeleton.bones[bone_name]
        rotation = rotations[:, parents[j]]
        axes = "".join(key[1] for key in bone.dof if key in ("rx", "ry", "rz"))
        if axes:
            picked = [i for i, key in enumerate(bone.dof) if key in ("rx", "ry", "rz")]
            moved = _compose(axes, frames[bone_name][:, picked], skeleton.degrees)
            rotation = rotation @ bone.axis @ moved @ bone.axis.T
        rotations[:, j] = rotation
    for k, leaf in enumerate(leaves):
        j = order.index(leaf)
        parents.append(j)
        offsets.append(skeleton.bones[leaf].direction * skeleton.bones[leaf].length)
        rotations[:, len(order) + k] = rotations[:, j]
    return SourceMotion(name, AMC_FPS, tuple(names), np.array(parents), np.array(offsets), rotations, root)


def _ordered(skeleton: _Skeleton) -> list[str]:
    """Bones with parents before children."""
    out = ["root"]
    for name in out:
        out.extend(n for n, b in skeleton.bones.items() if n != "root" and b.parent == name)
    return out
