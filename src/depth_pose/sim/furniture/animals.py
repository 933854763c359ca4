"""Dogs and cats: rounded shapes that a people finder may confuse with people."""

from __future__ import annotations

import numpy as np

from depth_pose.sim.shapes import Assembly, Kind, random_albedo


def make_pet(rng: np.random.Generator) -> Assembly:
    """Make a dog or a cat that stands, sits or lies and faces +z."""
    thing = Assembly(Kind.PET, random_albedo(rng, 0.3))
    high = rng.uniform(0.22, 0.32) if rng.random() < 0.4 else rng.uniform(0.3, 0.75)
    long, thick = high * rng.uniform(0.9, 1.4), high * rng.uniform(0.16, 0.26)
    way = rng.choice(3, p=[0.5, 0.25, 0.25])
    rear = thick * 0.9 if way else high - thick
    front = (high - thick, high - thick, thick * 0.9)[way]
    if way == 1:
        long *= 0.6
    rump, chest = np.array([0.0, rear, -long / 2]), np.array([0.0, front, long / 2])
    thing.bar(rump, chest, thick * rng.uniform(0.75, 1.0), thick)
    thing.lump(rump, (thick, thick * 1.05, thick * 1.1), 0.06)
    thing.lump(chest, (thick, thick * 1.1, thick), 0.06)
    for end, stands in ((rump, way == 0), (chest, way < 2)):
        for side in (-1, 1):
            hip = end + [0.6 * side * thick, 0, 0]
            step = rng.normal(0, 0.12) * high
            paw = [hip[0], 0.0, hip[2] + step] if stands else [1.5 * hip[0], 0.03, hip[2] + 0.45 * high]
            thing.bar(hip, paw, 0.3 * thick, 0.2 * thick)
    raised = rng.uniform(0.1, 0.5)
    head = chest + [rng.normal(0, 0.2) * thick, raised * high, rng.uniform(0.15, 0.35) * high]
    size = thick * rng.uniform(0.6, 0.85)
    thing.bar(chest, head, 0.65 * thick, 0.5 * thick)
    thing.lump(head, (size, size, 1.1 * size), 0.05)
    thing.bar(head, head + [0, -0.2 * size, size * rng.uniform(1.1, 2.2)], 0.55 * size, 0.4 * size)
    for side in (-1, 1):
        ear = head + [0.6 * side * size, 0.6 * size, 0]
        thing.bar(ear, ear + [0.3 * side * size, rng.uniform(-0.8, 0.9) * size, 0], 0.3 * size, 0.08 * size)
    tail = rump + [rng.normal(0, 0.3) * high, rng.uniform(-0.6, 1.0) * high, -rng.uniform(0.3, 0.7) * high]
    thing.bar(rump, np.maximum(tail, [-9.0, 0.02, -9.0]), 0.25 * thick, 0.12 * thick)
    return thing
