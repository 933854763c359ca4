"""What all tests share: which may be skipped, the body, and a small bank of it, made once."""

from __future__ import annotations

import fcntl
import hashlib
import re
from collections.abc import Generator
from pathlib import Path
from typing import Any

import pytest

from depth_pose.bank import Bank, build_bank
from depth_pose.bank.build import BuildConfig
from depth_pose.body.procedural import TEMPLATE, make_body
from depth_pose.motion.procedural.generator import make_poses

POSES = 300
SEED = 1

ALLOWED_SKIPS = (
    r"needs \.\./shared\b",  # data that is handed out beside the project
    r"the extra 'anny' is not installed$",  # 5 GB
    r"Node\.js is not installed$",  # draws the example's web page
    r"(launch|vision_msgs|people_msgs) comes with ROS 2 from apt$",
    r"this account can make no network of its own$",  # a container's, or the kernel forbids it
    r"ezc3d has no wheel for this machine$",
    r"needs a Chromium\b",  # that DEPTH_POSE_CHROMIUM names, and playwright
)
"""Why a test may be skipped. For any other reason it fails: an install that lacks something is not whole."""

TOGETHER = (r"test/ros/test_[a-l]", r"test/ros/|test/fuzz/test_fuzz_nodes", r"test/viewer/")
"""Tests that start nodes or servers and watch the clock: one at a time of each group, on its own domain."""

_PACKAGE = Path(__file__).parents[1] / "src" / "depth_pose"


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Have ``pytest -n`` keep the tests of a file together, which share fixtures, and those `TOGETHER`."""
    from xdist.scheduler import LoadScopeScheduling

    class ByFile(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            groups = (group for group in TOGETHER if re.match(group, nodeid))
            return next(groups, nodeid.partition("::")[0])

        def _reschedule(self, node: Any) -> None:
            if node in self.registered_collections:  # not a worker that starts for one that died
                super()._reschedule(node)

    return ByFile(config, log)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Let tests fail that are skipped for a reason that is not allowed."""
    report = yield
    _fail_unless_allowed(report)
    return report


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report() -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """The same for whole files."""
    report = yield
    _fail_unless_allowed(report)
    return report


def _fail_unless_allowed(report):
    if report.outcome != "skipped" or hasattr(report, "wasxfail"):
        return
    reason = report.longrepr[2].removeprefix("Skipped: ")
    if not any(re.match(allowed, reason) for allowed in ALLOWED_SKIPS):
        report.outcome = "failed"
        report.longrepr = f"skipped, but this reason is not allowed (test/conftest.py): {reason}"


@pytest.fixture(scope="session")
def body():
    """The default procedural body."""
    return make_body()


def _sources_hash():
    """Hash of all source files that a bank depends on."""
    files = [_PACKAGE / "core/skeleton.py", _PACKAGE / "core/rotations.py", Path(__file__)]
    for folder in ("body", "motion", "bank"):
        files += sorted(_PACKAGE.glob(f"{folder}/**/*.py"))
    files.append(TEMPLATE)
    digest = hashlib.sha256()
    for file in files:
        digest.update(file.name.encode() + file.read_bytes())
    return digest.hexdigest()[:16]


@pytest.fixture(scope="session")
def bank_path(body, pytestconfig, tmp_path_factory):
    """A bank file of a few hundred poses; kept in pytest's cache until its sources change."""
    cache = getattr(pytestconfig, "cache", None)
    folder = cache.mkdir("depth_pose_bank") if cache else tmp_path_factory.mktemp("bank")
    path = folder / f"{_sources_hash()}.npz"
    with (folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # of two processes that run tests one builds it
        if not path.exists():
            for old in folder.glob("*.npz"):
                old.unlink(missing_ok=True)
            poses = make_poses(POSES, seed=SEED)
            source = {"poses": "procedural", "count": POSES, "seed": SEED}
            build_bank(body, poses.rotations, BuildConfig(dimensions=32), source, workers=0).save(path)
    return path


@pytest.fixture(scope="session")
def bank(bank_path):
    """The same bank, loaded."""
    return Bank.load(bank_path)
