r"""Noise of a sensor, measured at the person: the part that more points do not average out.

A fit's mean depth difference :math:`g` from the person has a deviation of :math:`\sqrt{\pi / 2}\, g`. Part of
it is noise of single pixels, which a fit averages out; it shows in the second differences of neighbouring
pixels, whose median is :math:`0.67 \sqrt{6}` deviations of white noise. The rest is what neighbouring points
share: blotches of matched blocks, clothes, furniture that touches the person. Points that share it count as
fewer against the measured joints, as the inverse of its variance (`depth_pose.refine.articulated`).
"""

from __future__ import annotations

import math

from depth_pose.core.labels import PERSON
from depth_pose.detect._crop_kernels import measure_bend
from depth_pose.track.person_view import PersonView

_OF_GAP = math.sqrt(math.pi / 2.0)
"""Standard deviation of a normal distribution, in mean absolute deviations."""

_OF_BEND = 1.0 / (0.6745 * math.sqrt(6.0))
"""Standard deviation of white noise, in medians of the absolute second difference."""

_SHARE = 0.2
"""Share of each frame in the running mean; set by hand."""


def skin_noise(person: PersonView, mean_depth_error: float) -> float:
    """Compute the deviation of a person's points about the skin that neighbouring points share, metres.

    Parameters
    ----------
    person : PersonView
    mean_depth_error : float
        Mean depth difference of the frame's fit (`depth_pose.body.rendered_depth.Comparison`), metres.
    """
    pixel = _OF_BEND * float(measure_bend(person.full.depth, person.full.labels, PERSON, 1))
    return math.sqrt(max(0.0, (_OF_GAP * mean_depth_error) ** 2 - pixel**2))


def renew_noise(before: float, now: float) -> float:
    """Update the running mean of a person's `skin_noise`; ``before`` is 0 before the first fit."""
    return now if before == 0.0 else before + _SHARE * (now - before)
