"""Truth files: true joints of one person or several.

A file is an ``.npz`` with ``names`` (J,), ``stamps_ns`` (T,), ``joints`` and ``seen``. For one person
``joints`` is (T, J, 3) and ``seen`` (T, J). For several they are (T, P, J, 3) and (T, P, J), and
``visible`` (T, P) is the visible share of each person. A file with ``T_camera_world`` is of several cameras
(`depth_pose.sim.room_recordings`): its joints are in the room's frame.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.arrays import DamagedArrays, load_arrays
from depth_pose.core.errors import InputError
from depth_pose.core.skeleton import JOINT_INDEX
from depth_pose.rooms.rig import ROOM_FRAME

STAMP_TOLERANCE_NS = 2_000_000
"""Maximum difference between the stamps of a frame and its skeletons."""

_FIELDS = ("joints", "names", "stamps_ns", "seen")
_ROOM_FIELD = "T_camera_world"

_TORSO = ("pelvis", "neck", "left_shoulder", "right_shoulder", "left_hip", "right_hip")
"""Joints that define a person's own axes for offsets."""


@dataclass(frozen=True)
class KnownJoints:
    """The truth about one person.

    Attributes
    ----------
    joints : (T, J, 3) float64
        Optical frame, metres.
    names : tuple of str
        The J joints.
    stamps_ns : (T,) int64
    seen : (T, J) bool
    """

    joints: NDArray[np.float64]
    names: tuple[str, ...]
    stamps_ns: NDArray[np.int64]
    seen: NDArray[np.bool_]


@dataclass(frozen=True)
class KnownPeople:
    """The truth about all people.

    Attributes
    ----------
    joints : (T, P, J, 3) float64
        Optical frame, or the room's, metres.
    names : tuple of str
        The J joints.
    stamps_ns : (T,) int64
    visible : (T, P) float64
        Share of each person that is in the image and not hidden.
    is_room : bool
        Whether the joints are in a room's frame.
    """

    joints: NDArray[np.float64]
    names: tuple[str, ...]
    stamps_ns: NDArray[np.int64]
    visible: NDArray[np.float64]
    is_room: bool = False


def load_truth(path: Path | str) -> KnownJoints:
    """Read a truth file of one person.

    Raises
    ------
    InputError
        Where it is missing, lacks a field, or holds several people.
    """
    fields, names = _read(path)
    joints = fields["joints"]
    if joints.ndim == 4:
        raise InputError(f"{path} has {joints.shape[1]} people; the truth must be of one person here")
    if lacking := [name for name in _TORSO if name not in names]:
        raise InputError(f"{path} has no {', '.join(lacking)}, which define the torso's axes")
    return KnownJoints(
        joints.astype(np.float64), names, fields["stamps_ns"].astype(np.int64), fields["seen"].astype(bool)
    )


def load_known_people(path: Path | str) -> KnownPeople:
    """Read a truth file of several people, or of one person, who is assumed visible throughout.

    Raises
    ------
    InputError
        Where it is missing or lacks a field.
    """
    fields, names = _read(path)
    joints = fields["joints"].astype(np.float64)
    if joints.ndim == 3:
        joints = joints[:, None]
    visible = fields.get("visible", np.ones(joints.shape[:2])).astype(np.float64)
    stamps_ns = fields["stamps_ns"].astype(np.int64)
    return KnownPeople(joints, names, stamps_ns, visible, _ROOM_FIELD in fields)


def tells_of_people(path: Path | str) -> bool:
    """Whether a truth file, or the first of a folder, has the form for several people."""
    files = sorted(Path(path).glob("*.npz")) if Path(path).is_dir() else [Path(path)]
    return bool(files) and _read(files[0])[0]["joints"].ndim == 4


def require_camera_frame(path: Path | str, frame_id: str) -> None:
    """Raise InputError for skeletons in a room's frame."""
    if frame_id == ROOM_FRAME:
        raise InputError(
            f"{path} is in a room's frame, and the truth in a camera's: skeletons of `run --rig` are scored "
            "against truths of `simulate --cameras`"
        )


def pair_files(truth: Path, predicted: Path) -> list[tuple[Path, Path]]:
    """Pair truth files with recordings of skeletons.

    Parameters
    ----------
    truth : Path
        A truth file, or a folder of them.
    predicted : Path
        A recording, or a folder with ``NAME.mcap`` for every ``NAME.npz``; some may be missing.

    Raises
    ------
    InputError
        Where there is no truth, or no recording at all.
    """
    if truth.is_dir():
        files = sorted(truth.glob("*.npz"))
        if not files:
            raise InputError(f"{truth} has no truth files (*.npz)")
        if predicted.is_file():
            raise InputError(f"{truth} is a folder, so {predicted} must be one too")
        pairs = [(file, predicted / f"{file.stem}.mcap") for file in files]
    else:
        pairs = [(truth, predicted / f"{truth.stem}.mcap" if predicted.is_dir() else predicted)]
    if not any(recording.exists() for _, recording in pairs):
        raise InputError(f"{predicted} has no recording for {', '.join(t.stem for t, _ in pairs)}")
    return pairs


def _read(path: Path | str) -> tuple[dict[str, NDArray[np.generic]], tuple[str, ...]]:
    """Read and check the arrays of a file, and the joints' names."""
    try:
        fields = load_arrays(path, (*_FIELDS, "visible", _ROOM_FIELD))
    except DamagedArrays as error:
        raise InputError(f"{path} cannot be read as a truth file: {error}") from error
    missing = [name for name in _FIELDS if name not in fields]
    if missing:
        raise InputError(f"{path} is not a truth file: it has no {', '.join(missing)}")
    for name, array in fields.items():
        kinds = "U" if name == "names" else "iu" if name == "stamps_ns" else "biuf"
        if array.dtype.kind not in kinds or (array.ndim != 1 and name in ("names", "stamps_ns")):
            raise InputError(f"{path} is not a truth file: {name} is {array.dtype}{list(array.shape)}")
    names = tuple(str(name) for name in fields.pop("names"))
    unknown = [name for name in names if name not in JOINT_INDEX]
    if unknown:
        raise InputError(f"{path} is not a truth file: no joint is called {unknown[0]!r}")
    if not names:
        raise InputError(f"{path} is not a truth file: it names no joint")
    if not len(fields["stamps_ns"]):
        raise InputError(f"{path} is not a truth file: it has no frames")
    _check_shapes(path, fields, names)
    return fields, names


def _check_shapes(path: Path | str, fields: dict[str, NDArray[np.generic]], names: tuple[str, ...]) -> None:
    joints, seen, frames = fields["joints"], fields["seen"], len(fields["stamps_ns"])
    people = joints.shape[1:2] if joints.ndim == 4 else ()
    if joints.shape != (frames, *people, len(names), 3) or seen.shape != joints.shape[:-1]:
        raise InputError(
            f"{path}: joints {joints.shape} and seen {seen.shape} do not fit "
            f"{frames} stamps and {len(names)} names"
        )
    if people and "visible" not in fields:
        raise InputError(f"{path} is not a truth file: for several people it must have visible")
    if people and fields["visible"].shape != (frames, *people):
        raise InputError(f"{path}: visible {fields['visible'].shape} does not fit joints {joints.shape}")
