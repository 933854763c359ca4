"""Settings: one frozen dataclass per step, each field with its unit, range and one line of help.

A setting is a number, a switch, one of some words, or a list of numbers, of which the range holds for
each. ROS parameters, command-line options and YAML files are made from these fields, so every
default stands here and nowhere else.
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
    start: float = option(0.6, "Minimum probability at which a person is tracked", low=0.0, high=1.0)
    sure: float = option(
        0.9, "Below this probability a person is tracked only after moving", low=0.0, high=1.0
    )
    keep: float = option(0.2, "Minimum probability of a person who is tracked already", low=0.0, high=1.0)
    near: float = option(0.4, "Ignore anything nearer than this", unit="m", low=0.0, high=20.0)
    far: float = option(8.0, "Ignore anything farther than this", unit="m", low=0.1, high=50.0)
    find_every: int = option(
        2,
        "Frames from one search of the image for people to the next, while all are sure; learned only",
        low=1,
        high=100,
    )
    look_every: int = option(
        2,
        "Frames from one close look at a person to the next, where there are more than two; learned only",
        low=1,
        high=100,
    )
    mirror: bool = option(
        False,
        "Also process each person's mirror image: 5 ms more, proposed joints 5 % nearer; "
        "set by run --passes 2; learned only",
    )
    working_height: int = option(
        180, "Images with more rows than this are reduced to about it", unit="px", low=48, high=1080
    )
    depth_jump: float = option(
        0.08,
        "Neighbouring pixels this far apart in depth are different surfaces",
        unit="m",
        low=0.01,
        high=1.0,
    )
    min_support: int = option(
        7, "Keep a pixel if this many of its 24 neighbours are on its surface", low=0, high=24
    )
    min_height: float = option(
        0.4, "Least visible extent of a person; planes only", unit="m", low=0.1, high=2.0
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

    support_radius: float = option(
        0.2, "Support h of the weight theta(r) = exp(-16 r^2 / h^2)", unit="m", low=0.01, high=1.0
    )
    repulsion: float = option(0.35, "Repulsion weight mu of eq. 3", low=0.0, high=0.499)
    iterations: int = option(
        1,
        "Number of iterations; the first is eqs. 1 and 2, each further one eqs. 3 to 5",
        low=0,
        high=20,
    )
    outlier_distance: float = option(
        0.06, "Drop points whose nearest neighbour is farther than this", unit="m", low=0.01, high=1.0
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
    shortlist: int = option(
        32, "Nearest exemplars in the subspace that are compared by rendered depth", low=1, high=4096
    )
    keep: int = option(3, "Candidates handed to the refinement", low=1, high=64)
    search_every: int = option(
        3,
        "Frames from one search for a person's exemplars to the next, once their size is known",
        low=1,
        high=100,
    )
    score_band: float = option(
        0.12, "Depth difference that counts as a full mismatch", unit="m", low=0.01, high=1.0
    )
    scale_frames: int = option(
        10, "Frames over which the person's size is estimated before it is held", low=1, high=1000
    )
    scale: float = option(0.0, "The person's size relative to a 1.75 m adult; 0 finds it", low=0.0, high=2.0)
    budget: float = option(
        0.06,
        "Live, time for all people of a frame; people left out come first in the next one; 0: no limit",
        unit="s",
        low=0.0,
        high=10.0,
    )


@dataclass(frozen=True)
class RefineConfig(Checked):
    """Fitting the body to the cloud (Sec. 6)."""

    method: str = option(
        "articulated",
        "articulated: joint angles of a skinned body; cpd: the paper's registration and completion",
        choices=("articulated", "cpd"),
    )
    track: bool = option(True, "Try the previous frame's pose beside the fresh candidates")
    beam: int = option(
        1,
        "Poses of a person that are kept from frame to frame: the answer, and so many less one that differ "
        "from it and agree next best; with 2 each frame takes 2 ms more and errs as much (docs/accuracy.md)",
        low=1,
        high=5,
    )


@dataclass(frozen=True)
class FitConfig(Checked):
    """The articulated fit (`depth_pose.refine.articulated`).

    The stages share one annealing schedule, ``sigmas``, and take parts of it: a first look at many starts
    (`glance`), a choice between a few (`rough`), the answer (`fine`), and a trial of a
    size (`trial`).
    """

    sigmas: tuple[float, ...] = option(
        (0.06, 0.05, 0.04, 0.034, 0.028, 0.024, 0.02, 0.02),
        "Standard deviation of the points about the skin in each iteration, coarse to fine",
        unit="m",
        low=0.001,
        high=1.0,
    )
    coarse_sigma: float = option(
        0.03,
        "In iterations above this a third of the points and half of the skin do",
        unit="m",
        low=0.0,
        high=1.0,
    )
    outlier: float = option(
        0.3,
        "Density of the outlier class in the E-step",
        low=1e-6,
        high=100.0,
    )
    plane_weight: float = option(1.0, "Weight of the distance along the skin's normal", low=0.0, high=100.0)
    point_weight: float = option(0.3, "Weight of the whole distance", low=1e-3, high=100.0)
    free_space_weight: float = option(
        0.15,
        "Weight of skin that stands where free space was seen, and before the surface",
        low=0.0,
        high=100.0,
    )
    free_space_slack: float = option(
        0.04, "Skin may stand before the seen surface by this", unit="m", low=0.0, high=1.0
    )
    free_space_limit: float = option(
        0.10, "Out of free space skin is pulled by at most this a step", unit="m", low=0.0, high=1.0
    )
    proposal_weight: float = option(
        5.0,
        "Weight of a proposed joint, in points of the cloud of the same standard deviation; 0: ignored",
        low=0.0,
        high=1000.0,
    )
    floor_weight: float = option(
        5.0,
        "Weight of the floor under a foot that is near it, in points of the cloud of the same standard "
        "deviation; 0: ignored",
        low=0.0,
        high=1000.0,
    )
    prior: float = option(0.1, "Stiffness of the joints toward the start", low=0.0, high=100.0)
    damping: float = option(0.02, "Added to the diagonal of every step", low=1e-6, high=100.0)
    max_step: float = option(0.35, "The most that a joint turns in a step", unit="rad", low=0.01, high=3.2)
    max_points: int = option(800, "Points of the cloud that are fitted to", low=10, high=1_000_000)

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.sigmas) < 4:
            raise ConfigError(f"FitConfig.sigmas has {len(self.sigmas)} values; give at least 4")

    @property
    def glance(self) -> tuple[float, ...]:
        """The first quarter of the schedule: enough to tell which starts are worth more."""
        return self.sigmas[: len(self.sigmas) // 4]

    @property
    def rough(self) -> tuple[float, ...]:
        """The second quarter, which continues from `glance`."""
        return self.sigmas[len(self.sigmas) // 4 : len(self.sigmas) // 2]

    @property
    def fine(self) -> tuple[float, ...]:
        """The second half, which continues from `rough`."""
        return self.sigmas[len(self.sigmas) // 2 :]

    @property
    def trial(self) -> tuple[float, ...]:
        """The first three quarters: enough to compare two sizes by their scores."""
        return self.sigmas[: 3 * len(self.sigmas) // 4]


@dataclass(frozen=True)
class PersonalConfig(Checked):
    """Personal builds (`depth_pose.refine.personal`)."""

    personal: bool = option(True, "Find each person's proportions while they are followed")
    file: str = option("", "Build to begin with, as depth-pose run --save-build wrote it; empty: average")
    sigma: float = option(
        0.02, "Standard deviation of the points about the skin, where a build is learned", unit="m",
        low=0.001, high=1.0,
    )  # fmt: skip
    noise: float = option(
        0.035,
        "How far off a point is if points were independent; greater than a sensor's noise, since neighbours "
        "and frames err alike",
        unit="m",
        low=0.001,
        high=10.0,
    )
    free_space: float = option(
        0.1,
        "Weight of skin in free space, as a share of that in the fit: noise eats the silhouette's border, "
        "and a build would shrink with it",
        low=0.0,
        high=10.0,
    )
    memory: float = option(
        20.0, "What was seen of a build is forgotten over this time", unit="s", low=0.1, high=1e6
    )
    worst_score: float = option(
        0.4,
        "Frames whose fit disagrees more than this, 0 to 1, are not used for the build",
        low=0.0,
        high=1.0,
    )


@dataclass(frozen=True)
class CpdConfig(Checked):
    """Coherent point drift from exemplar to input (Sec. 6), for the method ``cpd``."""

    beta: float = option(0.7, "Width of the coherence kernel", unit="m", low=0.001, high=10.0)
    stiffness: float = option(20.0, "Weight lambda of the coherence", low=1e-6, high=1e6)
    outlier_weight: float = option(
        0.1, "Share w of the input points that are expected to be outliers", low=1e-6, high=0.999
    )
    sigma_start: float = option(0.06, "Standard deviation at the start", unit="m", low=1e-4, high=10.0)
    sigma_floor: float = option(0.012, "The least standard deviation", unit="m", low=1e-5, high=1.0)
    cooling: float = option(
        1.0,
        "Greatest ratio of an iteration's variance to the one before; below 1 it always falls",
        low=0.01,
        high=1.0,
    )
    basis_points: int = option(60, "Vertices from which the kernel is approximated", low=1, high=10_000)
    tolerance: float = option(
        5e-4,
        "The registration ends when no point moves farther than this in a step",
        unit="m",
        low=0.0,
        high=1.0,
    )
    max_iterations: int = option(20, "The most iterations", low=0, high=10_000)


@dataclass(frozen=True)
class CompletionConfig(Checked):
    """Registration and Laplacian completion of the mesh (Sec. 6, eq. 7), for the method ``cpd``."""

    passes: int = option(
        2,
        "How many times the whole is done, each from the body posed at the joints of the one before",
        low=1,
        high=20,
    )
    weight: float = option(0.1, "Weight w of a correspondence in eq. 7", low=1e-6, high=1e3)
    max_vertices: int = option(600, "Visible vertices that are registered", low=10, high=1_000_000)
    max_points: int = option(600, "Input points that are registered", low=10, high=1_000_000)
    visible_tolerance: float = option(
        0.05,
        "A vertex is seen if it lies at most this far behind the rendered depth",
        unit="m",
        low=0.0,
        high=1.0,
    )
    min_probability: float = option(
        0.1, "Least P1 of a vertex that counts as a correspondence", low=0.0, high=1e3
    )
    min_facing: float = option(
        0.55,
        "Least cosine of a vertex's normal and its ray for the same; beyond it skin slides sideways",
        low=0.0,
        high=1.0,
    )
    geodesic: bool = option(True, "Distances of the coherence kernel run along the surface")


@dataclass(frozen=True)
class TemporalConfig(Checked):
    """Registration of one frame's cloud to the next (Sec. 6); the rest is as in `CpdConfig`.

    The field is less stiff than from exemplar to input: both clouds show the same person.
    """

    beta: float = option(0.5, "Width of the coherence kernel", unit="m", low=0.001, high=10.0)
    stiffness: float = option(4.0, "Weight lambda of the coherence", low=1e-6, high=1e6)
    reach: float = option(
        0.05,
        "A vertex goes with the points of its own frame within this, near ones more",
        unit="m",
        low=1e-4,
        high=1.0,
    )
    weight: float = option(0.1, "Weight of a correspondence in eq. 7", low=1e-6, high=1e3)


@dataclass(frozen=True)
class RecoverConfig(Checked):
    """Failure detection and temporal registration (Sec. 6, last part)."""

    enabled: bool = option(True, "Look for failures and recover from them")
    bone_change: float = option(
        0.25, "Relative change of a bone's length between frames that counts as a failure", low=0.01, high=2.0
    )
    angle_excess: float = option(
        60.0, "Degrees beyond a joint's limit that count as a failure", unit="deg", low=0.0, high=360.0
    )
    joint_speed: float = option(
        6.0, "A joint that seems to move faster than this has jumped", unit="m/s", low=0.5, high=100.0
    )
    score_rise: float = option(
        0.06,
        "Sudden rise of the fit's rendered-depth disagreement (0 to 1) that counts as a failure",
        low=0.005,
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
class FittingConfig(Sections):
    """Settings of the fits, which several steps run."""

    fit: FitConfig = FitConfig()
    build: PersonalConfig = PersonalConfig()
    cpd: CpdConfig = CpdConfig()
    completion: CompletionConfig = CompletionConfig()
    temporal: TemporalConfig = TemporalConfig()


@dataclass(frozen=True)
class PipelineConfig(Sections):
    """All steps' settings."""

    mount: MountConfig = MountConfig()
    segment: SegmentConfig = SegmentConfig()
    denoise: DenoiseConfig = DenoiseConfig()
    match: MatchConfig = MatchConfig()
    refine: RefineConfig = RefineConfig()
    fit: FitConfig = FitConfig()
    build: PersonalConfig = PersonalConfig()
    cpd: CpdConfig = CpdConfig()
    completion: CompletionConfig = CompletionConfig()
    temporal: TemporalConfig = TemporalConfig()
    recover: RecoverConfig = RecoverConfig()
    smooth: SmoothConfig = SmoothConfig()
    follow: FollowConfig = FollowConfig()

    @property
    def fitting(self) -> FittingConfig:
        """The settings of the fits."""
        return FittingConfig(self.fit, self.build, self.cpd, self.completion, self.temporal)


SHORT_NAMES: dict[str, tuple[str, str]] = {
    "follow": ("follow", "whom"),
    "zone": ("segment", "zone"),
    "build": ("build", "file"),
}
"""ROS parameters that are named without their section: the name, and the setting's section and field."""


MAX_STAMP_GAP_NS = 500_000_000
"""Temporal state is dropped when stamps jump back, or ahead by more than this."""
