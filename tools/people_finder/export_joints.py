"""Write a checkpoint of the joint net for release, with the odds that combine it with the finder's answer.

python tools/people_finder/export_joints.py runs/joints/last.pt sightings/val.npz build/weights
python tools/people_finder/export_joints.py fine.pt sightings/val.npz build/quick --alone
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from fit_deviations import UNFITTED
from joint_net import CELL_M, COARSE_CELL_M, LEAST_WIDTH_M, SIDE, FineNet, JointNet
from numpy.typing import NDArray
from sightings import Sightings

from depth_pose.core.odds import logistic, logit
from depth_pose.detect.crop_window import CELL, CropGrid, cells_of
from depth_pose.detect.net import open_net
from export import JOINT_CODE, JOINT_FEATURES, export_joint_net, hash_code, write_settings

_STEPS, _RIDGE = 30, 1e-3
"""Newton steps, and the ridge added to the Hessian to keep it invertible. Set by hand."""


_THINGS = 0.2
"""Share of objects among the finder's detections in rooms, two of five of which hold lookalikes."""


def logits_of(model: bytes, net: FineNet, found: Sightings) -> NDArray[np.float64]:
    """Return the logits of both looks, (N, 2)."""
    session, grid = open_net(model), crop_grid(net)
    cells = cells_of(grid, grid.whole)
    second = []
    for k in range(len(found)):
        given = {"features": found.batch(np.array([k]), None).features} | cells
        if isinstance(net, JointNet):
            rows = net.middle.numpy()
            given["middle"] = given["features"][:, :, rows][..., rows]
        second.append(session.run(["person"], given)[0].item())
    return np.stack([[logit(float(p)) for p in found.probability], second], axis=1)


def crop_grid(net: FineNet) -> CropGrid:
    """Return the cells of a net's crop."""
    if isinstance(net, JointNet):
        return CropGrid(SIDE, CELL_M, len(net.middle) // CELL, CELL * COARSE_CELL_M)
    return CropGrid(SIDE, CELL_M)


def fit_odds(logits: NDArray[np.float64], is_person: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Fit a logistic regression by Newton's method; return the weights of the logits, and the bias.

    People and objects are weighted as if a share of `_THINGS` were objects, however many there are.
    """
    x = np.column_stack([logits, np.ones(len(logits))])
    counts = np.where(is_person, (1 - _THINGS) / is_person.mean(), _THINGS / (~is_person).mean())
    weights = np.zeros(x.shape[1])
    for _ in range(_STEPS):
        p = logistic(x @ weights)
        curvature = (x * (counts * p * (1.0 - p))[:, None]).T @ x + _RIDGE * np.eye(x.shape[1])
        weights -= np.linalg.solve(curvature, x.T @ (counts * (p - is_person)) + _RIDGE * weights)
    return weights


def main(
    checkpoint: Annotated[Path, typer.Argument(help="Weights of the net (.pt)")],
    sightings: Annotated[Path, typer.Argument(help="Sightings that it was not trained on (.npz)")],
    out: Annotated[Path, typer.Argument(help="Folder for joint_finder.onnx and .json")],
    note: Annotated[str, typer.Option(help="How the net was trained, for the record")] = "",
    alone: Annotated[bool, typer.Option("--alone", help="The fine net alone (leave_out_coarse.py)")] = False,
) -> None:
    """Write the net and its provenance."""
    net: FineNet = FineNet() if alone else JointNet()
    model = export_joint_net(net, checkpoint, out / "joint_finder.onnx")
    found = Sightings.load(sightings)
    person = fit_odds(logits_of(model, net, found), found.is_person)
    code = hash_code(JOINT_CODE + ("leave_out_coarse.py",) * alone, JOINT_FEATURES)
    crop = {"side": SIDE, "cell_m": CELL_M, "least_width_m": LEAST_WIDTH_M}
    if isinstance(net, JointNet):
        crop |= {"middle": net.middle.tolist(), "coarse_cell_m": CELL * COARSE_CELL_M}
    odds = {"person": person.tolist(), "person_in_window": person.tolist()}
    settings = {**odds, "deviations": UNFITTED, **crop}
    write_settings(out / "joint_finder.json", model, code, training=note, **settings)


if __name__ == "__main__":
    typer.run(main)
