"""Limb search: try the bank's arm and leg poses on the points that the fitted body does not explain.

A whole-body exemplar rarely has both arms right, and a fit that starts with a limb far from its place does
not find it. But the limb poses of all exemplars, mirrored and thinned to a few hundred, cover the range of
limb poses. After a fit, the points that the rest of the body does not explain are compared with every
configuration of the left and of the right limb. Balls along the limb in free space or in front of the
observed surface cost their area, and points off every ball cost theirs. The pairs with the least cost are
further starts for the fit, even if they cost more than the current limbs, because those are fitted already.
Re-assembling partial matches follows C. Plagemann et al., *Real-time identification and localization of body
parts from depth images* (ICRA 2010); the scoring here is our own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.bank.bank import Bank
from depth_pose.body.body import Body
from depth_pose.body.pose import BodyPose, FittedBody
from depth_pose.body.rendered_depth import DepthComparer, render_depth
from depth_pose.core.farthest_points import farthest_rows
from depth_pose.core.rotations import mirror_rotation, quat_to_matrix
from depth_pose.core.skeleton import MIRROR_NODES, NODE_INDEX, mirror_rotations
from depth_pose.refine import _limb_kernels as kernels
from depth_pose.refine._reach_kernels import Limbs, reach

_LIMBS: tuple[tuple[int, str, tuple[str, ...], tuple[str, ...]], ...] = (
    (3, "chest", ("clavicle", "shoulder", "elbow", "wrist"), ("shoulder", "elbow", "wrist")),
    (1, "pelvis", ("hip", "knee", "ankle", "foot"), ("hip", "knee", "ankle")),
)
"""Arms and legs: number of proposed pairs, parent segment, nodes that they turn, sampled bones."""

_SHARES = (1 / 3, 2 / 3, 1.0)
"""Places of the balls along a bone, as shares of its length."""

_CONFIGURATIONS = 800
"""Number of configurations kept per limb; set by hand."""

_POSES = 6000
"""Number of bank poses, evenly spread, that they are chosen from; set by hand."""

_EXPLAINED_M = 0.045
"""Depth difference (m) below which the body explains a pixel; set by hand."""

_BEFORE_M = 0.1
"""Unexplained points this far (m) in front of the body count three times: only a limb can be there."""

_SEAT_M = 0.05
"""Points behind the trunk and this far (m at scale 1) above the pelvis belong to a chair back, not a leg."""

_MOST_POINTS = 24
"""Maximum number of unexplained points that are compared, to bound the time."""

_FEWEST_POINTS = 5
"""With fewer unexplained points the input shows no limb."""

_SETTINGS = kernels.LimbSettings(tolerance=0.15, keep=4.0, fitting=200, best=24)
"""Settings of the search, set by hand; ``keep`` is in pixels of the coarse grid, for each limb."""

_REACHING = 3
"""Number of configurations, those with the nearest ends, that are bent to reach each unexplained point."""

_UNDER_SKIN_M = 0.03
"""Depth of wrist and ankle behind the surface (m)."""

_BENT_SETTINGS = _SETTINGS._replace(best=8)
"""Settings for the bent configurations."""

_APART_M = 0.08
"""Limbs are the same if all corresponding balls are closer than this (m); set by hand."""


@dataclass(frozen=True)
class LimbPair:
    """Configurations of a left and a right limb; index 0 is left.

    Attributes
    ----------
    proposals : int
        Number of pairs that are proposed.
    anchor : int
        Node of the parent segment of both.
    nodes : (2, n) int
        Nodes that the limb turns.
    bones, ends : (2, m) int, (2, m, 3)
        Start nodes of its bones, and the bones in the rest pose, metres.
    rotations : (2, L, n, 3, 3)
        ``R_anchor_segment`` of each node's segment.
    limbs : tuple of Limb
        Balls of the left and of the right one.
    tips : (2, 3, L)
        End of their second bone, in columns: the wrist or the ankle.
    faces : (F, 3)
        Faces of the body without both limbs.
    first : int
        Index of the node that the first bone begins at, among those that turn.
    reaches : bool
        Whether the limbs are bent to reach points; true for arms.
    """

    proposals: int
    anchor: int
    nodes: NDArray[np.int64]
    bones: NDArray[np.int64]
    ends: NDArray[np.float64]
    rotations: NDArray[np.float64]
    limbs: tuple[kernels.Limb, kernels.Limb]
    tips: NDArray[np.float64]
    faces: NDArray[np.int32]
    first: int
    reaches: bool


class LimbSearch:
    """Proposes poses with one pair of limbs replaced.

    Attributes
    ----------
    pairs : tuple of LimbPair
        Configurations of the arms, and of the legs.
    """

    def __init__(self, bank: Bank) -> None:
        step = max(1, bank.poses // _POSES)
        quats = bank.pose_quats[::step].astype(np.float64)
        nodes = bank.pose_nodes[::step]
        nodes = np.concatenate([nodes, nodes[:, MIRROR_NODES] * np.array([-1.0, 1.0, 1.0])])
        self.pairs = tuple(_make_pair(bank.body, quats, nodes, *limb) for limb in _LIMBS)

    def propose(self, body: FittedBody, comparer: DepthComparer) -> list[BodyPose]:
        """Replace the arms, and the legs, where other configurations explain more points.

        Parameters
        ----------
        body : FittedBody
        comparer : DepthComparer
            For the same input.

        Returns
        -------
        list of BodyPose
            Poses with other arms, and with other legs, where the input shows any part of them.
        """
        nearest = comparer.nearest
        proposals = []
        for pair in self.pairs:
            proposals += _exchange(pair, body, comparer, nearest)
        return proposals


def _exchange(
    pair: LimbPair, body: FittedBody, comparer: DepthComparer, nearest: NDArray[np.int32]
) -> list[BodyPose]:
    """Apply the best pairs of configurations to a pose; none where the input does not show the limbs."""
    pose, nodes = body.pose, body.nodes
    if not kernels.is_in_view(nodes, pair.bones, comparer.observation.camera):
        return []
    drawn = render_depth(body.vertices, pair.faces, comparer.observation.camera)
    points, before = kernels.unexplained(drawn, comparer.observation, _EXPLAINED_M, _BEFORE_M)
    if not pair.reaches:
        possible = may_be_legs(points, pose)
        points, before = points[possible], before[possible]
    if len(points) < _FEWEST_POINTS:
        return []
    weight = int(np.ceil(len(points) / _MOST_POINTS))  # pixels that each remaining point represents
    points, before = points[::weight], before[::weight]
    columns = np.ascontiguousarray(np.concatenate([points, points[before], points[before]]).T, np.float32)
    anchor = kernels.Anchor(pose.rotations[pair.anchor], nodes[pair.anchor], pose.scale)
    scored, bent_turns = [], []
    known = len(pair.rotations[0])
    for side in range(2):
        own = np.empty(pair.limbs[side].samples.shape[1:])
        kernels.place_own_balls(
            pose.rotations, nodes, pair.bones[side], pair.ends[side], _SHARES, pose.scale, own
        )
        limb = pair.limbs[side]
        seen = own, anchor, comparer.observation, nearest, columns, weight
        found = kernels.score_limbs(limb, *seen, _SETTINGS)
        if pair.reaches:
            bent, turns = _reaching(pair, side, anchor, points)
            bent_turns.append(turns)
            others = kernels.score_limbs(bent, *seen, _BENT_SETTINGS)
            # the current limb is last and stays last
            found = tuple(np.concatenate([o[:-1], f]) for o, f in zip(others, found, strict=True))
            found[0][: len(others[0]) - 1] += known
        scored.append(found)
    numbers, costs, covers, centres = zip(*scored, strict=True)
    total = kernels.pair_costs(costs[0], covers[0], costs[1], covers[1], weight)
    bent_left, bent_right = (n >= known for n in numbers)
    bent_left[-1] = bent_right[-1] = False
    is_bent = bent_left[:, None] | bent_right
    unbent = np.where(is_bent, np.inf, total)
    chosen = list(kernels.best_pairs(unbent, centres[0], centres[1], pair.proposals, _APART_M))
    if is_bent.any():
        chosen.append(np.array(np.divmod(np.where(is_bent, total, np.inf).argmin(), total.shape[1])))
    proposals = []
    for rows in chosen:
        rotations = pose.rotations.copy()
        for side in range(2):
            if rows[side] < len(numbers[side]) - 1:  # otherwise the current limb
                number = numbers[side][rows[side]]
                turns = pair.rotations[side] if number < known else bent_turns[side]
                local = turns[number if number < known else number - known]
                rotations[pair.nodes[side]] = pose.rotations[pair.anchor] @ local
        proposals.append(BodyPose(rotations, pose.root, pose.scale))
    return proposals


def may_be_legs(points: NDArray[np.float32], pose: BodyPose) -> NDArray[np.bool_]:
    """Mask the points that may belong to legs, excluding a chair back behind the trunk.

    Parameters
    ----------
    points : (P, 3) float32
        Camera frame, metres.
    pose : BodyPose

    Returns
    -------
    (P,) bool
    """
    local = (points - pose.root) @ pose.rotations[NODE_INDEX["pelvis"]] / pose.scale
    return np.asarray((local[:, 1] < _SEAT_M) | (local[:, 2] > 0.0))


def _reaching(
    pair: LimbPair, side: int, anchor: kernels.Anchor, points: NDArray[np.float32]
) -> tuple[kernels.Limb, NDArray[np.float64]]:
    """Return limbs that reach points (P, 3), and the rotations of their segments."""
    limb, rotations = pair.limbs[side], pair.rotations[side]
    deeper = points * (1.0 + _UNDER_SKIN_M / points[:, 2:])
    targets = (deeper - anchor.origin) @ anchor.rotation / anchor.scale
    count = min(_REACHING, len(limb.samples))
    samples = np.empty((count * len(points), *limb.samples.shape[1:]))
    turned = np.empty((len(samples), *rotations.shape[1:]))
    known = Limbs(limb.samples, pair.tips[side], rotations, pair.first)
    reach(known, targets, count, samples, turned)
    return limb._replace(samples=samples), turned


def _make_pair(
    body: Body,
    quats: NDArray[np.float64],
    nodes: NDArray[np.float64],
    proposals: int,
    anchor_name: str,
    turned: tuple[str, ...],
    sampled: tuple[str, ...],
) -> LimbPair:
    """Collect a limb's configurations from poses and their mirror images, and thin them."""
    anchor = NODE_INDEX[anchor_name]
    side = [np.array([NODE_INDEX[f"{s}_{n}"] for n in turned]) for s in ("left", "right")]

    bones = [NODE_INDEX[f"left_{n}"] for n in sampled]
    joints = (nodes[:, bones] - nodes[:, anchor, None]) @ _with_mirrored(quats[:, [anchor]])[:, 0]
    keep = farthest_rows(joints.reshape(len(nodes), -1), _CONFIGURATIONS, start=0)
    kept = quat_to_matrix(quats[keep % len(quats)])
    kept = np.where((keep < len(quats))[:, None, None, None], kept, mirror_rotations(kept))
    local = kept[:, anchor, None].transpose(0, 1, 3, 2) @ kept[:, side[0]]
    ends, radii, areas = _balls(body, bones)
    samples = _ball_centres(kept, nodes[keep], anchor, np.array(bones), ends)

    # the configurations of the right limb are those of the left one, mirrored
    flip = np.array([-1.0, 1.0, 1.0])
    return LimbPair(
        proposals=proposals,
        anchor=anchor,
        nodes=np.stack(side),
        bones=np.stack([bones, MIRROR_NODES[bones]]),
        ends=np.stack([ends, ends * flip]),
        rotations=np.stack([local, flip[:, None] * local * flip]),
        limbs=(kernels.Limb(samples, radii, areas), kernels.Limb(samples * flip, radii, areas)),
        tips=np.stack([samples[:, 5].T, (samples * flip)[:, 5].T]),
        faces=_without(body, np.concatenate(side)),
        first=turned.index(sampled[0]),
        reaches=anchor_name == "chest",
    )


def _with_mirrored(quats: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return rotations (2 N, ...) of mid-plane segments, for poses (N, ...) and their mirror images."""
    rotations = quat_to_matrix(quats)
    return np.concatenate([rotations, mirror_rotation(rotations)])


def _balls(
    body: Body, bones: list[int]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Compute the ends (n, 3) of a limb's rest bones, and radii and areas (3 n,) of balls along them."""
    ends, radii, areas = [], [], []
    for bone in bones:
        mine = body.vertices[np.argmax(body.weights, axis=1) == bone] - body.nodes[bone]
        far = mine[np.argmax(np.linalg.norm(mine, axis=1))]
        end = body.nodes[bone + 1] - body.nodes[bone] if bone + 1 not in _ENDS else far
        length = float(np.linalg.norm(end))
        along = mine @ (end / length)
        off = np.linalg.norm(mine - along[:, None] * (end / length), axis=1)
        for share in _SHARES:
            near = np.abs(along - share * length) < 0.25 * length
            radii.append(float(np.median(off[near])) if near.sum() > 3 else 0.03)
            areas.append(2 * radii[-1] * length / len(_SHARES))
        ends.append(end)
    return np.array(ends), np.array(radii), np.array(areas)


def _ball_centres(
    rotations: NDArray[np.float64],
    nodes: NDArray[np.float64],
    anchor: int,
    bones: NDArray[np.int64],
    ends: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Compute the ball centres (L, S, 3) of limbs, relative to the anchor node, in the anchor's frame."""
    reach = np.einsum("lnij,nj->lni", rotations[:, bones], ends)
    places = nodes[:, bones, None] + np.array(_SHARES)[:, None] * reach[:, :, None]
    places = places.reshape(len(nodes), -1, 3) - nodes[:, anchor, None]
    return np.einsum("lji,lsj->lsi", rotations[:, anchor], places)


_ENDS = frozenset(NODE_INDEX[n] for n in ("right_clavicle", "left_hip"))
"""Nodes that follow a hand in the node order without being its far end."""


def _without(body: Body, nodes: NDArray[np.int64]) -> NDArray[np.int32]:
    """Return the faces of the body on which none of ``nodes`` has the most influence."""
    moved = np.isin(np.argmax(body.weights, axis=1), nodes)
    return body.faces[~moved[body.faces].any(axis=1)]
