"""The body and a small bank of it, made once and shared by all tests."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest

from depth_pose.bank import Bank, build_bank
from depth_pose.bank.build import BuildConfig
from depth_pose.body.procedural import TEMPLATE, make_body
from depth_pose.motion.procedural.generator import make_poses

POSES = 300
SEED = 1

_PACKAGE = Path(__file__).parents[1] / "src" / "depth_pose"


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
