"""State of each track: one plain value a person, which the stages take and return.

This module defines the rules for streams. Everything is forgotten if stamps jump back, or ahead by more than
`depth_pose.core.stamps.LONGEST_SILENCE_NS`. Pose, filter and evidence of a person who was not seen for half a
second, in a silence of the sensor too, are forgotten, and after `RETURN_NS` the person. In one process the
stages share the states; live, each node holds its own, in which it fills the parts that it computes
(docs/method.md has the table).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.pose import BodyPose, Fitted
from depth_pose.core.config import MAX_STAMP_GAP_NS
from depth_pose.core.pose_match import PoseMatch
from depth_pose.core.stamps import StampGuard
from depth_pose.track.person_view import FramePeople, PersonView

MEMORY_NS = 2_000_000_000
"""Time (ns) for which a person out of view is remembered."""

RETURN_NS = 5_000_000_000
"""Time (ns) within which a hidden person keeps id and build."""

Array = NDArray[np.float64]


class SizeSearch(NamedTuple):
    """Sizes compared on a grid (`depth_pose.match.scale`).

    Attributes
    ----------
    frames : int
        Number of frames that were compared.
    at : int
        Index of the best size.
    rises : (S - 1,) float64
        Sums of the score differences between neighbouring sizes.
    counts : (S - 1,) int64
        Number of terms of each sum.
    is_partial : bool
        Whether the size was estimated while the image border may have cut the person off.
    shown : float
        Maximum visible amount of the person since then: points times squared distance.
    whole : int
        Consecutive frames in which nothing cut the person off.
    """

    frames: int = 0
    at: int = 0
    rises: Array = np.zeros(0)
    counts: NDArray[np.int64] = np.zeros(0, np.int64)
    is_partial: bool = False
    shown: float = 0.0
    whole: int = 0


class Histogram(NamedTuple):
    """Weighted counts (R, B) of several numbers in equal bins, and the sums of weights, (R,)."""

    counts: Array
    total: Array


class Shape(NamedTuple):
    """Size and proportions of a person, with the evidence (`depth_pose.refine.personal`).

    Attributes
    ----------
    search : SizeSearch
        Sizes of the bank's body, compared by the matcher; their best is one observation of the size.
    scale : float
        The size in use, as float32; 0 before the first fit.
    build : (13,) float32
        The proportions in use; no rows before the first fit.
    information, vector : (14, 14), (14,) float64
        Sums over frames of the skin's information on log size and build, and of that times the value.
    bones, depth : Histogram or None
        Log lengths of the bones between measured joints, and their depth below the skin; None before the
        first fit.
    depth_row : (14,) float64
        Weighted sum of the derivatives of that depth.
    frames : int
        Number of frames with evidence of the skin.
    weight : float
        Sum of their weights.
    stamp_ns : int or None
        Last frame with evidence.
    told : tuple of float and bool
        Information on the log size that was found by search or configured, its value, and whether it is
        configured.
    solved_at : tuple or None
        ``told`` and ``stamp_ns`` for which size and build were solved last.
    """

    search: SizeSearch = SizeSearch()
    scale: float = 0.0
    build: NDArray[np.float32] = np.zeros(0, np.float32)
    information: Array = np.zeros((0, 0))
    vector: Array = np.zeros(0)
    bones: Histogram | None = None
    depth: Histogram | None = None
    depth_row: Array = np.zeros(0)
    frames: int = 0
    weight: float = 0.0
    stamp_ns: int | None = None
    told: tuple[float, float, bool] = (0.0, 0.0, False)
    solved_at: tuple[object, ...] | None = None


class Answer(NamedTuple):
    """The last answers.

    Attributes
    ----------
    pose : BodyPose or None
        The fit of the frame before, which the next one continues.
    noise : float
        Running mean of `depth_pose.refine.noise.skin_noise`, metres; 0 before the first fit.
    last : Fitted or None
        The unfiltered answer for the previous frame.
    seen : PersonView or None
        The observation in that frame.
    good : Fitted or None
        The last fit without a failure.
    good_points : int
        Number of the person's points in that frame.
    is_waiting : bool
        Whether the person was lost and a good fit is awaited.
    """

    pose: BodyPose | None = None
    noise: float = 0.0
    last: Fitted | None = None
    seen: PersonView | None = None
    good: Fitted | None = None
    good_points: int = 0
    is_waiting: bool = False


class FilterState(NamedTuple):
    """State of the low-pass filter (`depth_pose.recover.smooth`).

    Attributes
    ----------
    stamp_ns : int or None
        None before the first frame.
    positions : (19, 3) float64
        Filtered joints, metres.
    velocity : (19, 3) float64
        Velocity of the joints that come in, m/s; its size sets the cut-off frequency.
    motion : (19, 3) float64
        Velocity of the filtered joints, m/s.
    """

    stamp_ns: int | None = None
    positions: Array = np.zeros((0, 3))
    velocity: Array = np.zeros((0, 3))
    motion: Array = np.zeros((0, 3))


class Evidence(NamedTuple):
    """What speaks for person and pose.

    Attributes
    ----------
    pose_distance : float or None
        Running mean of the distance of fitted poses from the bank's mean, standard deviations
        (`depth_pose.refine.pose_prior`); None before the first.
    is_published : bool
        Whether the person was published in the last frame.
    """

    pose_distance: float | None = None
    is_published: bool = False


class Schedule(NamedTuple):
    """Schedule of searches.

    Attributes
    ----------
    match : PoseMatch or None
        The last search's result.
    match_age : int
        Frames since the last search was due.
    match_ns : int
        Stamp of the last search.
    match_centre : (3,) float64
        Mean of the person's points then, metres.
    """

    match: PoseMatch | None = None
    match_age: int = 0
    match_ns: int = 0
    match_centre: Array = np.zeros(3)


class PersonState(NamedTuple):
    """State of one track."""

    answer: Answer = Answer()
    shape: Shape = Shape()
    filter: FilterState = FilterState()
    evidence: Evidence = Evidence()
    schedule: Schedule = Schedule()

    def without_pose(self) -> PersonState:
        """Return the state of a person who was out of view: size, build and last match stay."""
        return PersonState(shape=self.shape, schedule=self.schedule)

    def lost(self) -> PersonState:
        """Return the state of a person whose fit failed: the next good one is awaited."""
        answer = self.answer._replace(last=None, seen=None, good=None, good_points=0, is_waiting=True)
        return self._replace(answer=answer, filter=FilterState())


class PersonStates:
    """States of all tracks by body id.

    Attributes
    ----------
    keeps_builds : bool
        Whether the builds of people who are forgotten are kept: ids are not given twice.
    """

    def __init__(self) -> None:
        self.keeps_builds = False
        self._guard = StampGuard()
        self.reset()

    def reset(self) -> None:
        """Forget all tracks."""
        self._states: dict[str, PersonState] = {}
        self._seen_ns: dict[str, int] = {}

    def begin(self, people: FramePeople) -> None:
        """Begin a frame: forget expired state. Each stage calls this; only the first call has an effect."""
        now_ns = people.stamp_ns
        if self._guard.is_break(now_ns):
            self.reset()
        for body_id in [b for b, seen in self._seen_ns.items() if now_ns - seen > RETURN_NS]:
            forgotten = self._states.pop(body_id)
            del self._seen_ns[body_id]
            if self.keeps_builds:
                self._states[body_id] = PersonState(shape=forgotten.shape._replace(search=SizeSearch()))
        for person in people.persons:
            state = self._states.setdefault(person.body_id, PersonState())
            if now_ns - self._seen_ns.get(person.body_id, now_ns) > MAX_STAMP_GAP_NS:
                self._states[person.body_id] = state.without_pose()
            self._seen_ns[person.body_id] = now_ns

    def __getitem__(self, body_id: str) -> PersonState:
        """Return the state of a person in the frame."""
        return self._states[body_id]

    def __setitem__(self, body_id: str, state: PersonState) -> None:
        self._states[body_id] = state
