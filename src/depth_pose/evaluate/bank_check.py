"""Draw inputs beside their best matches in a bank."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from depth_pose.bank.bank import Bank
from depth_pose.body.rendered_depth import render_depth
from depth_pose.core.config import PipelineConfig
from depth_pose.core.errors import InputError
from depth_pose.core.frame import DepthFrame
from depth_pose.core.pose_match import PoseMatch
from depth_pose.core.skeleton import JOINT_NODES
from depth_pose.evaluate.bank_sheet import draw_depth
from depth_pose.evaluate.pictures import plain_text, save_picture
from depth_pose.io.mcap_read import DepthReader
from depth_pose.match.match import match_confidence
from depth_pose.match.tuning import MatchTuning
from depth_pose.perception import Perception
from depth_pose.stages import StageFactory
from depth_pose.track.person_view import FramePeople
from depth_pose.tuning import Tuning

_FRAMES_BEFORE = 2
"""Number of frames before the shown one, used to estimate the person's size."""

_PANEL_INCHES = 2.1
"""Width of a panel, for readability."""
_DARK = "#15181d"


@dataclass(frozen=True)
class MatchedFrame:
    """One frame of the recording: its number, its people, and their matches."""

    number: int
    people: FramePeople
    matches: tuple[PoseMatch, ...]


@dataclass(frozen=True)
class Matched:
    """Frames of a recording and their matches.

    Attributes
    ----------
    frames : tuple of MatchedFrame
    candidates : int
        Most candidates of a frame.
    """

    frames: tuple[MatchedFrame, ...]
    candidates: int

    def lines(self) -> Iterator[str]:
        """Return one line for each frame and its match."""
        for f in self.frames:
            if not f.matches:
                yield f"frame {f.number}: nobody in view"
            for match in f.matches:
                scores = ", ".join(f"{c.exemplar} ({c.score:.2f})" for c in match.candidates)
                who = f", {match.body_id}" if len(f.matches) > 1 else ""
                yield f"frame {f.number}{who}: scale {match.scale:.2f}; exemplars (score) {scores}"


def match_frames(
    bank: Bank,
    recording: Path,
    frames: int,
    candidates: int,
    depth_topic: str | None = None,
    progress: Callable[[int], None] | None = None,
) -> Matched:
    """Match some frames, spread over a recording.

    Parameters
    ----------
    bank : Bank
    recording : path
        A depth recording (MCAP).
    frames, candidates : int
        Number of frames, and of matches for each.
    depth_topic : str, optional
        Found by default.
    progress : callable, optional
        Called with the number of frames done.

    Raises
    ------
    InputError
        Where the recording cannot be used or is empty.
    """
    config = PipelineConfig()
    perception = Perception(config.segment, config.denoise)
    tuning = Tuning(match=MatchTuning(keep=candidates, search_every=1))
    matcher = StageFactory(bank, tuning=tuning).make_matcher()
    found = []
    for number, frame, shown in _near_chosen(DepthReader(recording, depth_topic), frames):
        people = perception.perceive(frame)
        matches = matcher.match(people)
        if shown:
            found.append(MatchedFrame(number, people, matches))
            if progress is not None:
                progress(len(found))
    if not found:
        raise InputError(f"{recording} has no depth frames")
    return Matched(tuple(found), candidates)


def _near_chosen(reader: DepthReader, count: int) -> Iterator[tuple[int, DepthFrame, bool]]:
    """Frames in the middle of equal parts of the recording, and the few before each."""
    middles = {int(m) for m in (np.arange(count) + 0.5) * len(reader) / count}
    for number, frame in enumerate(reader):
        if any(m - _FRAMES_BEFORE <= number <= m for m in middles):
            yield number, frame, number in middles


def save_check(matched: Matched, bank: Bank, path: str | Path, title: str = "") -> None:
    """Draw each person of the input and, beside them, the best matches rendered as placed by the matcher.

    Parameters
    ----------
    matched : Matched
    bank : Bank
        The bank of the matches.
    path : path
        The picture; folders are made.
    title : str
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    shown = [(f, match) for f in matched.frames for match in f.matches or (None,)]
    columns, rows = 1 + matched.candidates, len(shown)
    width, height = _PANEL_INCHES * columns, 1.35 * _PANEL_INCHES * rows + 0.3
    figure = Figure(figsize=(width, height), dpi=110, facecolor=_DARK)
    FigureCanvasAgg(figure)
    top = 1 - 0.3 / height
    grid = figure.add_gridspec(
        rows, columns, left=0.004, right=0.996, bottom=0.004, top=top, wspace=0.02, hspace=0.02
    )
    for row, (frame, match) in enumerate(shown):
        panels = [figure.add_subplot(grid[row, column]) for column in range(columns)]
        _draw_match(panels, frame, match, bank)
    figure.text(
        0.008,
        (1 + top) / 2,
        f"{plain_text(title)}: input, and the best matches in bank {bank.bank_id}",
        color="white",
        fontsize=9,
        va="center",
    )
    save_picture(figure, path, facecolor=_DARK)


def _draw_match(panels: list[Any], frame: MatchedFrame, match: PoseMatch | None, bank: Bank) -> None:
    """Draw the row of one person, or of an empty frame."""
    if match is None:
        panels[0].imshow(np.zeros(frame.people.labels.shape), cmap="gray")
        _caption(panels[0], f"frame {frame.number}: nobody in view")
        for panel in panels:
            panel.set_axis_off()
        return
    seen = next(p for p in frame.people.persons if p.body_id == match.body_id).full
    draw_depth(panels[0], seen.depth, None, seen.camera)
    _caption(panels[0], f"frame {frame.number}, {match.body_id}, scale {match.scale:.2f}")
    for rank, (panel, candidate) in enumerate(zip(panels[1:], match.candidates, strict=False)):
        pose = bank.pose(candidate, match.scale)
        posed = bank.body.pose(pose.rotations, pose.root, pose.scale)
        drawn = render_depth(posed.vertices, bank.body.faces, seen.camera)
        depth = np.where(np.isfinite(drawn), drawn, 0.0).astype(np.float32)
        draw_depth(panel, depth, posed.nodes[JOINT_NODES], seen.camera)
        sure = f", {match_confidence(candidate.score):.0%} sure" if rank == 0 else ""
        _caption(panel, f"{candidate.exemplar}, view {candidate.view}: score {candidate.score:.2f}{sure}")
    for panel in panels[1 + len(match.candidates) :]:
        panel.set_axis_off()


def _caption(panel: Any, text: str) -> None:
    box = {"facecolor": _DARK, "alpha": 0.75, "edgecolor": "none", "pad": 1.5}
    panel.text(0.03, 0.98, text, transform=panel.transAxes, va="top", color="white", fontsize=7, bbox=box)
