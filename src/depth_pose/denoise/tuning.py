"""Constants of the modified locally optimal projection."""

from __future__ import annotations

from typing import NamedTuple


class DenoiseTuning(NamedTuple):
    """Constants of eqs. 1 to 5 (Ye et al., Sec. 4), and of the outliers."""

    support_radius: float = 0.2
    """Support h of the weight theta(r) = exp(-16 r^2 / h^2) (m)."""
    repulsion: float = 0.35
    """Repulsion weight mu of eq. 3."""
    outlier_distance: float = 0.06
    """Points whose nearest neighbour is farther than this are dropped (m)."""
