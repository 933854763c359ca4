"""Compiled loops of the fit to several cameras; `depth_pose.rooms.room_fit` derives them."""

from __future__ import annotations

from depth_pose.core.kernels import njit


@njit(cache=True)
def add_turned(equations, rotation, total):
    """Add a camera's equations to those of the room; ``rotation`` maps vectors of the room to the camera.

    The equations' lower left block and both diagonal ones are used; the upper right one is its transpose.
    """
    for n in range(equations.inertia.shape[0]):
        for row, column in ((0, 0), (3, 0), (3, 3)):
            for a in range(3):
                for b in range(3):
                    value = 0.0
                    for i in range(3):
                        for j in range(3):
                            value += (
                                rotation[i, a] * equations.inertia[n, row + i, column + j] * rotation[j, b]
                            )
                    total.inertia[n, row + a, column + b] += value
        for part in (0, 3):
            for a in range(3):
                for i in range(3):
                    total.force[n, part + a] += rotation[i, a] * equations.force[n, part + i]
