"""The method as a whole: Ye et al., *Accurate 3D Pose Estimation From a Single Depth Image*, Fig. 3.

The four ROS nodes run the same four stages; here they run one after the other in one process.
"""

from __future__ import annotations

import multiprocessing
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from depth_pose.bank.bank import Bank, default_bank_path
from depth_pose.body.pose import Fitted
from depth_pose.core.config import PipelineConfig
from depth_pose.core.frame import DepthFrame
from depth_pose.core.kernels import is_compiled
from depth_pose.core.mount import rotate_to_sensor, rotate_upright, rotation_sensor_upright
from depth_pose.core.pose_match import PoseMatch
from depth_pose.core.result import Skeleton
from depth_pose.core.threads import ONE_THREAD, Threads, check_threads, one_thread_each
from depth_pose.detect.floor import Floor
from depth_pose.detect.input_repair import InputRepair
from depth_pose.perception import Perception
from depth_pose.stages import StageFactory
from depth_pose.track.follow import Follower
from depth_pose.track.nobody import NobodyWatch
from depth_pose.track.person_view import FramePeople, PersonView
from depth_pose.track.state import PersonState
from depth_pose.track.upside_down import UpsideDownWatch
from depth_pose.tuning import Tuning


@dataclass(frozen=True)
class Perceived:
    """Results of the first stage for one frame.

    Attributes
    ----------
    frame : DepthFrame
        Upright.
    people : FramePeople
    rejected : mapping of str to int
        `depth_pose.perception.Perception.rejected_counts` after this frame.
    """

    frame: DepthFrame
    people: FramePeople
    rejected: Mapping[str, int]


@dataclass(frozen=True)
class FrameResult:
    """Results of all stages for one frame.

    Attributes
    ----------
    people : FramePeople
    matches : tuple of PoseMatch
    refined : tuple of Fitted
    skeletons : tuple of Skeleton
        All people, sensor's frame.
    skeleton : Skeleton
        The followed one.
    floor : Floor or None
        The floor, sensor's frame, if it is known.
    """

    people: FramePeople
    matches: tuple[PoseMatch, ...]
    refined: tuple[Fitted, ...]
    skeletons: tuple[Skeleton, ...]
    skeleton: Skeleton
    floor: Floor | None


class PosePipeline:
    """The pipeline from depth frames to skeletons.

    Parameters
    ----------
    bank : Bank
    config : PipelineConfig
    tuning : Tuning
    threads : int
        1 or 2: number of threads in which several people are measured and fitted. Results do not depend
        on it.

    Attributes
    ----------
    unanswered : int
        Frames with a person in view but no skeleton, since the start.
    states : PersonStates
        What is known of each person.

    Examples
    --------
    >>> pipeline = PosePipeline(Bank.load(default_bank_path()))  # doctest: +SKIP
    >>> skeletons = pipeline.process_frame(frame).skeletons  # doctest: +SKIP
    """

    @one_thread_each
    def __init__(
        self,
        bank: Bank,
        config: PipelineConfig = PipelineConfig(),
        tuning: Tuning = Tuning(),
        threads: int = 1,
    ) -> None:
        self._mount = config.mount
        several = Threads(check_threads(threads))
        # the paper's registration reuses one factorisation
        self._fit_threads = several if config.refine.method == "articulated" else ONE_THREAD
        self.unanswered = 0
        self._repair = InputRepair()
        self._orientation = UpsideDownWatch(config.segment)
        self._nobody = NobodyWatch(config.segment)
        shared = StageFactory(bank, config, tuning)
        self.states = shared.states
        self.perception = Perception(
            config.segment,
            config.denoise,
            config.mount,
            config.match.method == "joints",
            tuning.detect,
            tuning.denoise,
            several,
        )
        self.matcher = shared.make_matcher()
        self.refiner = shared.make_refiner()
        self.recoverer = shared.make_recoverer()
        self.follower = Follower(config.follow)
        self._stages = (self.perception, self.matcher, self.refiner, self.recoverer, self.follower)

    @one_thread_each
    def process_frame(self, frame: DepthFrame) -> FrameResult:
        """Estimate the poses in one frame; pass the frames of a sequence in their order."""
        return self._conclude(self._perceive(frame))

    @one_thread_each
    def perceive(self, frame: DepthFrame) -> Perceived:
        """Run the first stage on one frame; the next one may be perceived while this one is concluded."""
        return self._perceive(frame)

    def _perceive(self, frame: DepthFrame) -> Perceived:
        # Sec. 4: find the people, cut them out, modified LOP (eqs. 1 to 5), outliers
        shown = rotate_upright(self._repair.apply(frame), self._mount)
        people = self.perception.perceive(shown)
        self._orientation.look(shown, people)
        return Perceived(shown, people, dict(self.perception.rejected_counts))

    @one_thread_each
    def conclude(self, seen: Perceived) -> FrameResult:
        """Estimate the poses of the people in a frame after the first stage."""
        return self._conclude(seen)

    def _conclude(self, seen: Perceived) -> FrameResult:
        result = self._answer(seen.people)
        self._nobody.look(
            seen.frame,
            is_found=bool(seen.people.persons),
            is_answered=bool(result.skeletons),
            rejected=seen.rejected,
        )
        return result

    @one_thread_each
    def answer(self, people: FramePeople) -> FrameResult:
        """Estimate the poses of segmented people; the state of each goes through all stages and back."""
        return self._answer(people)

    def _answer(self, people: FramePeople) -> FrameResult:
        self.states.begin(people)
        self.recoverer.begin()
        matches, refined, skeletons = [], [], []
        fits = self._fit_threads.map(self._fit, people.persons)
        for person, (state, match, fitted) in zip(people.persons, fits, strict=True):
            self.refiner.builds.keep(state.shape)
            # Sec. 6: failure check, temporal registration, low-pass filter
            state, skeleton = self.recoverer.estimate(state, person, fitted)
            self.states[person.body_id] = state
            matches.append(match)
            refined.append(fitted)
            if skeleton is not None:  # back into the frame of a sensor that is mounted rolled
                skeletons.append(rotate_to_sensor(skeleton, self._mount))
        self.unanswered += bool(people.persons and not skeletons)
        followed = self.follower.choose(skeletons, people.stamp_ns, people.frame_id)
        floor = None
        if people.floor.any():
            floor = Floor(people.floor[:3], float(people.floor[3]))
            floor = floor.turned(rotation_sensor_upright(self._mount.roll))
        return FrameResult(people, tuple(matches), tuple(refined), tuple(skeletons), followed, floor)

    def _fit(self, person: PersonView) -> tuple[PersonState, PoseMatch, Fitted]:
        """Match and fit one person; changes nothing that another person's fit needs."""
        # Sec. 5: canonical axes, PCA subspace, nearest exemplars (eq. 6)
        state, match = self.matcher.estimate(self.states[person.body_id], person)
        # Sec. 6: fit the body to the person's points; with method cpd complete the mesh (eqs. 7, 8)
        state, fitted = self.refiner.estimate(state, person, match)
        return state, match, fitted

    def reset(self) -> None:
        """Forget all earlier frames; counters continue."""
        for stage in self._stages:
            stage.reset()
        self._repair.reset()
        self._orientation.reset()
        self._nobody.reset()

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the frames since the last reset, one line each."""
        return (*self._repair.warnings, *filter(None, [self._orientation.doubt, self._nobody.doubt]))

    def restart(self, *, single: bool = False) -> None:
        """Forget all earlier frames and people's ids, as if new; counters continue.

        In contrast, `reset` never reuses an id.

        Parameters
        ----------
        single : bool
            Whether the next frame stands alone: why nobody is in it is told at once.
        """
        self.reset()
        self.perception.restart()
        if single:
            self._nobody.reset(fewest=1)

    @contextmanager
    def keeping_builds(self) -> Iterator[None]:
        """Keep the builds of people who have left the view, as for a second pass."""
        self.states.keeps_builds = True
        try:
            yield
        finally:
            self.states.keeps_builds = False

    def warm_up(self) -> None:
        """Compile (or load from the cache) every kernel, so that the first frame is not late."""
        with _compiling_beside():
            self._repair.warm_up()
            for stage in self._stages[:-1]:
                stage.warm_up()


def warm_up_later_stages() -> None:
    """Compile the kernels of the fit and of the recovery, which take longest, for the default settings."""
    shared = StageFactory(Bank.load(default_bank_path()))
    shared.make_refiner().warm_up()
    shared.make_recoverer().warm_up()


@contextmanager
def _compiling_beside() -> Iterator[None]:
    """Compile the later stages' kernels in a second process meanwhile, where they are not on disk yet.

    Both processes find on disk what the other has compiled. Worker processes do not start a second one.
    """
    from depth_pose.refine._articulated_kernels import fit

    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if cores < 2 or multiprocessing.parent_process() is not None or is_compiled(fit):
        yield
        return
    source = str(Path(__file__).parents[1])
    search = os.pathsep.join(filter(None, (source, os.environ.get("PYTHONPATH"))))
    code = f"from {__name__} import warm_up_later_stages; warm_up_later_stages()"
    process = subprocess.Popen(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": search},
        stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    try:
        yield
    finally:
        process.kill()  # all that is needed is there; numba writes its files whole or not at all
        process.wait()
