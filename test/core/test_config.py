"""Settings: every field documents itself; wrong ones are refused by name."""

from __future__ import annotations

import dataclasses
from array import array

import pytest

from depth_pose.bank.build import BuildConfig
from depth_pose.core import config as cfg
from depth_pose.core.config import PipelineConfig, SegmentConfig
from depth_pose.core.errors import ConfigError, DepthPoseError
from depth_pose.core.options import from_mapping, options

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
        for value in o.default if isinstance(o.default, tuple) else (o.default,):
            assert o.low <= value
            assert o.high is None or value <= o.high


@pytest.mark.parametrize("section", [*SECTIONS.values(), BuildConfig], ids=[*SECTIONS, "build"])
def test_values_beyond_the_range_are_refused_by_name(section):
    for o in options(section):

        def like_default(value, default=o.default):
            is_list = isinstance(default, tuple)
            return (float(value),) * len(default) if is_list else type(default)(value)

        room = {"near": {"far": 50.0}, "far": {"near": 0.0}}.get(o.name, {})
        for value in (o.low, o.high):
            if value is not None:
                section(**{o.name: like_default(value)} | room)
        if o.low is not None:
            with pytest.raises(ConfigError, match=rf"{section.__name__}\.{o.name} is .*least"):
                section(**{o.name: like_default(o.low - 1)})
        if o.high is not None:
            with pytest.raises(ConfigError, match=rf"{section.__name__}\.{o.name} is .*most"):
                section(**{o.name: like_default(o.high + 1)})
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
    made = from_mapping(SegmentConfig, {"near": 1, "min_support": 3})
    assert made.near == 1.0
    assert isinstance(made.near, float)  # YAML writes 1 for 1.0
    assert made.min_support == 3


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"nearr": 1.0}, r"SegmentConfig has no setting nearr; it has depth_jump"),
        ({"near": "1.0"}, r"SegmentConfig\.near is '1\.0'; it must be of type float"),
        ({"near": True}, r"near is True; it must be of type float"),
        ({"min_support": 3.5}, r"min_support is 3\.5; it must be of type int"),
        ({"near": -1.0}, r"near is -1\.0; the least it may be is 0\.0 m"),
        ({"near": None}, r"near is None"),
    ],
)
def test_from_mapping_refuses(values, message):
    with pytest.raises(ConfigError, match=message):
        from_mapping(SegmentConfig, values)
    with pytest.raises(DepthPoseError):
        PipelineConfig.from_mapping({"segment": values})


def test_lists_of_numbers():
    made = PipelineConfig.from_mapping({"fit": {"sigmas": [1, 0.5, 0.1, 0.05]}})
    assert made.fit.sigmas == made.fitting.fit.sigmas == (1.0, 0.5, 0.1, 0.05)
    assert (
        from_mapping(cfg.FitConfig, {"sigmas": array("d", [0.1] * 4)}).sigmas == (0.1,) * 4
    )  # as ROS gives it
    for wrong in ([0.1, "0.1"], 0.1, "0.1", None):
        with pytest.raises(ConfigError, match=r"FitConfig\.sigmas is .* must be"):
            from_mapping(cfg.FitConfig, {"sigmas": wrong})
    with pytest.raises(ConfigError, match=r"FitConfig\.sigmas is 0\.0; the least it may be is 0\.001 m"):
        from_mapping(cfg.FitConfig, {"sigmas": [0.1, 0.1, 0.1, 0.0]})
    with pytest.raises(ConfigError, match="has 3 values; give at least 4"):
        from_mapping(cfg.FitConfig, {"sigmas": [0.1, 0.1, 0.1]})


@pytest.mark.parametrize("count", [4, 7, 8, 11])
def test_stages_share_one_schedule(count):
    config = cfg.FitConfig(sigmas=tuple(0.01 * (20 - k) for k in range(count)))
    assert config.glance + config.rough + config.fine == config.sigmas
    assert all((config.glance, config.rough, config.fine))
    assert config.trial == config.sigmas[: len(config.trial)]


def test_pipeline_round_trip():
    made = PipelineConfig.from_mapping(
        {"segment": {"near": 0.7}, "refine": {"method": "cpd", "track": False}}
    )
    assert made.segment.near == 0.7
    assert made.refine.method == "cpd"
    assert made.denoise == cfg.DenoiseConfig()
    assert PipelineConfig.from_mapping(made.as_mapping()) == made
    assert set(made.as_mapping()) == set(SECTIONS)


def test_unknown_section():
    with pytest.raises(ConfigError, match="no such section: segmnt; there are mount, segment"):
        PipelineConfig.from_mapping({"segmnt": {}})
