"""Former settings, so that a file that still names one gets an error that says what replaces it."""

from __future__ import annotations

_MOVED: dict[str, str] = {
    "segment.start": "give recover.min_probability",
    "segment.sure": "give recover.min_probability",
    "match.scale": "give build.scale",
    "match.budget": "give the matcher's ROS parameter time_budget",
    "match.score_band": "the same constant is used everywhere",
    "temporal.weight": "completion.weight is used",
    "cpd.cooling": "the registration has no such term any more",
    "track.diffusion": "the factor was 1",
    "learn.dynamics_weight": "the weight was 1",
    "completion.geodesic": "distances always run along the surface",
}
"""What replaces a setting that has another place, or none."""

_FIXED: dict[str, str] = {
    "segment": "keep find_every look_every depth_jump min_support min_height",
    "denoise": "support_radius repulsion outlier_distance",
    "match": "shortlist keep search_every scale_frames",
    "refine": "track beam",
    "fit": "sigmas coarse_sigma outlier plane_weight point_weight free_space_weight free_space_slack "
    "free_space_limit proposal_weight floor_weight prior root_prior damping max_step max_points trust_power",
    "build": "sigma noise free_space memory worst_score",
    "cpd": "beta stiffness outlier_weight sigma_start sigma_floor basis_points tolerance max_iterations",
    "completion": "passes weight max_vertices max_points visible_tolerance min_probability min_facing",
    "temporal": "beta stiffness reach",
    "recover": "enabled bone_change angle_excess joint_speed score_rise",
    "track": "restarts azimuth_window stature_frames lost_after seed",
    "learn": "noise_floor pose_variance",
}
"""Settings, by section, whose values are constants now."""

FORMER_SECTIONS: frozenset[str] = frozenset(("fit", "cpd", "completion", "temporal"))
"""Sections of which no setting is left."""


def explain_removed(section: str, name: str) -> str | None:
    """Return the error line for a former setting; None if there was none of that name.

    Parameters
    ----------
    section, name : str
        Of ``section.name``.
    """
    full = f"{section}.{name}"
    if full in _MOVED:
        return f"{full} is no longer a setting; {_MOVED[full]}"
    if name in _FIXED.get(section, "").split():
        return (
            f"{full} is no longer a setting; leave it out: its value, which depth-pose settings --all "
            "prints, belongs to the weights and the bank"
        )
    return None
