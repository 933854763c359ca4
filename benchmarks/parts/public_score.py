"""Answers of the tracker on public clips, and their errors, beside published figures."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from depth_pose import Tracker
from depth_pose.bank import Bank, default_bank_path
from depth_pose.core.rotations import quat_to_matrix
from depth_pose.core.skeleton import JOINT_INDEX
from depth_pose.evaluate.score import torso_axes
from parts.public_readers import FPS, Clip, Loaded

Array = NDArray[np.float64]

WITHIN_M = 0.10

_YE = "M. Ye et al., ICCV 2011, sec. 7"
PUBLISHED: dict[str, list[tuple[str, str, str]]] = {
    "utd-mhad": [],
    "msr-action3d": [],
    "itop": [("SPiKE, side view, mAP at 10 cm", ".892", "I. Ballester et al., arXiv 2409.01879, abstract")],
    "eval": [],
    "smmc": [
        ("Ye et al., markers, mean error", "38 mm", _YE),
        ("Ye et al., mAP at 10 cm", ".95", f"{_YE}, table 1"),
        ("Ganapathi et al. 2010, mean error", "100 mm", f"as quoted by {_YE}"),
    ],
}
"""Figures of others, each as its source states it; none where no source could be checked."""


@dataclass(frozen=True)
class ClipErrors:
    """Errors of one clip (T, J), metres; infinite where nobody answered, NaN where the joint is unknown.

    Attributes
    ----------
    raw : (T, J) float64
        As they are; NaN for markers, which lie on the skin.
    free : (T, J) float64
        Without the constant offset of each joint in the torso's frame, or of each marker in a joint's.
    """

    name: str
    kind: str
    frames: int
    raw: Array
    free: Array

    def line(self) -> str:
        """Return the result in one line."""
        judged = self.raw if self.kind == "joints" else self.free
        free = "" if self.kind == "joints" else f"without offsets {_mean_mm(self.free)}, "
        return (
            f"{self.name}: {self.frames} frames, answered {_share(np.isfinite(judged), judged):.3f}, "
            f"error {_mean_mm(self.raw)}, {free}mAP at 10 cm {_share(judged < WITHIN_M, judged):.3f}"
        )


def run_clip(clip: Clip, most: int | None) -> ClipErrors:
    """Track everybody in a clip, and score who fits the reference best in each frame."""
    loaded = clip.load()
    tracker, answers = Tracker(_bank(), quiet=True, depth_scale=1.0), []
    for i, (camera, depth) in enumerate(loaded.frames):
        if i in (most, len(loaded.reference)):
            break
        people = tracker(depth, camera, time=i / FPS if clip.is_video else None)
        answers.append(max(people, key=lambda person: person.confidence, default=None))
    return score_answers(clip, loaded, answers)


@cache
def _bank() -> Bank:
    return Bank.load(default_bank_path())


def score_answers(clip: Clip, loaded: Loaded, answers: list) -> ClipErrors:
    """Compare answers (None: nobody) with a clip's reference."""
    reference = loaded.reference[: len(answers)]
    places = np.full((len(answers), len(JOINT_INDEX), 3), np.nan)
    turns = np.full((len(answers), len(JOINT_INDEX), 3, 3), np.nan)
    for t, skeleton in enumerate(answers):
        if skeleton is not None:
            places[t], turns[t] = skeleton.positions, quat_to_matrix(skeleton.quats_xyzw)
    if clip.kind == "markers":
        free = _marker_errors(reference, places, turns)
        raw = np.full_like(free, np.nan)
    else:
        answered = places[:, [JOINT_INDEX[name] for name in loaded.names]]
        difference = answered - reference
        torso = np.stack([torso_axes(joints, loaded.names) for joints in reference])
        offsets = np.einsum("tji,tkj->tki", torso, difference)
        raw = np.linalg.norm(difference, axis=-1)
        free = np.linalg.norm(offsets - np.nanmedian(offsets, axis=0), axis=-1)
    known = np.isfinite(reference).all(axis=-1)
    missed = known & ~np.isfinite(places[:, :1]).all(axis=-1)
    for errors in (raw, free):
        errors[missed] = np.inf
    return ClipErrors(clip.name, clip.kind, len(answers), raw, free)


def _marker_errors(markers: Array, places: Array, turns: Array) -> Array:
    """Distance of each marker (T, M) from its median place in the frame of the joint that moves with it."""
    errors = np.empty(markers.shape[:2])
    for m in range(markers.shape[1]):
        away = markers[:, m, None] - places
        local = np.einsum("tjba,tjb->tja", turns, away)
        distance = np.linalg.norm(local - np.nanmedian(local, axis=0), axis=-1)
        errors[:, m] = distance[:, np.argmin(np.nanmean(distance, axis=0))]
    return errors


def summary(results: list[ClipErrors]) -> str:
    """Return the line of all clips together."""
    raw, free = (np.concatenate([getattr(r, name).ravel() for r in results]) for name in ("raw", "free"))
    frames = sum(r.frames for r in results)
    return ClipErrors(
        f"all {len(results)} clips", results[0].kind, frames, raw[:, None], free[:, None]
    ).line()


def _share(those: NDArray[np.bool_], of: Array) -> float:
    return float(those.sum() / max((~np.isnan(of)).sum(), 1))


def _mean_mm(errors: Array) -> str:
    finite = errors[np.isfinite(errors)]
    return f"{1e3 * finite.mean():.1f} mm" if finite.size else "-"
