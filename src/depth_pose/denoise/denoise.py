r"""Modified locally optimal projection, LOP (Sec. 4, Ye et al. eqs. 1 to 5).

Every point :math:`p_i` moves along its own viewing ray only. With :math:`\theta(r) = e^{-16 r^2 / h^2}`, the
first step is

.. math:: z_i^{(1)} = \frac{\sum_s z_s \, \theta(\|p_s - p_i\|)}{\sum_s \theta(\|p_s - p_i\|)}
   \qquad (1)

and x and y follow the ray (eqs. 2, 4). Each further step is

.. math:: z_i^{(k+1)} = \frac{\sum_s \alpha_s^i z_s}{\sum_s \alpha_s^i}
   + \mu \frac{\sum_{s \ne i} (z_i^{(k)} - z_s^{(k)}) \beta_s^i}{\sum_{s \ne i} \beta_s^i} \qquad (3)

.. math:: \alpha_s^i = \frac{\theta(\|p_s^{(k)} - p_i\|)}{\|p_s^{(k)} - p_i\|}, \quad
   \beta_s^i = \frac{\theta(\|p_s^{(k)} - p_i^{(k)}\|)}{\|p_s^{(k)} - p_i^{(k)}\|}
   \left| \frac{\partial \eta}{\partial r} \right|, \quad \eta(r) = r^3 / 3 \qquad (5)

`DenoiseConfig.iterations` 1, the default, is the first step alone, eqs. 1 and 2, without eqs. 3 to 5 and
without repulsion.

The paper prints the repulsion with the distance between the points, which is never negative and pushes every
point away from the camera; the signed difference in z, used here, pushes points apart as intended by LOP
(Lipman et al. 2007).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.config import DenoiseConfig
from depth_pose.denoise import _denoise_kernels as kernels
from depth_pose.denoise.tuning import DenoiseTuning


def denoise_depth(
    depth: NDArray[np.float32],
    camera: Camera,
    config: DenoiseConfig,
    tuning: DenoiseTuning = DenoiseTuning(),
) -> NDArray[np.float32]:
    """Smooth the person's depth (Ye et al. eqs. 1 to 5) and drop isolated points.

    Parameters
    ----------
    depth : (h, w) float32
        Depth of the person's pixels, metres; 0 elsewhere.
    camera : Camera
        Camera of the grid.
    config : DenoiseConfig
    tuning : DenoiseTuning

    Returns
    -------
    (h, w) float32
        Projected depth, metres; 0 where there was none and where a point was an outlier.
    """
    # Ye et al. eq. 2: x and y follow the depth along the pixel's ray, so depth is all that moves
    # Ye et al. eq. 4: also in further iterations, if `denoise.iterations` is above 1
    h, step = tuning.support_radius, kernels.step_of(depth, tuning.support_radius, camera.fx)
    projected = depth
    for k in range(config.iterations):
        if k == 0:
            projected = kernels.project_first(depth, camera, h, step)
        else:
            projected = kernels.project_next(depth, projected, camera, h, tuning.repulsion, step)
    return kernels.drop_outliers(projected, camera, tuning.outlier_distance)
