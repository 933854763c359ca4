"""Constants of the paper's registration and completion (Ye et al., Sec. 6)."""

from __future__ import annotations

from typing import NamedTuple


class CpdTuning(NamedTuple):
    """Constants of coherent point drift from exemplar to input."""

    beta: float = 0.7
    """Width of the coherence kernel (m)."""
    stiffness: float = 20.0
    """Weight lambda of the coherence."""
    outlier_weight: float = 0.1
    """Expected share w of outliers among the input points."""
    sigma_start: float = 0.06
    """Standard deviation at the start (m)."""
    sigma_floor: float = 0.012
    """Minimum standard deviation (m)."""
    basis_points: int = 60
    """Number of vertices from which the kernel is approximated."""
    tolerance: float = 5e-4
    """The registration ends when no point moves farther than this in a step (m)."""
    max_iterations: int = 20
    """Maximum number of iterations."""


class CompletionTuning(NamedTuple):
    """Constants of the Laplacian completion of the mesh (eq. 7)."""

    passes: int = 2
    """Number of passes; each starts from the body posed at the joints of the previous one."""
    weight: float = 0.1
    """Weight w of a correspondence in eq. 7."""
    max_vertices: int = 600
    """Maximum number of visible vertices that are registered."""
    max_points: int = 600
    """Maximum number of input points that are registered."""
    visible_tolerance: float = 0.05
    """Maximum distance of a visible vertex behind the rendered depth (m)."""
    min_probability: float = 0.1
    """Minimum P1 of a vertex that counts as a correspondence."""
    min_facing: float = 0.55
    """Minimum cosine of a vertex's normal and its ray; below it skin slides sideways."""
