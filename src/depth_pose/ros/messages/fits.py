"""Messages of fitted bodies, with the people they are of."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from depth_pose_msgs.msg import Packed
from numpy.typing import NDArray

from depth_pose.body.pose import BodyPose, Fitted, FittedBody
from depth_pose.core.errors import InputError
from depth_pose.core.result import BUILD_SIZE
from depth_pose.core.skeleton import NODES, Source
from depth_pose.ros.messages.checks import check_numbers, check_people
from depth_pose.ros.messages.people import people_to_msg, read_people, text_of
from depth_pose.track.person_view import FramePeople

_FIT = np.dtype(
    [
        ("body_id", "S64"),
        ("source", "u1"),
        ("rotations", "<f8", (len(NODES), 3, 3)),
        ("root", "<f8", 3),
        ("scale", "<f8"),
        ("nodes", "<f8", (len(NODES), 3)),
        ("build", "<f4", BUILD_SIZE),
        ("score", "<f8"),
        ("mean_depth_error", "<f8"),
    ]
)
"""One fitted body."""

FIT_KINDS = (_FIT, np.dtype("<f8"))
"""Types of the arrays of a message of fits behind those of its people; the last has the vertices of all known
bodies."""


def fitted_to_msg(fitted: Sequence[Fitted], people: FramePeople) -> Packed:
    """Build the message of a frame's people and the bodies fitted to them."""
    records = np.zeros(len(fitted), _FIT)
    for record, one in zip(records, fitted, strict=True):
        record["body_id"], record["source"] = one.body_id.encode(), one.source
        record["score"], record["mean_depth_error"] = one.score, one.mean_depth_error
        if one.body is not None:
            pose = one.body.pose
            record["rotations"], record["root"], record["scale"] = pose.rotations, pose.root, pose.scale
            record["nodes"], record["build"] = one.body.nodes, one.build
    skins = [one.body.vertices.ravel() for one in fitted if one.body is not None]
    return people_to_msg(people, [records, np.concatenate([np.zeros(0), *skins])])


def msg_to_fitted(message: Packed, vertices: int) -> tuple[FramePeople, tuple[Fitted, ...]]:
    """Return the people of a message and their fitted bodies, equal to those that were sent.

    Parameters
    ----------
    message : Packed
    vertices : int
        Number of vertices of the body.

    Raises
    ------
    InputError
        If the fits are of a body with another number of vertices, or a number is not valid.
    """
    people, (records, skins) = read_people(message, FIT_KINDS)
    ids = text_of(records["body_id"])
    check_people("fits", ids)
    known = [s for s in records["source"] if s != Source.LOST]
    if len(skins) != 3 * vertices * len(known):
        raise InputError(
            f"the fits have {len(skins) // 3} vertices; {len(known)} bodies have {vertices} each"
        )
    odd = [s for s in records["source"].tolist() if s not in tuple(Source)]
    if odd:
        raise InputError(f"the source of a fit is {odd[0]}; it is one of 0 to {max(Source)}")
    for name, most in (("rotations", 1.1), ("root", 1e3), ("scale", 100.0), ("nodes", 1e3), ("build", 100.0)):
        check_numbers(f"{name} of a fit", records[name], most)
    check_numbers("the score or depth error of a fit", [records["score"], records["mean_depth_error"]])
    check_numbers("a vertex", skins)
    meshes = iter(skins.astype(np.float64, copy=False).reshape(len(known), vertices, 3))
    return people, tuple(
        Fitted.lost(people.stamp_ns, body_id)
        if record["source"] == Source.LOST
        else _fitted(record, body_id, people.stamp_ns, next(meshes))
        for body_id, record in zip(ids, records, strict=True)
    )


def _fitted(record: np.void, body_id: str, stamp_ns: int, vertices: NDArray[np.float64]) -> Fitted:
    rotations, root, nodes, build = (record[n].copy() for n in ("rotations", "root", "nodes", "build"))
    return Fitted(
        body_id,
        stamp_ns,
        Source(record["source"]),
        FittedBody(BodyPose(rotations, root, float(record["scale"])), vertices, nodes),
        build,
        float(record["score"]),
        float(record["mean_depth_error"]),
    )
