"""One person's motion as arrays over all frames from the first to the last, gaps included."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.errors import InputError
from depth_pose.core.result import BUILD_SIZE, Skeleton
from depth_pose.core.rotations import matrix_to_quat, quat_to_matrix, slerp
from depth_pose.core.skeleton import JOINTS, JointState, Source
from depth_pose.io.messages import SkeletonsMessage
from depth_pose.io.schemas import PEOPLE_TOPIC
from depth_pose.io.skeleton_read import read_people

Array = NDArray[np.float64]

ARRAYS = (
    "present",
    "positions",
    "quats_xyzw",
    "joint_confidence",
    "joint_states",
    "confidence",
    "residual",
    "scale",
    "source",
    "build",
    "covariances",
)
"""Names of a track's arrays over frames, besides the stamps."""

_LONGEST_STEP = 1.5
"""Multiple of the usual time between frames beyond which there is a gap. A missing frame doubles the time;
jitter of stamps stays below a half."""
MOST_FRAMES = 2_000_000
"""Limits: frames in a resampled file, and frames x people in an array export (18 h at 30 Hz, 2 kB each)."""

_MOST_TOLD = 3
"""Maximum number of gaps listed one by one."""
_ON_GRID = 0.02
"""Tolerance of a frame's stamp against an even rate, as a share of the time between frames: at 30 frames a
second it is 0.7 ms, in which a hand at 6 m/s moves 4 mm."""


@dataclass(frozen=True)
class Presence:
    """When one person is there; T frames from the person's first to the last.

    Attributes
    ----------
    body_id : str
    frame_id : str
        Name of the frame that positions are in.
    stamps_ns : (T,) int64
    present : (T,) bool
        Whether the frame has the person.
    """

    body_id: str
    frame_id: str
    stamps_ns: NDArray[np.int64]
    present: NDArray[np.bool_]

    def __len__(self) -> int:
        """Return the number of frames, gaps included."""
        return len(self.stamps_ns)

    @property
    def seconds(self) -> float:
        """Time from the first frame to the last."""
        return float(self.stamps_ns[-1] - self.stamps_ns[0]) * 1e-9

    def gaps(self) -> list[tuple[int, int]]:
        """Return the gaps: first frame, and the frame after the last."""
        edges = np.flatnonzero(np.diff(self.present.astype(np.int8)))
        return [(int(a) + 1, int(b) + 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]


@dataclass(frozen=True)
class Track(Presence):
    """One person over time; in frames without the person values are NaN, states LOST.

    Attributes
    ----------
    positions : (T, 19, 3) float64
        Metres.
    quats_xyzw : (T, 19, 4) float64
        Rotation of each joint's segment from the rest pose.
    joint_confidence : (T, 19) float32
    joint_states : (T, 19) uint8
        `depth_pose.core.skeleton.JointState` values.
    confidence, residual, scale : (T,) float32
        As in `depth_pose.core.result.Skeleton`.
    source : (T,) uint8
        `depth_pose.core.skeleton.Source` values; LOST in gaps.
    build : (T, 13) float32
        Proportions; NaN where they are not known.
    covariances : (T, 19, 3, 3) float16
        Of the positions, square metres; NaN where they are not known.
    """

    positions: Array
    quats_xyzw: Array
    joint_confidence: NDArray[np.float32]
    joint_states: NDArray[np.uint8]
    confidence: NDArray[np.float32]
    residual: NDArray[np.float32]
    scale: NDArray[np.float32]
    source: NDArray[np.uint8]
    build: NDArray[np.float32]
    covariances: NDArray[np.float16]


@dataclass(frozen=True)
class Tracks:
    """All people in a recording.

    Attributes
    ----------
    stamps_ns : (T,) int64
        All answered frames, including those without people.
    frame_id : str
    people : tuple of Track
        In order of appearance.
    """

    stamps_ns: NDArray[np.int64]
    frame_id: str
    people: tuple[Track, ...]


def read_tracks(path: Path | str, topic: str = PEOPLE_TOPIC) -> Tracks:
    """Read all people's motion from a recording of skeletons.

    Raises
    ------
    InputError
        Where the recording has no skeletons on the topic, or one frame has two of the same id.
    """
    frame_id, frames = "", {}
    for message in read_frames(path, topic):
        frame_id = frame_id or message.frame_id
        frames[message.stamp_ns] = message.skeletons
    return tracks_of(frames, frame_id)


def read_frames(path: Path | str, topic: str = PEOPLE_TOPIC) -> Iterator[SkeletonsMessage]:
    """Yield the frames of a recording of skeletons, at least one.

    Raises
    ------
    InputError
        As of `read_tracks`.
    """
    is_empty = True
    for message in read_people(path, topic):
        is_empty = False
        who = Counter(skeleton.body_id for skeleton in message.skeletons)
        if who and max(who.values()) > 1:
            twice = who.most_common(1)[0][0]
            raise InputError(f"{path}: two skeletons of {message.stamp_ns} ns have the id {twice!r}")
        yield message
    if is_empty:
        raise InputError(f"{path} has no messages on {topic}")


def tracks_of(frames: Mapping[int, Sequence[Skeleton]], frame_id: str) -> Tracks:
    """Sort frames, at least one, by people; ``frames`` has all skeletons by stamp."""
    stamps_ns = np.array(sorted(frames), np.int64)
    seen: dict[str, dict[int, Skeleton]] = {}
    for i, stamp in enumerate(stamps_ns):
        for skeleton in frames[int(stamp)]:
            if not skeleton.is_lost:
                seen.setdefault(skeleton.body_id, {})[i] = skeleton
    people = tuple(_track(who, shown, stamps_ns) for who, shown in seen.items())
    return Tracks(stamps_ns, frame_id, people)


def chosen(tracks: Tracks, people: Sequence[str], source: Path | str) -> Tracks:
    """Select people by ``body_id``, all if none are named; ``source`` is named in errors.

    Raises
    ------
    InputError
        Where one of them, or anybody, is missing.
    """
    check_chosen([track.body_id for track in tracks.people], people, source, len(tracks.stamps_ns))
    return replace(tracks, people=tuple(t for t in tracks.people if not people or t.body_id in people))


def check_chosen(known: Sequence[str], people: Sequence[str], source: Path | str, frames: int) -> None:
    """Check that a recording of ``frames`` with the people ``known`` has those that are chosen.

    Raises
    ------
    InputError
        As of `chosen`.
    """
    missing = [who for who in people if who not in known]
    if missing:
        raise InputError(
            f"{source} has nobody with the id {missing[0]}; it has {', '.join(known) or 'nobody'}"
        )
    if not known:
        raise InputError(f"{source} shows nobody in {frames} frames; there is nothing to write")


def _track(body_id: str, frames: dict[int, Skeleton], stamps_ns: NDArray[np.int64]) -> Track:
    first, last = min(frames), max(frames)
    track = _empty(body_id, next(iter(frames.values())).frame_id, stamps_ns[first : last + 1])
    for i, skeleton in frames.items():
        at = i - first
        track.present[at] = True
        track.positions[at] = skeleton.positions
        track.quats_xyzw[at] = skeleton.quats_xyzw
        track.joint_confidence[at] = skeleton.joint_confidence
        track.joint_states[at] = skeleton.joint_states
        track.confidence[at], track.residual[at] = skeleton.confidence, skeleton.residual
        track.scale[at], track.source[at] = skeleton.scale, int(skeleton.source)
        if skeleton.build.size:
            track.build[at] = skeleton.build
        if skeleton.covariances.size:
            track.covariances[at] = skeleton.covariances
    return track


def _empty(body_id: str, frame_id: str, stamps_ns: NDArray[np.int64]) -> Track:
    count, joints = len(stamps_ns), len(JOINTS)
    nothing = np.full(count, np.nan, np.float32)
    return Track(
        body_id,
        frame_id,
        stamps_ns,
        np.zeros(count, np.bool_),
        np.full((count, joints, 3), np.nan),
        np.full((count, joints, 4), np.nan),
        np.full((count, joints), np.nan, np.float32),
        np.full((count, joints), JointState.LOST, np.uint8),
        nothing,
        nothing.copy(),
        nothing.copy(),
        np.full(count, Source.LOST, np.uint8),
        np.full((count, BUILD_SIZE), np.nan, np.float32),
        np.full((count, joints, 3, 3), np.nan, np.float16),
    )


def whole(track: Track) -> Track:
    """Return a track in which frames with missing or non-finite joints are gaps.

    Raises
    ------
    InputError
        Where no frame is left.
    """
    values = np.concatenate([track.positions, track.quats_xyzw], axis=2)
    good = track.present & np.isfinite(values).all(axis=(1, 2))
    if not good.any():
        raise InputError(f"{track.body_id!r} has no frame in which all joints are there and are numbers")
    first, last = np.flatnonzero(good)[[0, -1]]
    held = {f.name: getattr(track, f.name) for f in fields(track)}
    held = {n: v[first : last + 1].copy() for n, v in held.items() if isinstance(v, np.ndarray)}
    held["present"] = good = good[first : last + 1]
    held["positions"][~good] = held["quats_xyzw"][~good] = np.nan
    return replace(track, **held)


def in_world(track: Track, T_world_camera: Array, frame_id: str) -> Track:
    """Return the motion in another frame; ``T_world_camera`` (4, 4) maps the track's frame to it."""
    turn = T_world_camera[:3, :3]
    positions = track.positions @ turn.T + T_world_camera[:3, 3]
    quats = np.full_like(track.quats_xyzw, np.nan)
    there = track.present
    quats[there] = matrix_to_quat(turn @ quat_to_matrix(track.quats_xyzw[there]))
    covariances = (turn @ track.covariances @ turn.T).astype(np.float16)
    return replace(track, positions=positions, quats_xyzw=quats, covariances=covariances, frame_id=frame_id)


def usual_step_s(stamps_ns: NDArray[np.int64]) -> float:
    """Return the median time between frames, seconds; 1/30 if there is only one frame."""
    return float(np.median(np.diff(stamps_ns))) * 1e-9 if len(stamps_ns) > 1 else 1 / 30


def even_step_s(stamps_ns: NDArray[np.int64]) -> float:
    """Return the period of the even rate that fits the stamps best, seconds."""
    if len(stamps_ns) < 2:
        return usual_step_s(stamps_ns)
    total = float(stamps_ns[-1] - stamps_ns[0]) * 1e-9
    return total / max(1, round(total / usual_step_s(stamps_ns)))


def even(track: Track, step_s: float) -> Track:
    """Resample the motion at an even rate, as BVH and TRC require.

    A time without a stamp nearby is interpolated from the frames around it; if these are more
    than `_LONGEST_STEP` steps apart, or one lacks the person, it is a gap.

    Raises
    ------
    InputError
        Where that would give more than `MOST_FRAMES` frames: stamps far apart.
    """
    count = round(track.seconds / step_s) + 1
    if count > MOST_FRAMES:
        raise InputError(
            f"{track.body_id} is seen over {track.seconds:.0f} s, {count} even frames of {step_s:.3g} s; "
            f"at most {MOST_FRAMES} are written: .csv and .npz keep the frames as they are"
        )
    stamps_ns = track.stamps_ns[0] + np.rint(np.arange(count) * step_s * 1e9).astype(np.int64)
    return _sampled(track, stamps_ns, round(step_s * 1e9))


def fill_gaps(track: Track) -> Track:
    """Fill the gaps: positions move straight, segments rotate evenly; confidence 0, state LOST.

    ``present`` is then true everywhere; filled frames have the source LOST.
    """
    filled = _sampled(track, track.stamps_ns, None)
    bridged = ~track.present
    filled.confidence[bridged], filled.joint_confidence[bridged] = 0.0, 0.0
    filled.joint_states[bridged], filled.source[bridged] = JointState.LOST, Source.LOST
    return filled


def held(track: Track) -> Track:
    """Return the motion with the last pose held in gaps, for formats that cannot omit a frame."""
    last = np.maximum.accumulate(np.where(track.present, np.arange(len(track)), 0))
    return replace(
        _picked(track, last, track.stamps_ns), joint_states=track.joint_states, source=track.source
    )


def _picked(track: Track, index: NDArray[np.int64], stamps_ns: NDArray[np.int64]) -> Track:
    """Return the selected frames, restamped."""
    return replace(track, stamps_ns=stamps_ns, **{name: getattr(track, name)[index] for name in ARRAYS})


def _sampled(track: Track, stamps_ns: NDArray[np.int64], step_ns: int | None) -> Track:
    """Interpolate the motion at other times, between frames with the person.

    With ``step_ns``, gaps longer than it stay gaps; without it, they are filled.
    """
    known = np.flatnonzero(track.present)
    times = track.stamps_ns[known]
    after = np.clip(np.searchsorted(times, stamps_ns), 0, len(known) - 1)
    before = np.maximum(after - (times[after] > stamps_ns), 0)
    span = times[after] - times[before]
    share = np.clip((stamps_ns - times[before]) / np.maximum(span, 1), 0.0, 1.0)
    nearest = np.where(share > 0.5, after, before)
    gone = np.zeros(len(stamps_ns), np.bool_)
    if step_ns is not None:
        away = np.abs(times[nearest] - stamps_ns)
        beside_gap = span > _LONGEST_STEP * step_ns
        gone = beside_gap & (away > step_ns / 2)
        as_is = beside_gap | (away <= _ON_GRID * step_ns)
        share = np.where(as_is, (nearest == after) & (after != before), share)
    a, b = known[before], known[after]
    positions = _mixed(track.positions[a], track.positions[b], share[:, None, None])
    quats = slerp(track.quats_xyzw[a], track.quats_xyzw[b], share[:, None])
    out = _picked(track, known[nearest], stamps_ns)
    return _without(replace(out, positions=positions, quats_xyzw=quats), gone)


def _without(track: Track, gone: NDArray[np.bool_]) -> Track:
    """Return the motion with the person removed from some frames."""
    if not gone.any():
        return track
    out = _empty(track.body_id, track.frame_id, track.stamps_ns)
    for name in ARRAYS:
        getattr(out, name)[~gone] = getattr(track, name)[~gone]
    return out


def _mixed(a: Array, b: Array, share: Array) -> Array:
    """Interpolate points; exact where the share is 0 or 1."""
    return np.asarray(np.where(share == 1, b, a + share * (b - a)))


def describe_gaps(track: Presence) -> str:
    """Describe the gaps, ``2 gaps: 1.20 to 1.33 s, 4.00 to 4.50 s``; empty for none.

    Times are from the person's first frame, from the last frame before a gap to the first after it.
    """
    gaps = track.gaps()
    if not gaps:
        return ""
    since = (track.stamps_ns - track.stamps_ns[0]) * 1e-9
    shown = [f"{since[a - 1]:.2f} to {since[b]:.2f} s" for a, b in gaps[:_MOST_TOLD]]
    more = f" and {len(gaps) - _MOST_TOLD} more" if len(gaps) > _MOST_TOLD else ""
    return f"{len(gaps)} gap{'s' if len(gaps) > 1 else ''}: {', '.join(shown)}{more}"
