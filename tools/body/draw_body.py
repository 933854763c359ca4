"""Draw the embedded body, in its rest pose and bent, for docs/method.md.

python tools/body/draw_body.py [FOLDER]
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.body import Body
from depth_pose.body.procedural import BodyShape, make_body
from depth_pose.core.rotations import mirror_rotation, rotation_x, rotation_y, rotation_z
from depth_pose.core.skeleton import NODE_INDEX

Array = NDArray[np.float64]
PIXEL = 1.95 / 400
"""Size of a picture's pixel, metres."""


def turn(axis: str, degrees: float) -> Array:
    """Rotation about one axis of the model frame."""
    return {"x": rotation_x, "y": rotation_y, "z": rotation_z}[axis](np.radians(degrees))


def shade(vertices: Array, faces: NDArray[np.int32], azimuth: float, width: int = 300) -> NDArray[np.uint8]:
    """Shaded orthographic view of a mesh from an azimuth in degrees, (460, width)."""
    import open3d as o3d

    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(vertices.astype(np.float32), faces.astype(np.uint32))
    view = turn("y", azimuth)
    right, up, ahead = view[:, 0], view[:, 1], -view[:, 2]
    v, u = np.mgrid[:460, :width]
    middle = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0)) * [1.0, 0.0, 1.0]
    at = middle + PIXEL * ((u - width / 2)[..., None] * right + (440 - v)[..., None] * up) - 3.0 * ahead
    rays = np.concatenate([at, np.broadcast_to(ahead, at.shape)], axis=-1).astype(np.float32)
    hit = scene.cast_rays(o3d.core.Tensor(rays))
    light = -ahead * 0.8 + up * 0.5 - right * 0.3
    bright = hit["primitive_normals"].numpy() @ (light / np.linalg.norm(light))
    return np.where(np.isfinite(hit["t_hit"].numpy()), 50 + 190 * np.clip(bright, 0, 1), 255).astype(np.uint8)


def posed(body: Body, turns: dict[str, Array]) -> Array:
    """Vertices with segments turned, standing on the floor."""
    rotations = np.tile(np.eye(3), (21, 1, 1))
    for name, r in turns.items():
        rotations[NODE_INDEX[name]] = r
    vertices = body.pose(rotations, body.nodes[0]).vertices
    return vertices - [0.0, vertices[:, 1].min(), 0.0]


def both_sides(turns: dict[str, Array]) -> dict[str, Array]:
    """Return the turns of left and right segments from those of the left side."""
    return {f"left_{n}": r for n, r in turns.items()} | {
        f"right_{n}": mirror_rotation(r) for n, r in turns.items()
    }


def poses() -> list[dict[str, Array]]:
    """Return poses that are hard on the skin."""
    arms = ("shoulder", "elbow", "wrist")
    trunk = ("pelvis", "spine", "chest", "neck", "head")
    down, up, ahead = turn("z", -38), turn("z", 128), turn("y", -85) @ turn("z", 45)
    raised = both_sides({**dict.fromkeys(arms, up), "clavicle": turn("z", 25)})
    squat = both_sides({"hip": turn("x", -105), "knee": turn("x", 20), **dict.fromkeys(arms, ahead)})
    squat |= dict.fromkeys(trunk, turn("x", 25)) | dict.fromkeys(
        ("left_clavicle", "right_clavicle"), turn("x", 25)
    )
    kneel = both_sides(
        {**dict.fromkeys(("knee", "ankle", "foot"), turn("x", 110)), **dict.fromkeys(arms, down)}
    )
    bow = both_sides({**dict.fromkeys(arms, turn("x", 10) @ down), "clavicle": turn("x", 70)})
    bow |= {n: turn("x", a) for n, a in zip(trunk, (30, 50, 70, 75, 80), strict=True)}
    return [raised, squat, kneel, bow]


def main() -> None:
    """Write body_rest.png, body_poses.png and body_builds.png."""
    import matplotlib.image

    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", nargs="?", type=Path, default=Path(__file__).resolve().parents[2] / "docs")
    folder = parser.parse_args().folder
    body = make_body()
    rest = [shade(body.vertices, body.faces, a) for a in (0, 40, 90, 180)]
    bent = [shade(posed(body, p), body.faces, a) for p in poses() for a in (10, 75)]
    down = both_sides(dict.fromkeys(("shoulder", "elbow", "wrist"), turn("z", -35)))
    builds = [
        shade(posed(make_body(shape), down), body.faces, 15, 220)
        for shape in (
            BodyShape(),
            BodyShape(stature_m=1.15, head_size=1.3, leg_length=0.92),
            BodyShape(girth=1.25),
            BodyShape(stature_m=1.95, girth=0.95, leg_length=1.05),
            BodyShape(stature_m=1.62, shoulder_width=0.92, hip_width=1.08),
        )
    ]
    pictures = {"rest": [rest], "poses": [bent[:4], bent[4:]], "builds": [builds]}
    for name, rows in pictures.items():
        picture = np.concatenate([np.concatenate(row, axis=1) for row in rows], axis=0)
        matplotlib.image.imsave(folder / f"body_{name}.png", picture, cmap="gray", vmin=0, vmax=255)


if __name__ == "__main__":
    main()
