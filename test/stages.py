"""Stages of the pipeline by themselves, as the pipeline makes them."""

from __future__ import annotations

from depth_pose.bank import Bank
from depth_pose.core.config import PipelineConfig
from depth_pose.match.match import Matcher
from depth_pose.recover.recover import Recoverer
from depth_pose.refine.refine import Refiner
from depth_pose.stages import Shared


def make_matcher(bank: Bank, **sections) -> Matcher:
    return Shared(bank, PipelineConfig(**sections)).make_matcher()


def make_refiner(bank: Bank, **sections) -> Refiner:
    return Shared(bank, PipelineConfig(**sections)).make_refiner()


def make_recoverer(bank: Bank, **sections) -> Recoverer:
    return Shared(bank, PipelineConfig(**sections)).make_recoverer()
