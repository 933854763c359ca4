"""Learn from training volumes which parts of a body lie on the volume's surface.

Under a skirt they do not: the surface is the skirt. Training has both poses and volumes, so it shows what
clothing hides.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from depth_pose.body.procedural import BodyShape, make_body
from depth_pose.volume.learn.performances import Performance

Array = NDArray[np.float64]

_SCALE_M = 0.03
"""Distance from the surface at which the trust in a vertex is one half, metres. Set by hand."""
_EVERY = 10
"""Step between the training frames used."""


def learn_trust(performances: Sequence[Performance]) -> Array:
    """Trust (V,) of each vertex of the reference body, 1 where it is always near the surface."""
    template = make_body(BodyShape())
    normals = template.normals
    strongest = template.skin.influence[:, 0]
    total = count = np.zeros(len(template.vertices))
    for p in performances:
        scale = p.stature / template.stature
        for i in range(0, len(p), _EVERY):
            posed = template.pose(p.rotations[i], p.pelvis[i], scale)
            away, _ = cKDTree(p.volumes[i].surface).query(posed.vertices)
            seen = np.ones(len(posed.vertices))
            eyes = p.volumes[i].eyes
            if len(eyes):  # the far side is not on the surface, trusted or not
                outward = np.einsum("vij,vj->vi", p.rotations[i][strongest], normals)
                side = np.einsum("vi,evi->ev", outward, posed.vertices - eyes[:, None])
                seen = (side < 0).any(axis=0).astype(float)
            total = total + seen / (1.0 + (away / _SCALE_M) ** 2)
            count = count + seen
    return np.asarray(total / np.maximum(count, 1.0))
