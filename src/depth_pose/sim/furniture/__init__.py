"""Objects in rooms: furniture, things on it, plants, doors, coats on stands, walking aids, pets."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from depth_pose.sim.furniture.aids import make_walker, make_wheelchair
from depth_pose.sim.furniture.animals import make_pet
from depth_pose.sim.furniture.fixtures import (
    make_bin,
    make_board,
    make_boxes,
    make_coats,
    make_curtain,
    make_door,
    make_lamp,
    make_pillar,
    make_pipes,
    make_plant,
    make_shelf,
)
from depth_pose.sim.furniture.seats import make_bed, make_chair, make_sofa, make_stool
from depth_pose.sim.furniture.tables import make_desk, make_table
from depth_pose.sim.shapes import Assembly

__all__ = [
    "AT_WALLS", "STANDING", "make_bed", "make_board", "make_chair", "make_coats", "make_desk", "make_pet",
    "make_pillar", "make_plant", "make_shelf", "make_sofa", "make_stool", "make_table", "make_wheelchair",
]  # fmt: skip

STANDING: tuple[tuple[Callable[[np.random.Generator], Assembly], float], ...] = (
    (make_table, 4.0),
    (make_chair, 5.0),
    (make_stool, 0.7),
    (make_sofa, 1.2),
    (make_bed, 0.6),
    (make_shelf, 2.0),
    (make_plant, 1.2),
    (make_boxes, 1.6),
    (make_pillar, 1.2),
    (make_coats, 1.6),
    (make_lamp, 1.0),
    (make_bin, 0.8),
    (make_board, 1.2),
    (make_wheelchair, 0.4),
    (make_walker, 0.3),
    (make_pet, 0.8),
)
"""Functions that make free-standing objects, and their frequencies."""

AT_WALLS: tuple[tuple[Callable[[np.random.Generator], Assembly], float], ...] = (
    (make_shelf, 3.0),
    (make_table, 1.5),
    (make_sofa, 0.8),
    (make_door, 2.0),
    (make_curtain, 2.0),
    (make_pipes, 1.2),
    (make_board, 1.0),
    (make_coats, 1.0),
    (make_chair, 1.0),
)
"""Functions that make objects along the walls."""
