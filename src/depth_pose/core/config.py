"""Settings: one frozen dataclass per step, each field with its unit, range and one line of help.

A setting is what a user may need to change: a number, a switch or a word. ROS parameters, command-line
options and YAML files are made from these fields, so every default stands here and nowhere else. All other
values are constants beside the code that uses them (`depth_pose.tuning`).
"""

from __future__ import annotations

from dataclasses import dataclass

from depth_pose.core.errors import ConfigError
from depth_pose.core.options import Checked, Sections, option
from depth_pose.core.zone import parse_zone


@dataclass(frozen=True)
class MountConfig(Checked):
    """How the sensor is mounted."""

    roll: float = option(
        0.0,
        "Rotation of the sensor about its optical axis, clockwise in viewing direction; 180: upside down",
        unit="deg",
        low=-360.0,
        high=360.0,
    )
    pitch: float = option(
        0.0,
        "Approximate downward pitch of the sensor: 0 level, 90 under a ceiling; separates floor from walls",
        unit="deg",
        low=-90.0,
        high=90.0,
    )


@dataclass(frozen=True)
class SegmentConfig(Checked):
    """Finding the people in the depth image (Sec. 4, first paragraph)."""

    method: str = option(
        "learned",
        "learned: all people, by a small net; planes: one person, separated from large planes",
        choices=("learned", "planes"),
    )
    near: float = option(0.4, "Ignore anything nearer than this", unit="m", low=0.0, high=20.0)
    far: float = option(8.0, "Ignore anything farther than this", unit="m", low=0.1, high=50.0)
    mirror: bool = option(
        False,
        "Also process each person's mirror image: 5 ms more, proposed joints 5 % nearer; "
        "set by run --passes 2; learned only",
    )
    working_height: int = option(
        180, "Images with more rows than this are reduced to about it", unit="px", low=48, high=1080
    )
    speed: str = option(
        "normal",
        "low: everybody is measured and fitted anew in every frame; normal: who has not moved keeps the last "
        "measurement for a while; high: everybody keeps it for one frame, whoever was measured well is "
        "measured by a smaller net; learned only",
        choices=("low", "normal", "high"),
    )
    most_people: int = option(0, "Maximum number of people, the nearest; 0: all", low=0, high=254)
    zone: str = option(
        "",
        "Only people in this zone, sensor's frame, metres: distances, 1.0:4.5, or a box, X0:X1,Z0:Z1 or "
        "X0:X1,Y0:Y1,Z0:Z1; empty: everywhere",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.near >= self.far:
            raise ConfigError(
                f"SegmentConfig.near is {self.near:g} m and far {self.far:g} m: nothing lies between"
            )
        parse_zone(self.zone)


@dataclass(frozen=True)
class DenoiseConfig(Checked):
    """Modified locally optimal projection (Sec. 4, eqs. 1 to 5)."""

    iterations: int = option(
        1,
        "Number of iterations; the first is eqs. 1 and 2, each further one eqs. 3 to 5",
        low=0,
        high=20,
    )


@dataclass(frozen=True)
class MatchConfig(Checked):
    """Matching with the exemplar bank (Sec. 5)."""

    method: str = option(
        "joints",
        "joints: by the cloud and by proposed joints, which the fit and the result use as well; "
        "exemplars: the paper's method, by the cloud alone, without proposed joints in any step",
        choices=("joints", "exemplars"),
    )


@dataclass(frozen=True)
class RefineConfig(Checked):
    """Fitting the body to the cloud (Sec. 6)."""

    method: str = option(
        "articulated",
        "articulated: joint angles of a skinned body; cpd: the paper's registration and completion",
        choices=("articulated", "cpd"),
    )


@dataclass(frozen=True)
class PersonalConfig(Checked):
    """Personal builds (`depth_pose.refine.personal`)."""

    personal: bool = option(True, "Find each person's proportions while they are followed")
    file: str = option("", "Build to begin with, as depth-pose run --save-build wrote it; empty: average")
    scale: float = option(
        0.0, "The person's size relative to a 1.75 m adult; 0: estimated", low=0.0, high=2.0
    )


@dataclass(frozen=True)
class RecoverConfig(Checked):
    """Failure detection and temporal registration (Sec. 6, last part)."""

    min_probability: float = option(
        0.5,
        "Minimum probability, from all that is seen of somebody, that they are a person",
        low=0.0,
        high=1.0,
    )
    min_confidence: float = option(
        0.25, "Skeletons less certain than this count as failures", low=0.0, high=1.0
    )
    max_time: float = option(
        2.0, "How long poses are carried over before the person counts as lost", unit="s", low=0.0, high=60.0
    )


@dataclass(frozen=True)
class SmoothConfig(Checked):
    """Low-pass filter on the published joints (Sec. 6): One-Euro filter, Casiez et al., CHI 2012.

    Defaults: the best of a grid on recordings and simulated clips (docs/accuracy.md, The filter).
    """

    enabled: bool = option(True, "Filter the joint positions over time")
    min_cutoff: float = option(0.5, "Cut-off frequency at rest", unit="Hz", low=0.01, high=100.0)
    beta: float = option(24.0, "Cut-off frequency gained per speed", unit="Hz s/m", low=0.0, high=100.0)


@dataclass(frozen=True)
class FollowConfig(Checked):
    """The person on ``/depth_pose/skeleton``; all people are on ``/depth_pose/skeletons``."""

    whom: str = option(
        "first",
        "first: the first to appear; nearest: to the camera; centre: of the image",
        choices=("first", "nearest", "centre"),
    )
    patient: bool = option(False, "Wait 2 s for the followed person to return before another is chosen")


@dataclass(frozen=True)
class PipelineConfig(Sections):
    """All steps' settings."""

    mount: MountConfig = MountConfig()
    segment: SegmentConfig = SegmentConfig()
    denoise: DenoiseConfig = DenoiseConfig()
    match: MatchConfig = MatchConfig()
    refine: RefineConfig = RefineConfig()
    build: PersonalConfig = PersonalConfig()
    recover: RecoverConfig = RecoverConfig()
    smooth: SmoothConfig = SmoothConfig()
    follow: FollowConfig = FollowConfig()


SHORT_NAMES: dict[str, tuple[str, str]] = {
    "follow": ("follow", "whom"),
    "zone": ("segment", "zone"),
    "build": ("build", "file"),
}
"""ROS parameters that are named without their section: the name, and the setting's section and field."""


MAX_STAMP_GAP_NS = 500_000_000
"""Temporal state is dropped when stamps jump back, or ahead by more than this."""
