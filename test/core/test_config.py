"""Settings: every field documents itself; wrong ones are refused by name."""

from __future__ import annotations

import dataclasses

import pytest

from depth_pose.bank.build import BuildConfig
from depth_pose.core import config as cfg
from depth_pose.core.config import PipelineConfig, SegmentConfig
from depth_pose.core.errors import ConfigError, DepthPoseError
from depth_pose.core.options import from_mapping, options
from depth_pose.core.removed_options import explain_removed

SECTIONS = {f.name: type(f.default) for f in dataclasses.fields(PipelineConfig)}


@pytest.mark.parametrize("section", [*SECTIONS.values(), BuildConfig], ids=[*SECTIONS, "build"])
def test_every_setting_says_what_it_is_and_its_range(section):
    assert list(options(section))
    for o in options(section):
        assert o.help
        assert o.help[0].isupper() or any(o.help.startswith(choice) for choice in o.choices)
        if isinstance(o.default, bool | str):
            assert isinstance(o.default, bool) or o.default in (o.choices or ("",))
            continue
        assert o.low is not None, f"{section.__name__}.{o.name} has no least value"
        assert o.low <= o.default
        assert o.high is None or o.default <= o.high


@pytest.mark.parametrize("section", [*SECTIONS.values(), BuildConfig], ids=[*SECTIONS, "build"])
def test_values_beyond_the_range_are_refused_by_name(section):
    for o in options(section):
        kind = type(o.default)
        room = {"near": {"far": 50.0}, "far": {"near": 0.0}}.get(o.name, {})
        for value in (o.low, o.high):
            if value is not None:
                section(**{o.name: kind(value)} | room)
        if o.low is not None:
            with pytest.raises(ConfigError, match=rf"{section.__name__}\.{o.name} is .*least"):
                section(**{o.name: kind(o.low - 1)})
        if o.high is not None:
            with pytest.raises(ConfigError, match=rf"{section.__name__}\.{o.name} is .*most"):
                section(**{o.name: kind(o.high + 1)})
        if o.choices:
            with pytest.raises(ConfigError, match="it is one of"):
                section(**{o.name: "nonsense"})


@pytest.mark.parametrize(("near", "far"), [(9.0, 8.0), (3.0, 3.0)])
def test_near_beyond_far_is_refused(near, far):
    with pytest.raises(ConfigError, match="nothing lies between"):
        SegmentConfig(near=near, far=far)


def test_nan_is_refused():
    with pytest.raises(ConfigError, match=r"SegmentConfig\.near is NaN"):
        SegmentConfig(near=float("nan"))


def test_frozen():
    with pytest.raises(dataclasses.FrozenInstanceError):
        SegmentConfig().near = 1.0  # type: ignore[misc]


def test_options_of_an_instance_carry_its_values():
    values = {o.name: o.default for o in options(SegmentConfig(near=1.5))}
    assert values["near"] == 1.5
    assert values["far"] == SegmentConfig().far


def test_from_mapping():
    made = from_mapping(SegmentConfig, {"near": 1, "most_people": 3})
    assert made.near == 1.0
    assert isinstance(made.near, float)  # YAML writes 1 for 1.0
    assert made.most_people == 3


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"nearr": 1.0}, r"SegmentConfig has no setting nearr; it has far"),
        ({"near": "1.0"}, r"SegmentConfig\.near is '1\.0'; it must be of type float"),
        ({"near": True}, r"near is True; it must be of type float"),
        ({"most_people": 3.5}, r"most_people is 3\.5; it must be of type int"),
        ({"near": -1.0}, r"near is -1\.0; the least it may be is 0\.0 m"),
        ({"near": None}, r"near is None"),
    ],
)
def test_from_mapping_refuses(values, message):
    with pytest.raises(ConfigError, match=message):
        from_mapping(SegmentConfig, values)
    with pytest.raises(DepthPoseError):
        PipelineConfig.from_mapping({"segment": values})


def test_a_user_has_few_settings():
    """Everything else is a constant beside its code."""
    assert sum(len(list(options(section))) for section in SECTIONS.values()) <= 25


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("fit.damping", r"fit\.damping is no longer a setting; leave it out: .* depth-pose settings --all"),
        ("segment.keep", r"segment\.keep is no longer a setting; leave it out"),
        ("recover.enabled", r"recover\.enabled is no longer a setting; leave it out"),
        ("match.scale", r"match\.scale is no longer a setting; give build\.scale"),
        ("match.budget", r"match\.budget is no longer a setting; .* time_budget"),
        ("cpd.cooling", r"cpd\.cooling is no longer a setting; the registration has no such term"),
    ],
)
def test_former_settings_are_refused_with_what_replaced_them(name, reason):
    section, field = name.split(".")
    with pytest.raises(ConfigError, match=reason):
        PipelineConfig.from_mapping({section: {field: 1.0}})


def test_no_setting_is_called_a_former_one():
    for section, config in SECTIONS.items():
        for o in options(config):
            assert explain_removed(section, o.name) is None


def test_former_sections_are_refused_even_if_empty_or_mistyped():
    for values in ({"fit": {}}, {"fit": {"dampng": 1.0}}):
        with pytest.raises(ConfigError, match="no such section: fit; there are mount, segment"):
            PipelineConfig.from_mapping(values)


def test_pipeline_round_trip():
    made = PipelineConfig.from_mapping({"segment": {"near": 0.7}, "refine": {"method": "cpd"}})
    assert made.segment.near == 0.7
    assert made.refine.method == "cpd"
    assert made.denoise == cfg.DenoiseConfig()
    assert PipelineConfig.from_mapping(made.as_mapping()) == made
    assert set(made.as_mapping()) == set(SECTIONS)


def test_unknown_section():
    with pytest.raises(ConfigError, match="no such section: segmnt; there are mount, segment"):
        PipelineConfig.from_mapping({"segmnt": {}})
