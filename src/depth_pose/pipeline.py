"""The method as a whole: Ye et al., *Accurate 3D Pose Estimation From a Single Depth Image*, Fig. 3.

The four ROS nodes run the same four stages; here they run one after the other in one process.
"""

from __future__ import annotations

from dataclasses import dataclass

from threadpoolctl import ThreadpoolController

from depth_pose.bank.bank import Bank
from depth_pose.core.config import PipelineConfig
from depth_pose.core.types import DepthFrame, PersonCloud, PoseMatch, Skeleton
from depth_pose.steps.extract import PersonExtractor
from depth_pose.steps.match import Matcher
from depth_pose.steps.mount import turn_back, turn_forth, turn_upright
from depth_pose.steps.recover import Recoverer
from depth_pose.steps.refine import Refiner

_one_thread = ThreadpoolController().wrap(limits=1)
"""Small systems are no faster on more, and sums come in the same order on any number of cores."""


@dataclass(frozen=True)
class FrameResult:
    """What every stage made of one frame; ``skeleton`` is the answer."""

    cloud: PersonCloud
    match: PoseMatch
    refined: Skeleton
    skeleton: Skeleton


class PosePipeline:
    """From depth frames to skeletons.

    Parameters
    ----------
    bank : Bank
    config : PipelineConfig

    Examples
    --------
    >>> pipeline = PosePipeline(Bank.load(default_bank_path()))  # doctest: +SKIP
    >>> skeleton = pipeline.process_frame(frame).skeleton  # doctest: +SKIP
    """

    @_one_thread
    def __init__(self, bank: Bank, config: PipelineConfig = PipelineConfig()) -> None:  # noqa: B008
        self._mount = config.mount
        self.extractor = PersonExtractor(config.segment, config.denoise)
        self.matcher = Matcher(bank, config.match, config.fit)
        self.refiner = Refiner(bank, config.refine, config.match, config.fitting)
        self.recoverer = Recoverer(bank, config.recover, config.smooth, config.fitting)
        self._stages = (self.extractor, self.matcher, self.refiner, self.recoverer)

    @_one_thread
    def process_frame(self, frame: DepthFrame) -> FrameResult:
        """Estimate the pose in one frame; frames of a sequence are given in their order."""
        # Sec. 4: cut the person out, modified LOP, outliers
        cloud = self.extractor.extract(turn_upright(frame, self._mount))
        # Sec. 5: canonical axes, PCA subspace, nearest exemplars (eq. 6)
        match = self.matcher.match(cloud)
        # Sec. 6: fit the body to the cloud, complete what is hidden (eqs. 7, 8)
        refined = self.refiner.refine(cloud, match)
        # Sec. 6: failure check, temporal registration, low-pass filter
        skeleton = self.recoverer.recover(cloud, refined)
        answer = turn_back(skeleton, self._mount)
        self.refiner.take_answer(turn_forth(answer, self._mount))
        return FrameResult(cloud, match, refined, answer)

    def reset(self) -> None:
        """Forget all earlier frames."""
        for stage in self._stages:
            stage.reset()

    def warm_up(self) -> None:
        """Compile (or load from the cache) every kernel, so that the first frame is not late."""
        for stage in self._stages:
            stage.warm_up()
