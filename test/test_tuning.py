"""Constants: listed completely, and printed by one command."""

from __future__ import annotations

import ast
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from command import Done, caller
from depth_pose.core.config import PipelineConfig
from depth_pose.core.settings_file import read_settings
from depth_pose.tuning import Tuning
from depth_pose.volume.tuning import VolumeTuning

SOURCES = Path(__file__).parents[1] / "src" / "depth_pose"


@pytest.fixture
def call(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., Done]:
    return caller(monkeypatch, capsys)


def declared() -> dict[str, tuple[str, ...]]:
    """Return the fields of every class of constants in the package, by the class's name."""
    found = {}
    for path in SOURCES.rglob("*tuning.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef):
                fields = [n.target.id for n in node.body if isinstance(n, ast.AnnAssign)]
                found[node.name] = tuple(fields)
    return found


def test_every_constant_is_part_of_the_whole() -> None:
    whole = {type(part).__name__: part._fields for part in (*Tuning(), *VolumeTuning())}
    assert whole | {t.__name__: t._fields for t in (Tuning, VolumeTuning)} == declared()


def test_one_command_prints_all_values(call: Callable[..., Done]) -> None:
    done = call("settings", "--all")
    assert done.returncode == 0
    told = yaml.safe_load(done.stdout)
    assert told["settings"] == PipelineConfig().as_mapping()
    assert told["constants"]["fit"]["sigmas"] == list(Tuning().fit.sigmas)
    assert told["constants"]["detect"] == Tuning().detect._asdict()
    assert told["volume"]["constants"]["track"] == VolumeTuning().track._asdict()
    assert all(len(digest) == 16 for digest in told["weights"].values())


def test_printed_settings_are_a_settings_file(call: Callable[..., Done], tmp_path: Path) -> None:
    done = call("settings")
    (tmp_path / "my.yaml").write_text(done.stdout, encoding="utf-8")
    assert PipelineConfig.from_mapping(read_settings(tmp_path / "my.yaml")) == PipelineConfig()
    assert "# Ignore anything nearer than this (0 to 20 m)" in done.stdout
