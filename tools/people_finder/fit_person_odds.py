"""Fit the odds of a person to tracks in simulated homes, and write ``person_odds.json`` beside the nets.

    python tools/people_finder/fit_person_odds.py collect rows/0.npz --clips 160
    python tools/people_finder/fit_person_odds.py collect rows/1.npz --clips 160 --first 160
    python tools/people_finder/fit_person_odds.py fit src/depth_pose/detect/weights rows/*.npz

The pipeline runs with its nets over short clips and keeps every track, likely or not. In half of the clips
nobody moves: people lie, sit, kneel and stand, seen from all mountings; in the others they walk about, and
half of the cameras move. A third have nobody but pets, coats and boxes. A track is a person where its body
lies at one who is visible by 30 %; those of people who show less are left out.
Prints the calibration on clips kept apart, by family of sensors and by kind of clip.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
import typer
from numpy.typing import NDArray
from rich.progress import track

from depth_pose.bank.bank import Bank, default_bank_path
from depth_pose.core.frame import DepthFrame
from depth_pose.core.odds import logistic
from depth_pose.core.skeleton import JOINT_INDEX
from depth_pose.detect.tuning import DetectTuning
from depth_pose.pipeline import PosePipeline
from depth_pose.sim.clips import RoomClip, sample_clip, sample_still_clip
from depth_pose.sim.home_sensors import HOME_FAMILIES
from depth_pose.track.person_odds import PersonOdds
from depth_pose.track.tracks import PeopleTracks, TrackLimits
from depth_pose.tuning import Tuning

_TORSO = [JOINT_INDEX[f"{side}_{n}"] for side in ("left", "right") for n in ("shoulder", "hip")]
_EVERYTHING = TrackLimits(start=0.05, keep=0.05, confirm=0.0)
_NEAR_M = 0.4
"""Largest distance of a track's torso from that of its person (m), as in the scorers."""
_ASKED, _IGNORED = 0.3, 0.05
"""Visible share from which somebody is asked for, and below which nobody is."""
_SIGNS, _SIGNS_FITTED = (0, 1, 1, 1, 1, 0, -1), (0, 1, -1)
"""Signs that weights must have: detections, way and time speak for a person, deviations and unusual poses
against one."""
_FITTED = 0.2
"""Probability before the fit of the tracks that the odds after it are fitted to: others are hardly ever
fitted, and more of them are things. Best of 0, .1, .2, .3 and .4 in clips kept apart."""
_STEPS, _RIDGE = 40, 1.0
"""Newton steps, and ridge on all weights but the constant."""
_KINDS = ("still", "walks", "still", "moving camera")
"""Kinds of clips, in turn."""
_PEOPLE_SHARES, _FPS = (0.34, 0.36, 0.18, 0.12), 10.0
"""Shares of clips with zero to three people, and frames a second. Set by hand."""

app = typer.Typer(add_completion=False)


class Rows(NamedTuple):
    """Tracks in frames, (N,) or (N, 7): terms, distance of poses, truth, clip, its sensor and kind."""

    terms: NDArray[np.float64]
    pose_distance: NDArray[np.float64]
    is_person: NDArray[np.bool_]
    clip: NDArray[np.int64]
    family: NDArray[np.str_]
    kind: NDArray[np.str_]

    @classmethod
    def load(cls, files: list[Path]) -> Rows:
        """Read and join files from ``collect``."""
        parts = [np.load(path) for path in files]
        return cls(*(np.concatenate([part[name] for part in parts]) for name in cls._fields))

    def at(self, chosen: NDArray[np.bool_]) -> Rows:
        """Return some of the rows."""
        return Rows(*(column[chosen] for column in self))


def collect(pipeline: PosePipeline, clip: RoomClip) -> list[tuple[NDArray[np.float64], float, bool]]:
    """Run one clip; return terms, distance of poses and truth of each track in each frame."""
    pipeline.reset()
    rows = []
    for t, stamp in enumerate(clip.stamps_ns):
        people = pipeline.process_frame(DepthFrame(int(stamp), "", clip.depth[t], clip.camera)).people
        torsos, visible = clip.joints[t][:, _TORSO].mean(axis=1), clip.visible[t]
        evidence = pipeline.perception.tracks.evidence
        for person in people.persons:
            measured = person.measured
            assert measured is not None, "the joint net measures everybody"
            away = np.linalg.norm(torsos - measured.places[_TORSO].mean(axis=0), axis=1)
            near = visible[away < _NEAR_M].max(initial=0.0)
            pose_distance = pipeline.states[person.body_id].evidence.pose_distance
            if _IGNORED < near < _ASKED or pose_distance is None:
                continue
            rows.append((evidence[person.body_id].terms(), pose_distance, bool(near >= _ASKED)))
    return rows


def fit(x: NDArray[np.float64], is_person: NDArray[np.bool_], signs: tuple[int, ...]) -> NDArray[np.float64]:
    """Fit a logistic regression, without the terms whose weights would have the wrong sign.

    Parameters
    ----------
    x : (N, K) float64
        Terms; the first column is the constant.
    is_person : (N,) bool
    signs : tuple of int
        What a weight must be: 1 positive, -1 negative, 0 either.
    """
    used = np.ones(x.shape[1], bool)
    weights = np.zeros(x.shape[1])
    while True:
        weights[:] = 0.0
        weights[used] = _fit_freely(x[:, used], is_person)
        wrong = used & (weights * np.array(signs) < 0.0)
        if not wrong.any():
            return weights
        used &= ~wrong


def _fit_freely(x: NDArray[np.float64], is_person: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Fit a logistic regression with a ridge by Newton's method."""
    weights = np.zeros(x.shape[1])
    ridge = np.append(0.0, np.full(x.shape[1] - 1, _RIDGE))
    for _ in range(_STEPS):
        p = logistic(x @ weights)
        curvature = (x * (p * (1.0 - p))[:, None]).T @ x + np.diag(ridge + 1e-6)
        weights -= np.linalg.solve(curvature, x.T @ (p - is_person) + ridge * weights)
    return weights


def report(odds: PersonOdds, rows: Rows) -> None:
    """Print how often what is called a person is one."""
    before = rows.terms @ odds.track
    p = logistic(np.column_stack([np.ones(len(before)), before, rows.pose_distance]) @ odds.fitted)
    for group in (*HOME_FAMILIES, *dict.fromkeys(_KINDS), "all"):
        at = (rows.family == group) | (rows.kind == group) | (group == "all")
        if not at.any():
            continue
        edges = np.quantile(p[at], np.linspace(0, 1, 6)[1:-1])
        bins = np.digitize(p[at], edges)
        gaps = [abs(p[at][bins == b].mean() - rows.is_person[at][bins == b].mean()) for b in np.unique(bins)]
        print(
            f"{group:13s} {at.sum():6d} tracks, people {rows.is_person[at].mean():.3f}, said "
            f"{p[at].mean():.3f}, mean gap by fifths {np.mean(gaps):.3f}; people found at .5 "
            f"{(p[at] >= 0.5)[rows.is_person[at]].mean():.3f}, "
            f"things {(p[at] >= 0.5)[~rows.is_person[at]].mean():.3f}"
        )


@app.command("collect")
def collect_rows(
    out: Annotated[Path, typer.Argument(help="File of tracks to write (.npz)")],
    clips: Annotated[int, typer.Option(help="Clips")] = 320,
    first: Annotated[int, typer.Option(help="Number of the first clip")] = 0,
    frames: Annotated[int, typer.Option(help="Frames of each")] = 8,
    seed: Annotated[int, typer.Option(help="Start of all random numbers")] = 41,
) -> None:
    """Run the pipeline over clips of homes and write their tracks."""
    pipeline = PosePipeline(Bank.load(default_bank_path()), tuning=Tuning(detect=DetectTuning(keep=0.05)))
    pipeline.perception.tracks = PeopleTracks(_EVERYTHING)
    parts: list[tuple[object, ...]] = []
    for k in track(range(first, first + clips), "clips"):
        rng = np.random.default_rng([seed, k])
        family, people = HOME_FAMILIES[k % len(HOME_FAMILIES)], int(rng.choice(4, p=_PEOPLE_SHARES))
        kind = _KINDS[k // len(HOME_FAMILIES) % len(_KINDS)]
        if kind == "still":
            clip = sample_still_clip(rng, frames, _FPS, people, family)
        else:
            clip = sample_clip(
                rng, frames, _FPS, people, sensor=family, home=True, moves=kind == "moving camera"
            )
        parts += [(*row, k, family, kind) for row in collect(pipeline, clip)]
    out.parent.mkdir(parents=True, exist_ok=True)
    np.savez(out, **dict(zip(Rows._fields, map(np.array, zip(*parts, strict=True)), strict=True)))


@app.command("fit")
def fit_odds(
    out: Annotated[Path, typer.Argument(help="Folder for person_odds.json")],
    files: Annotated[list[Path], typer.Argument(help="Files from 'collect'")],
) -> None:
    """Fit the odds and write them; one in four clips is kept apart for the check."""
    rows = Rows.load(files)
    apart = rows.clip // (len(HOME_FAMILIES) * len(_KINDS)) % 4 == 3
    taught = rows.at(~apart)
    weights = fit(taught.terms, taught.is_person, _SIGNS)
    fitted = taught.at(logistic(taught.terms @ weights) >= _FITTED)
    after = np.column_stack([np.ones(len(fitted.terms)), fitted.terms @ weights, fitted.pose_distance])
    odds = PersonOdds(weights, fit(after, fitted.is_person, _SIGNS_FITTED))
    for name, at in (("fitted on", ~apart), ("others", apart)):
        print(name)
        report(odds, rows.at(at))
    values = {"track": odds.track.round(4).tolist(), "fitted": odds.fitted.round(4).tolist()}
    (out / "person_odds.json").write_text(json.dumps(values) + "\n")
    print(values)


if __name__ == "__main__":
    app()
