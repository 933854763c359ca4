"""Stages of the pipeline by themselves, as the pipeline makes them."""

from __future__ import annotations

from depth_pose.bank import Bank
from depth_pose.core.config import PipelineConfig
from depth_pose.match.match import Matcher
from depth_pose.recover.recover import FailureRecovery
from depth_pose.refine.refine import Refiner
from depth_pose.stages import StageFactory
from depth_pose.tuning import Tuning


def make_matcher(bank: Bank, tuning: Tuning = Tuning(), **sections) -> Matcher:
    return StageFactory(bank, PipelineConfig(**sections), tuning).make_matcher()


def make_refiner(bank: Bank, tuning: Tuning = Tuning(), **sections) -> Refiner:
    return StageFactory(bank, PipelineConfig(**sections), tuning).make_refiner()


def make_recoverer(bank: Bank, tuning: Tuning = Tuning(), **sections) -> FailureRecovery:
    return StageFactory(bank, PipelineConfig(**sections), tuning).make_recoverer()
