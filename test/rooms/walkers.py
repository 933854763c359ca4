"""People who walk about a room, and cameras that see them: sightings with noise, in the room's frame."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from depth_pose.core.skeleton import JOINT_NODES, JointState, rest_nodes
from depth_pose.rooms.sightings import RoomSighting

REST = 1.75 * rest_nodes()[JOINT_NODES][:, [2, 0, 1]]  # z up, facing x


def standing(x: float, y: float, yaw: float = 0.0, size: float = 1.0) -> np.ndarray:
    """Return the joints (19, 3) of somebody upright in the room's frame."""
    c, s = np.cos(yaw), np.sin(yaw)
    return size * REST @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) + [x, y, 0.0]


@dataclass
class Eye:
    """A camera with its own ids: a new one whenever somebody comes into its part of the room (x range)."""

    left: float = -np.inf
    right: float = np.inf
    bias: tuple[float, float] = (0.0, 0.0)
    noise: float = 0.02
    seed: int = 0
    ids: dict[int, int] = field(default_factory=dict)
    count: int = 0

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng(self.seed)

    def see(self, places: list[tuple[float, float]], sizes: list[float] | None = None) -> list[RoomSighting]:
        """Return who is in view, in any order."""
        shown = []
        for i, (x, y) in enumerate(places):
            if not self.left <= x <= self.right:
                self.ids.pop(i, None)
                continue
            if i not in self.ids:
                self.count += 1
                self.ids[i] = self.count
            size = (sizes or [1.0] * len(places))[i]
            joints = standing(x, y, size=size) + self.rng.normal(0.0, self.noise, (19, 3))
            shown.append(sighting(f"body_{self.ids[i]}", joints + [*self.bias, 0.0], size))
        self.rng.shuffle(shown)
        return shown


def sighting(body_id: str, joints: np.ndarray, size: float = 1.0, sure: float = 0.9) -> RoomSighting:
    return RoomSighting(body_id, joints, np.full(19, sure), np.full(19, JointState.SEEN, np.uint8), 0.9, size)
