"""Decide whether a person is published: the only place where a detected person may be rejected."""

from __future__ import annotations

from depth_pose.recover.confidence import fit_confidence

_SURE = 0.75
"""Person probability, over all frames, from which a person is published even if no body fits."""

_VETO, _VETO_SHARE = 0.1, 0.25
"""Standing below which a person is not published unless sure, and the share of each frame in its average;
set by hand."""

_HOPELESS = 0.5
"""Share of `min_confidence` below which a first fit is refused, as probably furniture."""


def is_published(probability: float, standing: float, *, is_refused: bool) -> bool:
    """Decide whether a person is published.

    Parameters
    ----------
    probability : float
        That this is a person, over all frames, 0 to 1.
    standing : float
        Running mean of the probability times the fit's confidence (`renew_standing`).
    is_refused : bool
        Whether the frame's fit is refused, with nothing to replace it.
    """
    return probability >= _SURE or not is_doubtful(standing, is_refused=is_refused)


def is_doubtful(standing: float, *, is_refused: bool) -> bool:
    """Decide whether no body fits the detection."""
    return is_refused or standing < _VETO


def is_hopeless(score: float, min_confidence: float) -> bool:
    """Decide whether a rendered-depth score, 0 to 1, shows that no body is there at all."""
    return fit_confidence(score) < _HOPELESS * min_confidence


def renew_standing(standing: float, probability: float, confidence: float) -> float:
    """Update a person's standing with a frame's probability and the confidence of its fit."""
    return standing + _VETO_SHARE * (probability * confidence - standing)
