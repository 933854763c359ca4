"""Scenes with known answers: posed bodies, planes and boxes, drawn by plain formulas and a z-buffer."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from depth_pose.body.procedural import make_body
from depth_pose.body.rendered_depth import render_depth
from depth_pose.core.camera import Camera
from depth_pose.core.frame import DepthFrame
from depth_pose.core.labels import HIDDEN
from depth_pose.core.rotations import R_CAMERA_FACING_MODEL as FACING
from depth_pose.core.rotations import rotvec_to_matrix
from depth_pose.core.skeleton import MIRROR_NODES, NODE_INDEX, NODE_PARENTS
from depth_pose.track.person_view import see_people
from depth_pose.track.tracked_person import TrackedPerson

CAMERA = Camera(176, 144, 190.0, 190.0, 87.5, 71.5)

START_NS = 1_700_000_000_000_000_000
STEP_NS = 40_000_000


@lru_cache
def default_body():
    return make_body()


def rotation(axis, degrees):
    """Rotation about x, y or z."""
    return rotvec_to_matrix(np.radians(degrees) * np.eye(3)["xyz".index(axis)])


def upright(**turned):
    """Segment rotations in the model frame: the rest pose with whole limbs turned.

    ``left_shoulder=R`` turns the left arm from the shoulder on; later ones turn what is below.
    """
    rotations = np.tile(np.eye(3), (21, 1, 1))
    for name, turn in turned.items():
        below = subtree(NODE_INDEX[name])
        rotations[below] = turn @ rotations[below]
    return rotations


def subtree(node):
    inside = np.zeros(21, bool)
    inside[node] = True
    for n in range(node + 1, 21):
        inside[n] = NODE_PARENTS[n] >= 0 and inside[NODE_PARENTS[n]]
    return inside


def arms_down():
    """Arms hanging at the sides."""
    return upright(left_shoulder=rotation("z", -38.0), right_shoulder=rotation("z", 38.0))


def varied(seed, degrees):
    """The rest pose with every limb, the trunk and the head turned at random."""
    rng = np.random.default_rng(seed)
    names = ["spine", "neck"]
    names += [
        f"{side}_{joint}" for side in ("left", "right") for joint in ("shoulder", "elbow", "hip", "knee")
    ]
    return upright(**{n: rotvec_to_matrix(np.radians(rng.uniform(-degrees, degrees, 3))) for n in names})


def posed(rotations, distance=3.0, aside=0.0, height=0.9, turn=0.0, scale=1.0, body=None):
    """Pose a body on a floor ``height`` below a level camera, ``turn`` degrees to its left."""
    body = body or default_body()
    root = np.array([aside, height - scale * body.nodes[0, 1], distance])
    return body.pose(FACING @ rotation("y", turn) @ rotations, root, scale)


def mesh(posed_body, body=None):
    return posed_body.vertices, (body or default_body()).faces


def transform(seed):
    """A rigid transform (4, 4) of random numbers."""
    rng = np.random.default_rng(seed)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotvec_to_matrix(rng.normal(size=3)), rng.normal(size=3)
    return T


def box(low, high):
    """A closed box, outward faces counter-clockwise seen from outside."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    return np.asarray(low) + corners * (np.asarray(high) - np.asarray(low)), np.array(faces, np.int32)


def draw(*meshes, camera=CAMERA):
    """Depth of meshes, (h, w) float64, infinite where there is none."""
    depth = np.full((camera.height, camera.width), np.inf)
    for vertices, faces in meshes:
        depth = np.minimum(depth, render_depth(vertices, faces, camera))
    return depth


def draw_plane(normal, offset, camera=CAMERA):
    """Depth of the plane ``normal . p = offset``, infinite where it is not ahead."""
    v, u = np.mgrid[: camera.height, : camera.width]
    x, y = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
    slant = normal[0] * x + normal[1] * y + normal[2]
    with np.errstate(divide="ignore", invalid="ignore"):
        z = offset / slant
    return np.where((z > 0) & np.isfinite(z), z, np.inf)


def room(floor=0.9, wall=4.6, camera=CAMERA):
    """Depth of a floor below a level camera and a wall across its view."""
    return np.minimum(draw_plane([0, 1, 0], floor, camera), draw_plane([0, 0, 1], wall, camera))


def to_frame(depth, stamp_ns=START_NS, camera=CAMERA, noise=0.0, seed=0):
    """A depth image as a sensor gives it: float32, 0 where nothing returned."""
    if noise:
        depth = depth + noise * np.random.default_rng(seed).standard_normal(depth.shape)
    return DepthFrame(
        stamp_ns, "optical", np.where(np.isfinite(depth), depth, 0.0).astype(np.float32), camera
    )


def to_people(*depths, stamp_ns=START_NS, camera=CAMERA, hidden=None):
    """Drawn persons ``body_1``, ``body_2``, ...: every drawn pixel is somebody, all else is free.

    Somebody nearer covers who is farther; ``hidden``, (h, w) bool, are pixels of which nothing is known.
    """
    z = np.min([np.full((camera.height, camera.width), np.inf), *depths], axis=0)
    labels = np.zeros(z.shape, np.uint8)
    for k, depth in enumerate(depths):
        labels[np.isfinite(depth) & (depth == z)] = k + 1
    if hidden is not None:
        labels[hidden] = HIDDEN
    z = np.where((labels > 0) & (labels != HIDDEN), z, 0.0)
    found = [TrackedPerson(k + 1, f"body_{k + 1}", 1.0) for k in range(len(depths))]
    return see_people(stamp_ns, "optical", camera, z.astype(np.float32), labels, found)


def to_person(depth, **seen):
    """The one drawn person, prepared; `to_people` says how."""
    (person,) = to_people(depth, **seen).persons
    return person


def restamped(people, stamp_ns):
    """The same frame at another time."""
    persons = tuple(replace(person, stamp_ns=stamp_ns) for person in people.persons)
    return replace(people, stamp_ns=stamp_ns, persons=persons)


def mirrored(points):
    """Nodes (21, 3) in a frame with x to the side, mirrored in x = 0."""
    return points[MIRROR_NODES] * [-1.0, 1.0, 1.0]


def joint_error(a, b):
    """Mean distance of corresponding joints, metres."""
    return float(np.linalg.norm(a - b, axis=1).mean())
