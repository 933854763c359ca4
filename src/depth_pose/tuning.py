"""All constants that were chosen together with the shipped weights and the default bank.

Each stage keeps its own beside its code; settings, which a user may change, are in
`depth_pose.core.config`. ``depth-pose settings --all`` prints both.
"""

from __future__ import annotations

from typing import NamedTuple

from depth_pose.denoise.tuning import DenoiseTuning
from depth_pose.detect.tuning import DetectTuning
from depth_pose.match.tuning import MatchTuning
from depth_pose.paper.tuning import CompletionTuning, CpdTuning
from depth_pose.recover.tuning import RecoverTuning, TemporalTuning
from depth_pose.refine.tuning import BuildTuning, FitTuning, RefineTuning


class Tuning(NamedTuple):
    """Constants of all stages; benchmarks and tests change some of them."""

    detect: DetectTuning = DetectTuning()
    denoise: DenoiseTuning = DenoiseTuning()
    match: MatchTuning = MatchTuning()
    refine: RefineTuning = RefineTuning()
    fit: FitTuning = FitTuning()
    build: BuildTuning = BuildTuning()
    cpd: CpdTuning = CpdTuning()
    completion: CompletionTuning = CompletionTuning()
    recover: RecoverTuning = RecoverTuning()
    temporal: TemporalTuning = TemporalTuning()
