"""How well the embedded body's surface fits other bodies, posed at their true joints.

    python tools/body/measure_fit.py [CLIP_DIR] [--frames N] [--picture FILE]

Reads recordings of simulated people with known joints (NAME.mcap beside NAME.npz with `joints`
(T,19,3), `names`, `stamps_ns`, `K`), puts the body's nodes on the true joints (segment directions
and lengths from the truth, one thickness per person from the sum of the bones' lengths), renders
its depth with the clip's camera and compares. Prints, per body part, the mean over people of the
median signed depth difference (positive: the recorded surface lies behind the body's) and of the
median absolute one, and the overlap of the silhouettes. Nothing is fitted.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.body import Body
from depth_pose.body.procedural import make_body
from depth_pose.core.rotations import nearest_rotation
from depth_pose.core.skeleton import JOINTS, NODE_INDEX, NODE_PARENTS, NODES

Array = NDArray[np.float64]

PARTS = {
    "pelvis": ("pelvis",),
    "belly": ("spine",),
    "chest": ("chest",),
    "shoulder": ("left_clavicle", "right_clavicle"),
    "neck": ("neck",),
    "head": ("head",),
    "upper arm": ("left_shoulder", "right_shoulder"),
    "forearm": ("left_elbow", "right_elbow"),
    "hand": ("left_wrist", "right_wrist"),
    "thigh": ("left_hip", "right_hip"),
    "shank": ("left_knee", "right_knee"),
    "foot": ("left_ankle", "left_foot", "right_ankle", "right_foot"),
}
BEHIND = 0.25
"""Recorded points farther than this from the body's surface are something else, metres."""


def unit(v: Array) -> Array:
    """Give a vector of length 1."""
    return v / max(float(np.linalg.norm(v)), 1e-12)


def align(rest: list[Array], seen: list[Array]) -> Array:
    """Rotation that turns rest directions into seen ones best, weighted by their lengths."""
    return nearest_rotation(np.sum([np.outer(s, r) for r, s in zip(rest, seen, strict=True)], axis=0))


def true_nodes(joints: dict[str, Array]) -> Array:
    """Positions of the 21 nodes; the clavicles' are placed as on the embedded body's chest later."""
    nodes = np.full((len(NODES), 3), np.nan)
    for name, at in joints.items():
        nodes[NODE_INDEX[name]] = at
    return nodes


def true_pose(body: Body, joints: dict[str, Array], scale: float) -> tuple[Array, Array]:
    """Linear maps (21, 3, 3) of the segments, stretched along their bones, and nodes (21, 3)."""
    rest = {n: body.nodes[i] for n, i in NODE_INDEX.items()}
    nodes = true_nodes(joints)
    turn: dict[str, Array] = {}

    def offsets(base: str, others: tuple[str, ...]) -> tuple[list[Array], list[Array]]:
        return [rest[o] - rest[base] for o in others], [joints[o] - joints[base] for o in others]

    turn["pelvis"] = align(*offsets("pelvis", ("spine", "left_hip", "right_hip")))
    turn["chest"] = align(*offsets("chest", ("neck", "left_shoulder", "right_shoulder")))
    side = turn["pelvis"][:, 0] + turn["chest"][:, 0]
    turn["spine"] = _aimed(rest["chest"] - rest["spine"], joints["chest"] - joints["spine"], side)
    turn["neck"] = _aimed(rest["head"] - rest["neck"], joints["head"] - joints["neck"], turn["chest"][:, 0])
    turn["head"] = turn["neck"]
    for s in ("left_", "right_"):
        turn[s + "clavicle"] = turn["chest"]
        _limb(turn, rest, joints, (s + "shoulder", s + "elbow", s + "wrist"), turn["chest"], True)
        turn[s + "wrist"] = turn[s + "elbow"]
        _limb(turn, rest, joints, (s + "hip", s + "knee", s + "ankle"), turn["pelvis"], False)
        foot = s + "foot"
        turn[foot] = turn[s + "ankle"] = _aimed(
            rest[foot] - rest[s + "ankle"], joints[foot] - joints[s + "ankle"], turn[s + "knee"][:, 0]
        )
        clavicle, chest = NODE_INDEX[s + "clavicle"], NODE_INDEX["chest"]
        nodes[clavicle] = nodes[chest] + scale * turn["chest"] @ (body.nodes[clavicle] - body.nodes[chest])
    return _stretched(turn, body.nodes, nodes, scale), nodes


def _aimed(rest: Array, seen: Array, side: Array) -> Array:
    """Rotation that turns `rest` onto `seen` and the x axis as near to `side` as it can."""
    a, b = unit(rest), unit(seen)
    x = np.array([1.0, 0.0, 0.0])
    frame_a = _frame(a, x - a * (x @ a))
    frame_b = _frame(b, side - b * (side @ b))
    return frame_b @ frame_a.T


def _frame(y: Array, x: Array) -> Array:
    x = unit(x)
    return np.stack([x, y, np.cross(x, y)], axis=1)


def _limb(
    turn: dict[str, Array],
    rest: dict[str, Array],
    joints: dict[str, Array],
    names: tuple[str, str, str],
    base: Array,
    bends_forward: bool,
) -> None:
    """Upper and lower limb: hinge axis from the bend where there is one, else carried along."""
    upper, lower, end = names
    bones = [unit(rest[lower] - rest[upper]), unit(rest[end] - rest[lower])]
    seen = [unit(joints[lower] - joints[upper]), unit(joints[end] - joints[lower])]
    ahead = np.array([0.0, 0.0, 1.0 if bends_forward else -1.0])
    hinge_rest = unit(np.cross(bones[0], ahead))
    carried = _shortest(base @ bones[0], seen[0]) @ base @ hinge_rest
    hinge = np.cross(seen[0], seen[1])
    bent = float(np.clip((np.linalg.norm(hinge) - 0.15) / 0.25, 0.0, 1.0))
    side = bent * unit(hinge) + (1.0 - bent) * carried
    for name, bone, aim in zip((upper, lower), bones, seen, strict=True):
        frame = _frame(bone, hinge_rest - bone * (hinge_rest @ bone))
        turn[name] = _frame(aim, side - aim * (side @ aim)) @ frame.T


def _shortest(a: Array, b: Array) -> Array:
    """Smallest rotation that turns unit vector a onto b."""
    v, c = np.cross(a, b), float(a @ b)
    k = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    return np.eye(3) + k + k @ k / max(1.0 + c, 1e-6)


def _stretched(turn: dict[str, Array], rest: Array, nodes: Array, scale: float) -> Array:
    maps = np.empty((len(NODES), 3, 3))
    for i, name in enumerate(NODES):
        maps[i] = scale * turn[name]
        children = [c for c in range(len(NODES)) if NODE_PARENTS[c] == i]
        if len(children) == 1 and "foot" not in NODES[children[0]]:
            bone = rest[children[0]] - rest[i]
            ratio = np.linalg.norm(nodes[children[0]] - nodes[i]) / (scale * np.linalg.norm(bone))
            maps[i] = maps[i] @ (np.eye(3) + (ratio - 1.0) * np.outer(unit(bone), unit(bone)))
    return maps


def body_scale(body: Body, joints: dict[str, Array]) -> float:
    """Size of a person relative to the body: ratio of the bones' summed lengths."""
    pairs = [
        (NODES[i], NODES[p])
        for i, p in enumerate(NODE_PARENTS)
        if p >= 0 and "clavicle" not in NODES[i] + NODES[p]
    ]
    seen = sum(np.linalg.norm(joints[a] - joints[b]) for a, b in pairs)
    rest = sum(np.linalg.norm(body.nodes[NODE_INDEX[a]] - body.nodes[NODE_INDEX[b]]) for a, b in pairs)
    return float(seen / rest)


def posed_vertices(body: Body, joints: dict[str, Array]) -> Array:
    """Place the body's vertices on a person's true joints, in the joints' frame."""
    maps, nodes = true_pose(body, joints, body_scale(body, joints))
    moved = np.einsum("nij,vnj->vni", maps, body.vertices[:, None] - body.nodes) + nodes
    return np.einsum("vn,vni->vi", body.weights, moved)


def render(
    vertices: Array, faces: NDArray[np.int32], k: Array, shape: tuple[int, int]
) -> tuple[Array, Array]:
    """Depth image (inf where nothing) and index of the hit face."""
    import open3d as o3d

    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(vertices.astype(np.float32), faces.astype(np.uint32))
    v, u = np.mgrid[: shape[0], : shape[1]]
    rays = np.stack([(u - k[0, 2]) / k[0, 0], (v - k[1, 2]) / k[1, 1], np.ones(shape)], axis=-1)
    rays = np.concatenate([np.zeros((*shape, 3)), rays], axis=-1).astype(np.float32)
    hit = scene.cast_rays(o3d.core.Tensor(rays))
    return hit["t_hit"].numpy().astype(float), hit["primitive_ids"].numpy()


def read_clip(path: Path, count: int) -> Iterator[tuple[Array, dict[str, Array], Array]]:
    """Depth in metres, true joints and camera matrix of `count` frames spread over a clip."""
    from mcap_ros2.reader import read_ros2_messages

    truth = np.load(path.with_suffix(".npz"))
    stamps = truth["stamps_ns"]
    wanted = set(np.linspace(3, len(stamps) - 4, count).astype(int).tolist())
    for message in read_ros2_messages(str(path), topics=["/camera/depth/image_raw"]):
        image = message.ros_msg
        stamp = image.header.stamp.sec * 10**9 + image.header.stamp.nanosec
        i = int(np.argmin(np.abs(stamps - stamp)))
        if i in wanted and abs(int(stamps[i]) - stamp) < 2_000_000:
            depth = np.frombuffer(image.data, np.uint16).reshape(image.height, image.width) / 1000.0
            names = [str(n) for n in truth["names"]]
            yield depth, dict(zip(names, truth["joints"][i].astype(float), strict=True)), truth["K"]


def compare(body: Body, depth: Array, joints: dict[str, Array], k: Array) -> tuple[dict[str, Array], float]:
    """Depth differences of each part's pixels, metres, and the silhouettes' overlap (IoU)."""
    vertices = posed_vertices(body, joints)
    model, face = render(vertices, body.faces, k, depth.shape)
    hit = np.isfinite(model)
    node_of_face = np.argmax(body.weights[body.faces].sum(axis=1), axis=1)
    node = np.where(hit, node_of_face[np.where(hit, face, 0)], -1)
    inside = hit & (depth > 0.3) & (np.abs(depth - model) < BEHIND)
    dz = {
        part: (depth - model)[inside & np.isin(node, [NODE_INDEX[n] for n in names])]
        for part, names in PARTS.items()
    }
    mask = person_mask(depth, joints, k)
    valid = depth > 0.3
    return dz, float((mask & hit)[valid].sum() / max((mask | hit)[valid].sum(), 1))


def person_mask(depth: Array, joints: dict[str, Array], k: Array) -> NDArray[np.bool_]:
    """Pixels within a hand's length of the true skeleton (the walls are farther behind)."""
    at = np.array([joints[n] for n in JOINTS])
    v, u = np.nonzero(depth > 0.3)
    z = depth[v, u]
    points = np.stack([(u - k[0, 2]) * z / k[0, 0], (v - k[1, 2]) * z / k[1, 1], z], axis=1)
    near = np.zeros(len(points), dtype=bool)
    for i, p in enumerate(NODE_PARENTS):
        if p >= 0 and "clavicle" not in NODES[i] + NODES[p]:
            a, b = joints[NODES[p]], joints[NODES[i]]
            t = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), -0.6, 1.6)
            near |= np.linalg.norm(points - a - t[:, None] * (b - a), axis=1) < 0.24
    near &= (points > at.min(axis=0) - 0.35).all(axis=1) & (points < at.max(axis=0) + 0.35).all(axis=1)
    mask = np.zeros(depth.shape, dtype=bool)
    mask[v[near], u[near]] = True
    return mask


def main() -> None:
    """Compare over a folder of clips and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    here = Path(__file__).resolve()
    parser.add_argument("clips", nargs="?", type=Path, default=here.parents[3] / "shared" / "data" / "dev")
    parser.add_argument("--frames", type=int, default=6, help="frames per clip")
    parser.add_argument("--picture", type=Path, help="write pictures of the differences here")
    args = parser.parse_args()
    body = make_body()
    rows: dict[str, list[tuple[float, float]]] = {p: [] for p in PARTS}
    pictures, header = [], f"{'clip':>18s} {'IoU':>5s}  " + " ".join(f"{p[:6]:>6s}" for p in PARTS)
    print(header + "   (median signed dz, mm)")
    for path in sorted(args.clips.glob("*.mcap")):
        found: dict[str, list[Array]] = {p: [] for p in PARTS}
        overlap = []
        for depth, joints, k in read_clip(path, args.frames):
            dz, iou = compare(body, depth, joints, k)
            overlap.append(iou)
            for part, values in dz.items():
                found[part].append(values)
            pictures.append((depth, joints, k))
        line = []
        for part, lists in found.items():
            values = np.concatenate(lists)
            if len(values) >= 20:
                rows[part].append((float(np.median(values)), float(np.median(np.abs(values)))))
                line.append(f"{1e3 * np.median(values):6.1f}")
            else:
                line.append(f"{'-':>6s}")
        print(f"{path.stem:>18s} {np.mean(overlap):5.3f}  " + " ".join(line))
    signed = [np.mean([r[0] for r in rows[p]]) * 1e3 for p in PARTS]
    absolute = [np.mean([r[1] for r in rows[p]]) * 1e3 for p in PARTS]
    print(f"{'mean signed':>18s}        " + " ".join(f"{v:6.1f}" for v in signed))
    print(f"{'mean of median |dz|':>18s}      " + " ".join(f"{v:6.1f}" for v in absolute))
    if args.picture:
        _draw(body, pictures[:: args.frames], args.picture)


def _draw(body: Body, frames: list[tuple[Array, dict[str, Array], Array]], path: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, len(frames), figsize=(3.2 * len(frames), 7), squeeze=False)
    for column, (depth, joints, k) in enumerate(frames):
        at = np.array([joints[n] for n in JOINTS])
        u, v = at[:, 0] / at[:, 2] * k[0, 0] + k[0, 2], at[:, 1] / at[:, 2] * k[1, 1] + k[1, 2]
        model, _ = render(posed_vertices(body, joints), body.faces, k, depth.shape)
        near = np.where(np.abs(depth - at[:, 2].mean()) < 0.7, depth, np.nan)
        both = np.where(np.isfinite(model), depth - model, np.nan)
        for row, (image, span) in enumerate(((near, None), (both, 0.06))):
            ax = axes[row, column]
            limits = {} if span is None else {"vmin": -span, "vmax": span, "cmap": "RdBu"}
            ax.imshow(image, **limits)
            ax.contour(np.isfinite(model), [0.5], colors="k", linewidths=0.6)
            ax.plot(u, v, ".", ms=3, color="orange")
            pad = 0.12 * (v.max() - v.min())
            ax.set_xlim(u.min() - pad, u.max() + pad)
            ax.set_ylim(v.max() + pad, v.min() - pad)
            ax.axis("off")
    figure.tight_layout()
    figure.savefig(path, dpi=70)


if __name__ == "__main__":
    main()
